"""Contact conditions at grid nodes: what the ground and held parts allow the velocity there to be."""

from __future__ import annotations

import math

from phys4dgen.mpm.kernels.layout import kernel

__all__ = ["SEPARATE", "SLIP", "STICKY", "allowed_velocity"]

SEPARATE = 0  # no motion into the surface; Coulomb friction on what slides along it; free to leave
SLIP = 1  # no motion into the surface or away from it, no friction
STICKY = 2  # no motion at all


@kernel
def allowed_velocity(vx, vy, vz, kind, plane):
    """Velocity of a node after contact.

    Args:
        vx: velocity before, along x,
        vy: y,
        vz: and z.
        kind: SEPARATE, SLIP or STICKY.
        plane: outward unit normal and friction coefficient, float32 [4].
    """
    zero = vx * 0
    if kind == STICKY:
        return zero, zero, zero
    nx, ny, nz = plane[0], plane[1], plane[2]
    outwards = vx * nx + vy * ny + vz * nz
    if kind == SEPARATE and outwards >= 0:
        return vx, vy, vz
    tx, ty, tz = vx - outwards * nx, vy - outwards * ny, vz - outwards * nz
    if kind == SEPARATE:
        sliding = math.sqrt(tx * tx + ty * ty + tz * tz)
        lost = -plane[3] * outwards
        keep = zero if sliding <= lost else 1 - lost / sliding
        tx, ty, tz = tx * keep, ty * keep, tz * keep
    return tx, ty, tz
