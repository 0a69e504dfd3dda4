"""A simulation that was stopped goes on as if it had not been."""

from dataclasses import replace

import numpy as np
import pytest

from mpm_bodies import body, lattice
from phys4dgen.errors import SimulationError
from phys4dgen.mpm import Acceleration, Ground, LawId, Settings, Simulator
from phys4dgen.mpm.obstacles import Obstacle, Push, RoundedBox

DX = 0.02
FIELDS = ("positions_m", "deformation_gradients", "velocities_ms", "momentum_kgms", "angular_momentum_kgm2s")


def falling(*, rigid):
    """A bar thrown on the ground, both laws, its left half rigid or not."""
    x = lattice((16, 4, 4), DX / 2, corner=(0, 0, 0.01))
    law = np.where(np.arange(len(x)) % 2, LawId.NEO_HOOKEAN, LawId.FIXED_COROTATED)
    v = np.cross([1.0, -3.0, 4.0], x - x.mean(0)) + np.array([0.4, 0.1, -0.6])
    bar = body(x, (DX / 2) ** 3, E=3e4, law=law, v=v)
    return replace(bar, rigid_group=np.where(x[:, 0] < 4 * DX, 0, -1).astype(np.int32)) if rigid else bar


def held(*, rigid):
    """A standing bar that is held below and pushed above."""
    x = lattice((4, 4, 12), DX / 2)
    return body(x, (DX / 2) ** 3, E=3e4, held=x[:, 2] < 2 * DX)


def packed(*, rigid):
    """A block of snow and sand, whose laws keep a history, under a falling plate."""
    x = lattice((8, 8, 8), DX / 2)
    numbers = {"critical_compression": 0.025, "critical_stretch": 0.0075, "hardening_coefficient": 10.0}
    numbers |= {"friction_angle_deg": 35.0, "cohesion_pa": 0.0}
    law = np.where(x[:, 0] < 2 * DX, LawId.SNOW, LawId.DRUCKER_PRAGER).astype(np.int32)
    given = {name: np.full(len(x), value) for name, value in numbers.items()}
    return replace(body(x, (DX / 2) ** 3, E=5e4), law=law, law_numbers=given)


PLATE = Obstacle(
    RoundedBox((0.08, 0.08, 0.19), (0.1, 0.1, 0.01)), push=Push((0, 0, -1), force_n=200.0, mass_kg=1.0, ramp_s=0.02)
)
SETTINGS = Settings(
    DX,
    0.02,
    gravity_ms2=(0, 0, -9.81),
    loads=(Acceleration((1.0, 0, 0), from_s=0.03, to_s=0.07),),
    ground=Ground(height_m=0.0, friction=0.4),
    damping_per_s=2.0,
    chunks=2,
)


@pytest.mark.parametrize(("make", "rigid"), [(falling, False), (falling, True), (held, False), (packed, False)])
def test_going_on_from_a_checkpoint_gives_the_same_bits(make, rigid):
    settings = replace(SETTINGS, ground=None if make is held else SETTINGS.ground)
    settings = replace(settings, obstacles=(PLATE,) if make is packed else ())
    simulator = Simulator(make(rigid=rigid), settings)
    for _ in range(3):
        simulator.advance()
    saved, before = simulator.checkpoint(), simulator.frame
    undisturbed = [simulator.advance() for _ in range(3)]
    for chunks in (2, 3):  # of the kernels' work, which is not part of the state
        other = Simulator(make(rigid=rigid), replace(settings, chunks=chunks))
        again = other.restore(saved)
        assert again.time_s == before.time_s == pytest.approx(0.06)
        assert (again.substeps, again.dt_s) == (before.substeps, before.dt_s)
        frames = [other.advance() for _ in range(3)] if chunks == 2 else []
        for found, expected in zip([again, *frames], [before, *undisturbed][: 1 + len(frames)], strict=True):
            for name in FIELDS:
                np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)


def test_a_checkpoint_of_another_body_is_refused():
    simulator = Simulator(falling(rigid=False), SETTINGS)
    saved = simulator.checkpoint()
    with pytest.raises(SimulationError, match="does not fit the body"):
        Simulator(falling(rigid=True), SETTINGS).restore(saved)
    with pytest.raises(SimulationError, match="does not fit the body"):
        simulator.restore({**saved, "columns": saved["columns"][:, :-1]})
    assert simulator.frame.time_s == 0
