"""Materials that change while the body moves."""

from __future__ import annotations

import numpy as np
import pytest

from mpm_bodies import body, lattice
from phys4dgen.errors import SimulationError
from phys4dgen.mpm import Ground, LawId, MaterialChange, Settings, Simulator

G = 9.81
DX = 0.02
WATER = {"law": LawId.FLUID, "youngs_modulus_pa": 3e4, "poisson_ratio": 0.45, "numbers": {"viscosity_pas": 1.0}}


def two_blocks():
    x = np.concatenate([lattice((6, 6, 6), DX / 2), lattice((6, 6, 6), DX / 2, (0.3, 0, 0))])
    return body(x, (DX / 2) ** 3, E=3e4, part=np.repeat([0, 1], 216), rho=500.0, names=("ice", "stone"))


def run(b, frames, *, changes, **settings):
    simulator = Simulator(b, Settings(DX, 0.02, changes=changes, **settings))
    return simulator, [simulator.advance() for _ in range(frames)]


def test_what_melts_spreads_and_what_does_not_stays():
    b = two_blocks()
    melt = MaterialChange(part=0, at_s=0.1, **WATER)
    _, frames = run(b, 40, changes=(melt,), gravity_ms2=(0, 0, -G), ground=Ground(0.0, friction=0.2))
    ice, stone = b.part == 0, b.part == 1
    assert np.ptp(frames[3].positions_m[ice, 2]) > 0.04
    assert np.ptp(frames[-1].positions_m[ice, 2]) < 0.5 * 0.05
    assert np.ptp(frames[-1].positions_m[ice, 0]) > 1.5 * 0.05
    kept = frames[-1].positions_m[stone] - b.positions_m[stone]
    assert np.ptp(kept, axis=0).max() < 0.1 * 0.06
    assert np.abs(frames[-1].momentum_kgms).max() < 0.2 * G * 0.02 * b.mass_kg.sum()


def test_a_change_in_flight_keeps_momentum_position_and_mass():
    b = two_blocks()
    b = body(b.positions_m, b.volume_m3, E=3e4, part=b.part, rho=500.0, v=np.tile([1.0, 0.5, -0.2], (432, 1)))
    at_s = np.linspace(0.0, 0.12, 432)  # one after the other
    soft = MaterialChange(law=LawId.NEO_HOOKEAN, youngs_modulus_pa=1e4, poisson_ratio=0.3, at_s=at_s, part=0)
    clay = MaterialChange(
        law=LawId.VON_MISES,
        youngs_modulus_pa=5e4,
        poisson_ratio=0.3,
        at_s=0.05,
        part=1,
        numbers={"yield_stress_pa": 1e3},
    )
    _, frames = run(b, 8, changes=(soft, clay))
    momentum = np.array([frame.momentum_kgms for frame in frames])
    np.testing.assert_allclose(momentum, np.tile(momentum[0], (8, 1)), rtol=1e-5)
    moved = frames[-1].positions_m - b.positions_m
    np.testing.assert_allclose(moved, np.tile([0.16, 0.08, -0.032], (432, 1)), atol=1e-5)


def test_what_hardens_carries_more():
    """A column that sags under its weight sags less than it would once it is four times as stiff."""
    x = lattice((6, 6, 12), DX / 2)
    b = body(x, (DX / 2) ** 3, E=1e4, nu=0.0, rho=500.0, held=x[:, 2] < 0.02)

    def top(changes):
        _, frames = run(b, 40, changes=changes, gravity_ms2=(0, 0, -G), damping_per_s=20.0)
        return b.positions_m[:, 2].max() - frames[-1].positions_m[:, 2].max()

    stiff = MaterialChange(law=LawId.NEO_HOOKEAN, youngs_modulus_pa=4e4, poisson_ratio=0.0, at_s=0.3)
    assert top((stiff,)) == pytest.approx(top(()) / 4, rel=0.1)


def test_a_changed_body_goes_on_from_a_checkpoint():
    b = two_blocks()
    changes = (MaterialChange(part=0, at_s=np.linspace(0, 0.2, 432), **WATER),)
    settings = Settings(DX, 0.02, changes=changes, gravity_ms2=(0, 0, -G), ground=Ground(0.0))
    first = Simulator(b, settings)
    for _ in range(4):
        first.advance()
    second = Simulator(b, settings)
    second.restore(first.checkpoint())
    for _ in range(2):
        np.testing.assert_array_equal(first.advance().positions_m, second.advance().positions_m)


def test_what_has_flowed_is_not_given_its_first_shape_back():
    freeze = MaterialChange(law=LawId.NEO_HOOKEAN, youngs_modulus_pa=1e5, poisson_ratio=0.3, at_s=1.0, part=0)
    melt = MaterialChange(part=0, at_s=0.1, **WATER)
    with pytest.raises(SimulationError, match="Part 'ice' cannot change from fluid, in which it may have flowed"):
        Simulator(two_blocks(), Settings(DX, 0.02, changes=(freeze, melt)))
    hard = {"yield_stress_pa": 1e6}
    freeze = MaterialChange(
        law=LawId.VON_MISES, youngs_modulus_pa=1e5, poisson_ratio=0.3, at_s=0.1, part=0, numbers=hard
    )
    _, frames = run(
        two_blocks(), 8, changes=(MaterialChange(part=0, at_s=0.02, **WATER), freeze), gravity_ms2=(0, 0, -G),
        ground=Ground(0.0),
    )  # fmt: skip
    assert np.isfinite(frames[-1].positions_m).all()
