"""Blocks of particles with materials, and bodies with a clamp, for benchmarks and tests."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phys4dgen.mpm import Body, LawId

__all__ = ["STRONG", "body", "clamped", "lattice"]

STRONG: dict[str, float] = {
    "yield_stress_pa": 1e9,
    "friction_angle_deg": 40.0,
    "cohesion_pa": 1e9,
    "critical_compression": 0.2,
    "critical_stretch": 0.2,
    "hardening_coefficient": 10.0,
    "viscosity_pas": 0.0,
    "consistency_pasn": 1.0,
    "flow_exponent": 1.0,
}
"""Law numbers with which every solid law is elastic in small strains."""


def lattice(counts: tuple[int, int, int], spacing: float, corner: ArrayLike = (0.0, 0.0, 0.0)) -> NDArray[np.float64]:
    """Particles at the centres of counts[0] x counts[1] x counts[2] cells of side ``spacing``, [P, 3]."""
    axes = [(np.arange(n) + 0.5) * spacing for n in counts]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3) + np.asarray(corner, float)


def body(
    positions: NDArray[np.float64],
    volume: ArrayLike,
    *,
    E: ArrayLike = 1e5,
    rho: ArrayLike = 1000.0,
    nu: ArrayLike = 0.3,
    law: ArrayLike = LawId.NEO_HOOKEAN,
    part: ArrayLike = 0,
    held: ArrayLike = False,
    v: NDArray[np.float64] | None = None,
    names: tuple[str, ...] | None = None,
    **numbers: ArrayLike,
) -> Body:
    """A body of particles [P, 3] from arrays or numbers; ``numbers`` are those of the laws (``types.LAW_NUMBERS``)."""
    p = len(positions)

    def full(value: ArrayLike, dtype: Any) -> NDArray[Any]:
        return np.broadcast_to(np.asarray(value, dtype), (p,)).copy()

    parts = full(part, np.int32)
    return Body(
        positions_m=positions,
        volume_m3=full(volume, float),
        density_kgm3=full(rho, float),
        youngs_modulus_pa=full(E, float),
        poisson_ratio=full(nu, float),
        law=full(law, np.int32),
        part=parts,
        held=full(held, bool),
        part_names=names or tuple(f"part_{g}" for g in range(parts.max() + 1)),
        velocities_ms=v,
        law_numbers={name: full(value, float) for name, value in numbers.items()},
    )


def clamped(
    free: NDArray[np.float64], held: NDArray[np.float64], dx: float, *, axis: int = 2
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Particles that are clamped where ``axis`` is 0, and which are held.

    The grid's nodes follow the lowest corner of a body, so a crumb below puts a node 0.05 dx inside the clamp: the wall
    of a clamp is where its nodes end.
    """
    crumb = np.minimum(free.min(0), held.min(0))
    crumb[axis] = -8.05 * dx
    x = np.concatenate([free, held, crumb[None]])
    return x, np.arange(len(x)) >= len(free)
