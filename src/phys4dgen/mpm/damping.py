"""Damping that spares rigid motion: what of a body's motion is not damped, substep by substep."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm import diagnostics
from phys4dgen.mpm.kernels.layout import AFFINE, LOAD, MASS, POSITION, VELOCITY
from phys4dgen.mpm.settings import Settings

__all__ = ["undamped_motion"]


def undamped_motion(
    columns: NDArray[np.float32],
    settings: Settings,
    everything: NDArray[np.float64],
    kicks: NDArray[np.float64],
    *,
    has_fields: bool,
    dt_s: float,
) -> NDArray[np.float32]:
    """Rigid motion (velocity, angular velocity, centre) that damping spares in each substep, [S, 9].

    Args:
        columns: of the particles at the start of the segment.
        settings: how is damped.
        everything: velocity that all gain in each substep, [S, 3]; what a substep gains is damped in that substep.
        kicks: what loads do to velocities by row (``forces.Kicks``).
        has_fields: kicks depend on velocities.
        dt_s: substep.
    """
    motion = np.zeros((len(everything), 9))
    if not (settings.damping_relative_to_rigid and settings.damping_per_s > 0):
        return motion.astype(np.float32)
    mass = columns[MASS].astype(np.float64)
    velocity, spin, centre = diagnostics.rigid_motion(
        mass,
        columns[POSITION : POSITION + 3].T.astype(np.float64),
        columns[VELOCITY : VELOCITY + 3].T.astype(np.float64),
        columns[AFFINE : AFFINE + 9].T.reshape(-1, 3, 3),
        settings.dx_m,
    )
    kicked = np.zeros((1, 3))
    if kicks.shape[1] > 0:
        row = columns[LOAD].astype(np.int64)
        row_mass = np.bincount(row, mass, kicks.shape[1])
        kicked = np.einsum("r,sri->si", row_mass, kicks[..., :3])
        if has_fields:
            kicked -= (mass * kicks[0, row, 3]) @ columns[VELOCITY : VELOCITY + 3].T
    motion[:, :3] = velocity + np.cumsum(everything + kicked / mass.sum(), 0)
    motion[:, 3:6] = spin
    motion[:, 6:] = centre + np.cumsum(motion[:, :3] * dt_s, 0) - motion[:, :3] * dt_s
    return motion.astype(np.float32)
