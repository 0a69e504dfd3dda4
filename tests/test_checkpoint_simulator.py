"""A simulation that was stopped goes on as if it had not been."""

from dataclasses import replace

import numpy as np
import pytest

from mpm_bodies import body, lattice
from phys4dgen.errors import SimulationError
from phys4dgen.mpm import Acceleration, Ground, LawId, Settings, Simulator

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


SETTINGS = Settings(
    DX,
    0.02,
    gravity_ms2=(0, 0, -9.81),
    loads=(Acceleration((1.0, 0, 0), from_s=0.03, to_s=0.07),),
    ground=Ground(height_m=0.0, friction=0.4),
    damping_per_s=2.0,
    chunks=2,
)


@pytest.mark.parametrize(("make", "rigid"), [(falling, False), (falling, True), (held, False)])
def test_going_on_from_a_checkpoint_gives_the_same_bits(make, rigid):
    settings = SETTINGS if make is falling else replace(SETTINGS, ground=None)
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
