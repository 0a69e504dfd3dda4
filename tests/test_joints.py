"""What has grown together with held particles, what only touches them, and which rigid parts are one body."""

import numpy as np
import pytest

from phys4dgen.joints import bonded_to_held, joining_masses, rigid_bodies
from phys4dgen.mpm import Body, Settings, Simulator, TotalForce

CELL_M = 4e-3
STEP_M = CELL_M / 2


def _box(low, high):
    """Particles half a cell apart in a box, metres."""
    axes = [np.arange(a + STEP_M / 2, b, STEP_M) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)


def _scene(*boxes):
    """Points and the number of the box of each."""
    points = [_box(low, high) for low, high in boxes]
    return np.concatenate(points), np.repeat(np.arange(len(boxes)), [len(p) for p in points]).astype(np.int32)


POT = ((-0.04, -0.04, 0.0), (0.04, 0.04, 0.05))
STEM = ((-0.004, -0.004, 0.05), (0.004, 0.004, 0.12))
LEAF = ((0.004, -0.004, 0.116), (0.048, 0.004, 0.12))  # from the stem's top outwards
HANGING = ((0.041, -0.004, 0.01), (0.045, 0.004, 0.116))  # down along the pot's wall, 1 mm from it


def _bonded(points, box, *, held=0, piece=None):
    number = (box if piece is None else piece).astype(np.int64)
    return bonded_to_held(points, box == held, piece=number, cell_m=CELL_M)


def _near(points, box, number, height_m):
    """Particles of a box that stand near the pot."""
    return (box == number) & (points[:, 2] < height_m)


def test_a_stem_is_rooted_and_a_leaf_that_hangs_beside_the_pot_is_not():
    points, box = _scene(POT, STEM, LEAF, HANGING)
    bonded = _bonded(points, box)
    assert bonded[box == 1].all()
    assert not bonded[_near(points, box, 3, 0.045)].any()
    assert bonded[~(box == 3)].all()
    assert bonded[(box == 3) & (points[:, 2] > 0.07)].all()  # far from what is held nothing is said


def test_two_stems_that_meet_above_are_both_rooted():
    left = ((-0.03, -0.004, 0.05), (-0.022, 0.004, 0.12))
    bridge = ((-0.022, -0.004, 0.112), (-0.004, 0.004, 0.12))
    points, box = _scene(POT, STEM, left, bridge)
    assert _bonded(points, box).all()


def test_what_nothing_else_holds_stays_with_what_it_touches():
    points, box = _scene(POT, HANGING)
    assert _bonded(points, box).all()


def test_without_held_or_free_particles_nothing_is_asked():
    points, box = _scene(STEM)
    assert _bonded(points, box).all()
    assert _bonded(points, box, held=1).all()


def test_rigid_parts_that_touch_are_one_body_and_those_apart_are_two():
    head = ((0.02, -0.01, 0.0), (0.05, 0.01, 0.03))
    handle = ((-0.06, -0.004, 0.01), (0.02, 0.004, 0.02))
    nail = ((0.10, -0.004, 0.0), (0.14, 0.004, 0.004))
    points, box = _scene(head, handle, nail)
    none = np.zeros(len(points), bool)
    body, stuck = rigid_bodies(points, box, rigid_parts=[0, 1, 2], held=none, cell_m=CELL_M)
    assert not stuck.any()
    assert len(np.unique(body[box < 2])) == 1
    assert set(np.unique(body)) == {0, 1}
    alone, _ = rigid_bodies(points, box, rigid_parts=[2], held=none, cell_m=CELL_M)
    np.testing.assert_array_equal(alone, np.where(box == 2, 0, -1))


def test_torn_pieces_of_a_rigid_part_are_one_body_and_far_lumps_are_not():
    first = ((0.0, 0, 0), (0.01, 0.01, 0.01))
    for gap_cells, bodies in ((1.5, 1), (10.0, 2)):
        x = 0.01 + gap_cells * CELL_M
        points, box = _scene(first, ((x, 0, 0), (x + 0.01, 0.01, 0.01)))
        part, none = np.zeros(len(points), np.int32), np.zeros(len(points), bool)
        body, _ = rigid_bodies(points, part, rigid_parts=[0], held=none, cell_m=CELL_M)
        assert len(np.unique(body)) == bodies
        assert all(len(np.unique(body[box == number])) == 1 for number in (0, 1))


