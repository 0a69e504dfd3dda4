"""Energy, momentum and rigid motion of a particle state, in float64.

With APIC a particle carries an affine velocity field: besides m v it holds the angular momentum m dx^2/4 axial(C), and
besides m v^2 / 2 the kinetic energy m dx^2/8 |C|^2 (C. Jiang et al. 2015, prop. 5.4).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm.body import Body
from phys4dgen.mpm.state import Particles

__all__ = ["angular_momentum_kgm2s", "elastic_energy_j", "kinetic_energy_j", "momentum_kgms", "rigid_motion"]

_BLOCK = 2**16  # particles whose energy is found at a time: a million at once would take most of the memory


def momentum_kgms(mass_kg: NDArray[Any], velocities_ms: NDArray[Any]) -> NDArray[np.float64]:
    """Total momentum [3] in kg m/s of masses [M] and velocities [M, 3]."""
    return mass_kg @ velocities_ms.astype(np.float64)


def angular_momentum_kgm2s(
    mass_kg: NDArray[Any],
    positions_m: NDArray[Any],
    velocities_ms: NDArray[Any],
    affine_per_s: NDArray[Any],
    *,
    dx_m: float,
    about_m: NDArray[Any],
) -> NDArray[np.float64]:
    """Total angular momentum [3] in kg m2/s about a point [3]; affine_per_s is C [M, 3, 3]."""
    C = affine_per_s.astype(np.float64)
    axial = np.stack([C[:, 2, 1] - C[:, 1, 2], C[:, 0, 2] - C[:, 2, 0], C[:, 1, 0] - C[:, 0, 1]], 1)
    return mass_kg @ (np.cross(positions_m - about_m, velocities_ms) + dx_m**2 / 4 * axial)


def kinetic_energy_j(
    mass_kg: NDArray[Any], velocities_ms: NDArray[Any], affine_per_s: NDArray[Any], dx_m: float
) -> float:
    """Total kinetic energy in joules, with that of the affine field."""
    squared = np.einsum("pi,pi->p", velocities_ms, velocities_ms, dtype=np.float64)
    affine = np.einsum("pij,pij->p", affine_per_s, affine_per_s, dtype=np.float64)
    return float(mass_kg @ (squared / 2 + dx_m**2 / 8 * affine))


def elastic_energy_j(body: Body, particles: Particles, deformation_gradients: NDArray[Any]) -> float:
    """Total stored energy in joules of the moving particles, F [P, 3, 3] of all; rigid ones store none."""
    total = 0.0
    for law, index, parameters, state in particles.soft_states():
        for first in range(0, len(index), _BLOCK):
            some = slice(first, first + _BLOCK)
            F = deformation_gradients[index[some]].astype(np.float64)
            density = law.energy_density_pa(F, parameters[:, some], state[:, some])
            total += float(body.volume_m3[index[some]] @ density)
    return total


def rigid_motion(
    mass: NDArray[Any], positions: NDArray[Any], velocities: NDArray[Any], affine: NDArray[Any], dx_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Mean velocity, angular velocity and centre of mass of the rigid motion with the same momenta, each [3]."""
    mass = mass.astype(np.float64)
    total = mass.sum()
    centre = mass @ positions / total
    velocity = mass @ velocities / total
    momentum = angular_momentum_kgm2s(mass, positions, velocities - velocity, affine, dx_m=dx_m, about_m=centre)
    r = positions - centre
    inertia = np.eye(3) * (mass @ np.einsum("pi,pi->p", r, r) + total * dx_m**2 / 2) - (mass[:, None] * r).T @ r
    return velocity, np.linalg.solve(inertia, momentum), centre
