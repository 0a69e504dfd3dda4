"""What lies at the contacts of the grid: how much of it is soft, and how much is fluid, which rubs in another way."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm.grid import Grid
from phys4dgen.mpm.kernels.shares import node_masses
from phys4dgen.mpm.state import Particles

__all__ = ["mean_at_contacts", "wet_contacts"]

_SHEARED_PER_CELL = 12.0


def mean_at_contacts(
    grid: Grid, particles: Particles, fields: NDArray[np.int32], values: NDArray[np.float32], *, dx_m: float
) -> NDArray[np.float64]:
    """Mean by mass, in each velocity field around each contact, of what particles carry, [fields, K].

    Args:
        grid: with its contacts.
        particles: where they are.
        fields: velocity field of each, [stride].
        values: what each carries per mass, [stride].
        dx_m: side of a cell.
    """
    starts, nodes = grid.contacts[:2]
    row = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    place = row * grid.nodes[2] + nodes[:, 0]
    mean = np.zeros((grid.fields, len(place)))
    for field in range(grid.fields):
        total, weighted = np.zeros((2, *grid.nodes), np.float32)
        mine = fields == field
        columns = particles.columns if mine.all() else particles.columns[:, mine]
        node_masses(columns, values[mine], np.float32(1 / dx_m), grid.shift, total, weighted)
        mean[field] = weighted.ravel()[place] / np.maximum(total.ravel()[place], 1e-12)
    return mean


def wet_contacts(
    grid: Grid,
    particles: Particles,
    fields: NDArray[np.int32],
    *,
    is_fluid: NDArray[np.float32],
    viscosity_m2s: NDArray[np.float32],
    dx_m: float,
) -> None:
    """Give contacts the friction of what is at them: a fluid has none of Coulomb's, it shears at the wall.

    The nodes that a wall stops hold about a twelfth of a cell of the fluid beside it; the shear stress eta v / dx of
    fluid that rests on the wall a cell away slows them at the rate 12 eta / (rho dx^2).

    Args:
        grid: whose contacts change.
        particles: as ``mean_at_contacts``.
        fields: as ``mean_at_contacts``.
        is_fluid: 1 for particles of fluids, else 0, [stride].
        viscosity_m2s: eta / rho of fluids, else 0, [stride].
        dx_m: side of a cell.
    """
    planes, rubbing = grid.contacts[2], grid.contacts[4]
    rubbing[..., 0] = planes[:, 3] * (1 - mean_at_contacts(grid, particles, fields, is_fluid, dx_m=dx_m))
    viscosity = mean_at_contacts(grid, particles, fields, viscosity_m2s, dx_m=dx_m)
    rubbing[..., 1] = _SHEARED_PER_CELL * viscosity / dx_m**2