def test_a_rigid_part_that_touches_what_is_held_is_held():
    trunk, stone = STEM, ((0.1, 0.0, 0.0), (0.11, 0.01, 0.01))
    points, box = _scene(POT, trunk, stone)
    body, stuck = rigid_bodies(points, box, rigid_parts=[1, 2], held=box == 0, cell_m=CELL_M)
    np.testing.assert_array_equal(stuck, box == 1)
    np.testing.assert_array_equal(body, np.where(box == 2, 0, -1))


def _hanging(joined):
    """A soft rod above a clamp, and a light cup on it that pulls with a tenth of the rod's stiffness EA."""
    side = np.array([-1.0, 0.0, 1.0]) * CELL_M * 0.3
    rod = np.array([(x, y, z) for z in np.arange(-4, 20) * STEP_M for x in side for y in side])
    top = rod[:, 2].max() + STEP_M
    rim = _box((-5 * CELL_M, -5 * CELL_M, top + 4 * STEP_M), (5 * CELL_M, 5 * CELL_M, top + 6 * STEP_M))
    neck = np.array([(0.2 * x, 0.2 * y, top + k * STEP_M) for k in range(4) for x in side for y in side])
    points = np.concatenate([rod, neck, rim])
    kind = np.repeat([0, 1, 2], [len(rod), len(neck), len(rim)])
    area_m2 = CELL_M**2
    mass_kg = np.choose(kind, [50 * area_m2 * STEP_M / 9, 50 * area_m2 * STEP_M / 900, 0.02 / len(rim)])
    rigid = np.where(kind > 0, 0, -1).astype(np.int32)
    held = points[:, 2] < 0
    if joined:
        mass_kg = joining_masses(points, mass_kg, rigid_body=rigid, apart=0 * rigid, hangs=~held, cell_m=CELL_M)
    volume_m3 = np.full(len(points), area_m2 * STEP_M / 9)
    one = np.ones(len(points))
    body = Body(
        points,
        volume_m3=volume_m3,
        density_kgm3=mass_kg / volume_m3,
        youngs_modulus_pa=2e4 * one,
        poisson_ratio=0 * one,
        law=np.zeros(len(points), np.int32),
        part=(kind > 0).astype(np.int32),
        held=held,
        part_names=("rod", "cup"),
        rigid_group=rigid,
    )
    pull = TotalForce(value_n=(0, 0, 0.1 * 2e4 * area_m2), part=1, ramp_s=0.1)
    simulator = Simulator(body, Settings(CELL_M, 0.1, loads=(pull,), damping_per_s=60.0))
    frames = [simulator.advance() for _ in range(5)]
    lifted = frames[-1].positions_m - points
    return lifted[kind == 0][-9:, 2].mean(), lifted[kind == 2, 2].mean(), 20 * STEP_M


def test_a_light_rigid_neck_holds_what_hangs_on_it():
    tip_m, cup_m, length_m = _hanging(joined=True)
    assert tip_m == pytest.approx(0.1 * length_m, rel=0.15)
    assert cup_m == pytest.approx(tip_m, abs=0.4 * CELL_M)
    tip_m, cup_m, _ = _hanging(joined=False)
    assert cup_m > 2 * CELL_M + tip_m  # why the masses are moved: it has torn off


def test_masses_move_within_a_rigid_body_and_no_farther_than_half_of_it():
    points, box = _scene(POT, STEM, LEAF)
    rigid = np.where(box == 1, 0, np.where(box == 2, 1, -1)).astype(np.int32)
    mass = np.choose(box, [8.0, 1.0, 1.0])
    everything, one_body = np.ones(len(points), bool), np.zeros(len(points), np.int32)
    joined = joining_masses(points, mass, rigid_body=rigid, apart=one_body, hangs=everything, cell_m=CELL_M)
    for number in (0, 1):
        np.testing.assert_allclose(joined[rigid == number].sum(), mass[rigid == number].sum())
    np.testing.assert_array_equal(joined[rigid < 0], 8)
    np.testing.assert_array_equal(joined[rigid == 1], 1)  # the leaf touches nothing soft
    foot = points[rigid == 0, 2] < 0.05 + CELL_M
    assert joined[rigid == 0][foot].min() > 2
    assert joined[rigid == 0][~foot].min() >= 0.5
    for apart, hangs in ((one_body, box != 0), ((box == 0).astype(np.int32), everything)):
        # nothing hangs on the rigid parts: what is soft is held or a fluid, or another body that only touches them
        still = joining_masses(points, mass, rigid_body=rigid, apart=apart, hangs=hangs, cell_m=CELL_M)
        np.testing.assert_array_equal(still, mass)
