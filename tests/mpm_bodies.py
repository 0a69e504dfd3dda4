"""Bodies that the tests of the MPM engine share."""

from __future__ import annotations

import numpy as np

from phys4dgen.mpm import Body, LawId


def lattice(counts, spacing, corner=(0.0, 0.0, 0.0)):
    """Particles at the centres of counts[0] x counts[1] x counts[2] cells of side ``spacing``, [P, 3]."""
    axes = [(np.arange(n) + 0.5) * spacing for n in counts]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3) + np.asarray(corner, float)


def body(
    positions, volume, *, E=1e5, rho=1000.0, nu=0.3, law=LawId.NEO_HOOKEAN, part=0, held=False, v=None, names=None
):
    """A body from arrays or numbers."""
    p = len(positions)

    def full(value, dtype):
        return np.broadcast_to(np.asarray(value, dtype), (p,)).copy()

    part = full(part, np.int32)
    return Body(
        positions_m=positions,
        volume_m3=full(volume, float),
        density_kgm3=full(rho, float),
        youngs_modulus_pa=full(E, float),
        poisson_ratio=full(nu, float),
        law=full(law, np.int32),
        part=part,
        held=full(held, bool),
        part_names=names or tuple(f"part_{g}" for g in range(part.max() + 1)),
        velocities_ms=v,
    )
