"""Bodies that must not weld: gaps, pressing and letting go, Coulomb friction, momentum, fields shared by far bodies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mpm_bodies import body, lattice
from phys4dgen.mpm import Drive, Ground, LawId, Settings, Simulator

DX = 0.02
H = DX / 2
G = 9.81


def bodies(*pieces, E=1e5, velocities=None, **keywords):
    """Blocks of particles as bodies 0, 1, .. and parts of the same number."""
    x = np.concatenate(pieces)
    number = np.repeat(np.arange(len(pieces)), [len(piece) for piece in pieces]).astype(np.int32)
    v = None if velocities is None else np.asarray(velocities, float)[number]
    return replace(body(x, H**3, E=E, part=number, v=v, **keywords), body_id=number)


def velocity_of(b, frame, number):
    mine = b.body_id == number
    return b.mass_kg[mine] @ frame.velocities_ms[mine] / b.mass_kg[mine].sum()


@pytest.mark.parametrize("gap_cells", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("way", [(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)])
def test_free_slabs_near_one_another_keep_their_relative_velocity(gap_cells, way):
    slab = lattice((16, 16, 4), H)
    upper = slab + np.array([0, 0, 4 * H + gap_cells * DX])
    speed = 0.1
    b = bodies(slab, upper, velocities=[(0, 0, 0), np.array(way) * speed])
    time_s = 0.3 * gap_cells * DX / speed
    one = replace(b, body_id=None)
    kept = {}
    for name, case in (("apart", b), ("welded", one)):
        frame = Simulator(case, Settings(DX, time_s)).advance()
        kept[name] = (velocity_of(b, frame, 1) - velocity_of(b, frame, 0)) @ way / speed
    assert kept["apart"] > 0.999
    if gap_cells < 2:
        assert kept["welded"] < 0.9


def test_blocks_that_meet_bounce_at_their_surfaces_and_keep_momentum():
    block = lattice((8, 8, 8), H)
    b = bodies(block, block + np.array([0.013, 0.007, 8 * H + 1.5 * DX]), velocities=[(0, 0, 0), (0, 0, -0.5)])
    simulator = Simulator(b, Settings(DX, 0.01))
    closest = np.inf
    for _ in range(25):
        frame = simulator.advance()
        lower, upper = (frame.positions_m[b.body_id == n, 2] for n in (0, 1))
        closest = min(closest, upper.min() - lower.max())
    assert 0.5 * H < closest < 1.5 * H  # particles a spacing apart are surfaces that touch
    v = [velocity_of(b, frame, n)[2] for n in (0, 1)]
    assert v[0] < -0.3
    assert v[1] > v[0] + 0.25  # they part again
    drift = frame.momentum_kgms - b.mass_kg @ simulator.body.velocities_ms
    assert np.abs(drift).max() < 1e-4 * 0.5 * b.mass_kg.sum() / 2


def test_blocks_pressed_together_and_let_go_part():
    block = lattice((8, 8, 8), H)
    b = bodies(block, block + np.array([0, 0, 8 * H]), E=5e4)
    top, bottom = b.positions_m[:, 2] > 14 * H, b.positions_m[:, 2] < 2 * H
    press = Drive(velocity_ms=(0, 0, -0.05), to_s=0.2, chosen=top)
    lift = Drive(velocity_ms=(0, 0, 0.1), from_s=0.2, chosen=top)
    pin = Drive(chosen=bottom)
    simulator = Simulator(b, Settings(DX, 0.05, drives=(press, lift, pin), damping_per_s=20.0))
    frames = [simulator.advance() for _ in range(10)]
    middle = (b.positions_m[:, 2] > 3 * H) & (b.positions_m[:, 2] < 13 * H)
    pressed = frames[3].deformation_gradients[middle, 2, 2].mean()
    assert pressed == pytest.approx(1 - 0.01 / (12 * H), abs=0.02)
    parted = frames[-1].positions_m
    gap = parted[b.body_id == 1, 2].min() - parted[b.body_id == 0, 2].max()
    assert gap > 0.015  # lifted by 3 cm from 1 cm of pressing
    assert np.abs(frames[-1].deformation_gradients - np.eye(3)).max() < 0.03  # and nothing is stretched


@pytest.mark.parametrize("rigid", [False, True])
def test_a_block_sliding_on_a_block_obeys_coulomb(rigid):
    slab, block = lattice((40, 12, 4), H), lattice((10, 8, 6), H)
    mu, v0 = 0.3, 0.6
    b = bodies(slab, block + np.array([4 * H, 2 * H, 4 * H]), E=1e6, velocities=[(0, 0, 0), (v0, 0, 0)])
    if rigid:
        b = replace(b, rigid_group=np.where(b.body_id == 1, 0, -1).astype(np.int32))
    pin = Drive(chosen=(b.body_id == 0) & (b.positions_m[:, 2] < 2 * H))
    settings = Settings(DX, 0.02, gravity_ms2=(0, 0, -G), body_friction=mu, drives=(pin,))
    simulator = Simulator(b, settings)
    speeds = [velocity_of(b, simulator.advance(), 1)[0] for _ in range(6)]
    lost = -np.polyfit(0.02 * np.arange(1, 7), speeds, 1)[0]
    assert lost == pytest.approx(mu * G, rel=0.1)
    stops = [velocity_of(b, simulator.advance(), 1)[0] for _ in range(8)]
    assert abs(stops[-1]) < 0.02  # v0 / mu g = 0.204 s
    height = simulator.frame.positions_m[b.body_id == 1, 2].min() - 4 * H
    assert height == pytest.approx(H / 2, abs=0.25 * H)  # it neither floats nor sinks in


def test_a_stack_comes_to_rest_on_the_ground():
    block = lattice((8, 8, 6), H)
    b = bodies(*(block + np.array([0.004 * n, 0.003 * n, (6 * H + 0.005) * n + 0.005]) for n in range(3)), E=2e5)
    settings = Settings(DX, 0.05, gravity_ms2=(0, 0, -G), ground=Ground(0.0), damping_per_s=8.0)
    simulator = Simulator(b, settings)
    frames = [simulator.advance() for _ in range(20)]
    z = frames[-1].positions_m[:, 2]
    for n in range(2):
        gap = z[b.body_id == n + 1].min() - z[b.body_id == n].max()
        assert 0.5 * H < gap < 1.3 * H
    assert np.abs(frames[-1].positions_m - frames[-4].positions_m).max() < 0.02 * DX


def test_far_bodies_share_a_field_and_near_ones_do_not():
    block = lattice((4, 4, 4), H)
    places = [0.0, 0.06, 0.5, 0.56]
    b = bodies(*(block + np.array([at, 0, 0]) for at in places))
    simulator = Simulator(b, Settings(DX, 0.01))
    assert simulator._fields.count == 2
    np.testing.assert_array_equal(simulator._fields.of_range, [0, 1, 0, 1])
    one = Simulator(replace(b, body_id=None), Settings(DX, 0.01))
    assert one._fields.count == 1


def test_one_body_in_two_fields_of_two_laws_is_the_same_as_without_neighbours():
    """A body beside another that it never touches moves as if it were alone, to the rounding of sums."""
    block = lattice((6, 6, 6), H)
    law = np.tile([LawId.NEO_HOOKEAN, LawId.FIXED_COROTATED], 108)
    v = np.cross([3.0, -2.0, 5.0], block - block.mean(0))
    alone = body(block, H**3, E=3e4, law=law, v=v)
    both = bodies(block, block + np.array([0, 0, 6 * H + 1.5 * DX]), E=3e4, law=np.tile(law, 2))
    both = replace(both, velocities_ms=np.concatenate([v, np.zeros_like(v)]))
    settings = Settings(DX, 0.02, body_friction=0.0)
    first, second = Simulator(alone, settings).advance(), Simulator(both, settings).advance()
    np.testing.assert_allclose(second.positions_m[: len(block)], first.positions_m, atol=1e-4 * DX)
