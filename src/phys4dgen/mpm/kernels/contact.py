"""Contact conditions at grid nodes: what ground, obstacles, held and driven parts allow the velocity there to be."""

from __future__ import annotations

import math

from phys4dgen.mpm.kernels.layout import inner_kernel

__all__ = ["SEPARATE", "SLIP", "STICKY", "allowed_velocity"]

SEPARATE = 0  # no motion into the surface; friction on what slides along it; free to leave
SLIP = 1  # no motion into the surface or away from it, no friction
STICKY = 2  # the motion of the surface


@inner_kernel
def allowed_velocity(vx, vy, vz, kind, plane, friction, drag):
    """Velocity of a node after contact.

    Args:
        vx: velocity before, along x,
        vy: y,
        vz: and z.
        kind: SEPARATE, SLIP or STICKY.
        plane: outward unit normal, an unused number, and velocity of the surface, float32 [7].
        friction: Coulomb's coefficient.
        drag: share of its sliding velocity that viscosity takes in a substep, over the share that is left.
    """
    ux, uy, uz = plane[4], plane[5], plane[6]
    if kind == STICKY:
        return ux, uy, uz
    nx, ny, nz = plane[0], plane[1], plane[2]
    rx, ry, rz = vx - ux, vy - uy, vz - uz
    outwards = rx * nx + ry * ny + rz * nz
    if kind == SEPARATE and outwards >= 0:
        return vx, vy, vz
    tx, ty, tz = rx - outwards * nx, ry - outwards * ny, rz - outwards * nz
    if kind == SEPARATE:
        sliding = math.sqrt(tx * tx + ty * ty + tz * tz)
        lost = -friction * outwards
        keep = vx * 0 if sliding <= lost else (1 - lost / sliding) / (1 + drag)
        tx, ty, tz = tx * keep, ty * keep, tz * keep
    return ux + tx, uy + ty, uz + tz
