"""The body at one time, as the simulator hands it out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm import diagnostics
from phys4dgen.mpm.body import Body
from phys4dgen.mpm.rigid import RigidParts
from phys4dgen.mpm.solids import Solids
from phys4dgen.mpm.state import Particles

__all__ = ["Frame", "frame_of"]


@dataclass(frozen=True, eq=False)
class Frame:
    """The body at one time; held particles stand in their rest pose with F = I.

    Attributes:
        time_s: simulated time.
        positions_m: shape [P, 3], float64.
        deformation_gradients: total F, shape [P, 3, 3], float32; of material that flows within limits
            (``state.REMEMBERED_STRETCH``).
        velocities_ms: shape [P, 3], float32.
        substeps: taken since the last frame.
        dt_s: their length, at the end of the frame.
        max_speed_ms: of the fastest particle.
        kinetic_energy_j, elastic_energy_j: of all that moves.
        momentum_kgms, angular_momentum_kgm2s: of all that moves, the latter about the coordinate origin, [3].
        reactions_n: mean force of the body on each obstacle since the last frame, then on the ground if there is one,
            [O or O + 1, 3].
        obstacle_shifts_m: how far each obstacle has moved, [O, 3].
    """

    time_s: float
    positions_m: NDArray[np.float64]
    deformation_gradients: NDArray[np.float32]
    velocities_ms: NDArray[np.float32]
    substeps: int
    dt_s: float
    max_speed_ms: float
    kinetic_energy_j: float
    elastic_energy_j: float
    momentum_kgms: NDArray[np.float64]
    angular_momentum_kgm2s: NDArray[np.float64]
    reactions_n: NDArray[np.float64]
    obstacle_shifts_m: NDArray[np.float64]


def frame_of(
    simulated: Body,
    particles: Particles,
    *,
    rest: Body,
    rigid: RigidParts | None,
    solids: Solids,
    dx_m: float,
    time_s: float,
    substeps: int,
    dt_s: float,
    since_s: float,
) -> Frame:
    """The frame of a state.

    Args:
        simulated: with the materials of this time, the skin of held parts moving.
        particles: its state.
        rest: the body as given.
        rigid: its rigid groups, or None.
        solids: ground and obstacles with what they have given since the last frame.
        dx_m: side of a grid cell.
        time_s: now.
        substeps: taken since the last frame.
        dt_s: their length.
        since_s: time since the last frame.
    """
    particles.limit_stretch()
    moving = particles.moving
    mass = simulated.mass_kg[moving]
    x, v = particles.positions_m(), particles.velocities_ms()
    if rigid is not None:
        is_rigid = simulated.is_rigid[moving]
        v[is_rigid] = rigid.velocities_ms(moving[is_rigid])
    f, c = particles.deformation_gradients(), particles.affine_per_s()
    positions = simulated.positions_m.copy()
    positions[moving] = x
    gradients = np.tile(np.eye(3, dtype=np.float32), (len(simulated), 1, 1))
    gradients[moving] = f
    stored_j = diagnostics.elastic_energy_j(simulated, particles, gradients)
    velocities = np.zeros((len(simulated), 3), np.float32)
    velocities[moving] = v
    skin = rest.held  # simulated beside the moving body, but held for everyone else
    positions[skin], gradients[skin], velocities[skin] = simulated.positions_m[skin], np.eye(3), 0
    return Frame(
        time_s=time_s,
        positions_m=positions,
        deformation_gradients=gradients,
        velocities_ms=velocities,
        substeps=substeps,
        dt_s=dt_s,
        max_speed_ms=float(np.linalg.norm(v, axis=1).max()),
        kinetic_energy_j=diagnostics.kinetic_energy_j(mass, v, c, dx_m),
        elastic_energy_j=stored_j,
        momentum_kgms=diagnostics.momentum_kgms(mass, v),
        angular_momentum_kgm2s=diagnostics.angular_momentum_kgm2s(mass, x, v, c, dx_m=dx_m, about_m=np.zeros(3)),
        reactions_n=-solids.given_kgms / since_s,
        obstacle_shifts_m=solids.shifts_m.copy(),
    )
