"""Contact of rigid groups with ground and obstacles, at the vertices of the group's convex hull.

Sequential impulses with Coulomb friction (E. Catto, *Iterative dynamics with temporal coherence*, 2005), speculative,
so that nothing sinks in.
"""

from __future__ import annotations

import math

import numpy as np

from phys4dgen.mpm.kernels.contact import SLIP, STICKY
from phys4dgen.mpm.kernels.layout import strict_kernel
from phys4dgen.mpm.kernels.rigid_motion import CENTRE, cross, rotated, three, times

__all__ = ["strike"]

_SWEEPS = 40  # of sequential impulses over the contact points
_PUSH_OUT = 0.2  # share of a penetration that is undone per substep
_NEARLY = 1.01
"""A point meets a surface up to so many times its way in a substep ahead: corners of a flat face that rounding alone
tells apart must meet it together, or those that bounce turn the body about the others."""


@strict_kernel
def _surface(obstacle, x, y, z):
    """(distance, normal 3) of the surface of a row of ``obstacles.obstacle_table`` from a point; negative inside."""
    px, py, pz = x - obstacle[1], y - obstacle[2], z - obstacle[3]
    if obstacle[0] == 0:
        nx, ny, nz = obstacle[7], obstacle[8], obstacle[9]
        return px * nx + py * ny + pz * nz, nx, ny, nz
    if obstacle[0] == 2:
        length = max(math.sqrt(px * px + py * py + pz * pz), 1e-12)
        return obstacle[19] - length, -px / length, -py / length, -pz / length
    best, nearest = -1e300, 0
    squared = 0.0
    out = np.zeros(3)
    for axis in range(3):
        local = px * obstacle[7 + axis] + py * obstacle[10 + axis] + pz * obstacle[13 + axis]
        beyond = abs(local) - obstacle[16 + axis]
        if beyond > best:
            best, nearest = beyond, axis
        out[axis] = math.copysign(max(beyond, 0.0), local)
        squared += out[axis] * out[axis]
    length = math.sqrt(squared)
    if length > 1e-12:
        for axis in range(3):
            out[axis] /= length
    else:
        local = px * obstacle[7 + nearest] + py * obstacle[10 + nearest] + pz * obstacle[13 + nearest]
        out[nearest] = math.copysign(1.0, local)
    nx = obstacle[7] * out[0] + obstacle[8] * out[1] + obstacle[9] * out[2]
    ny = obstacle[10] * out[0] + obstacle[11] * out[1] + obstacle[12] * out[2]
    nz = obstacle[13] * out[0] + obstacle[14] * out[1] + obstacle[15] * out[2]
    return length + min(best, 0.0) - obstacle[19], nx, ny, nz


@strict_kernel
def _set_axes(normal, axes):
    """``axes`` [3, 3] = two tangents and the normal; along x and y where the normal is z."""
    along = 0 if abs(normal[0]) < 0.9 else 1
    length = 0.0
    for k in range(3):
        axes[0, k] = (1.0 if k == along else 0.0) - normal[along] * normal[k]
        length += axes[0, k] * axes[0, k]
    for k in range(3):
        axes[0, k] /= math.sqrt(length)
        axes[2, k] = normal[k]
    axes[1, 0], axes[1, 1], axes[1, 2] = cross((normal[0], normal[1], normal[2]), (axes[0, 0], axes[0, 1], axes[0, 2]))


@strict_kernel
def _forget(impulse):
    """Set the three numbers of an impulse to zero (assigning a row takes far longer to compile)."""
    for k in range(3):
        impulse[k] = 0.0


@strict_kernel
def _add_impulse(axis, size, arm, mass, v, momentum):
    """Give a group an impulse of one size along a direction at an arm from its centre."""
    for k in range(3):
        v[k] += size * axis[k] / mass
    tx, ty, tz = cross((arm[0], arm[1], arm[2]), (axis[0], axis[1], axis[2]))
    momentum[0] += size * tx
    momentum[1] += size * ty
    momentum[2] += size * tz


@strict_kernel
def strike(motion, rotation, v, momentum, mass, W, points, radii, impulses, obstacles, reactions, resting_ms, dt):
    """Impulses of obstacles on one group; changes its velocity ``v`` [3] and angular momentum ``momentum`` [3].

    Per contact point the normal velocity after the substep must not carry the point into the obstacle, nor away from
    one that does not let go (SLIP, STICKY) once they touch; the friction of each point stays in the Coulomb cone of its
    normal impulse. Both are found by sweeping over the points, starting from the impulses of the last substep.
    """
    most = len(points) * len(obstacles)
    arms = np.zeros((most, 3))
    axes = np.zeros((most, 3, 3))
    least = np.zeros(most)  # normal velocities allowed after the substep
    greatest = np.zeros(most)
    which = np.zeros((most, 2), np.int64)
    normal = np.zeros(3)
    touching = 0
    spin = times(W, momentum[0], momentum[1], momentum[2])
    reach = 4 * resting_ms * dt
    for i in range(len(points)):
        arm = rotated(rotation, 0, (points[i, 0], points[i, 1], points[i, 2]))
        turned = cross(spin, arm)
        for o in range(len(obstacles)):
            obstacle = obstacles[o]
            if obstacle[20] < 0:
                _forget(impulses[o, i])
                continue
            distance, normal[0], normal[1], normal[2] = _surface(
                obstacle, motion[CENTRE] + arm[0], motion[CENTRE + 1] + arm[1], motion[CENTRE + 2] + arm[2]
            )
            gap = distance - radii[i]
            leaving = 0.0
            for k in range(3):
                leaving += (v[k] + turned[k] - obstacle[4 + k]) * normal[k]
            meeting = max(-leaving, 0.0) * dt * _NEARLY
            if gap > meeting + reach:
                _forget(impulses[o, i])
                continue
            for k in range(3):
                arms[touching, k] = arm[k] - radii[i] * normal[k]  # the point that touches
            _set_axes(normal, axes[touching])
            least[touching] = -gap / dt if gap > 0 else min(-_PUSH_OUT * gap / dt, 2 * resting_ms)
            lets_go = obstacle[20] != SLIP and obstacle[20] != STICKY
            if lets_go and leaving < -2 * resting_ms and gap <= meeting and obstacle[22] > 0:
                least[touching] = max(least[touching], -obstacle[22] * leaving)
            greatest[touching] = math.inf if lets_go or gap > reach else max(least[touching], 0.0)
            which[touching, 0], which[touching, 1] = o, i
            touching += 1
    for n in range(touching):  # start from the last substep's impulses
        before = impulses[which[n, 0], which[n, 1]]
        for axis in range(3):
            _add_impulse(axes[n, axis], before[axis], arms[n], mass, v, momentum)
    for _ in range(_SWEEPS if touching > 0 else 0):
        for n in range(touching):
            obstacle, impulse = obstacles[which[n, 0]], impulses[which[n, 0], which[n, 1]]
            kind = obstacle[20]
            arm = three(arms[n], 0)
            for turn in range(3):
                axis = 2 - turn  # the normal first, then the tangents
                direction = three(axes[n, axis], 0)
                t = cross(arm, direction)
                u = times(W, t[0], t[1], t[2])
                compliance = 1 / mass + t[0] * u[0] + t[1] * u[1] + t[2] * u[2]
                w = times(W, momentum[0], momentum[1], momentum[2])
                velocity = w[0] * t[0] + w[1] * t[1] + w[2] * t[2]
                for k in range(3):
                    velocity += (v[k] - obstacle[4 + k]) * direction[k]
                before = impulse[axis]
                if axis == 2:
                    after = before + (least[n] - velocity) / compliance
                    if after < 0:  # nothing needs to be pushed, but perhaps kept
                        after = min(before + (greatest[n] - velocity) / compliance, 0.0)
                else:
                    after = before - velocity / compliance
                    if kind != STICKY:
                        other = impulse[1 - axis]
                        limit = 0.0 if kind == SLIP else obstacle[21] * impulse[2]
                        allowed = math.sqrt(max(limit * limit - other * other, 0.0))
                        after = min(max(after, -allowed), allowed)
                impulse[axis] = after
                _add_impulse(axes[n, axis], after - before, arms[n], mass, v, momentum)
    for n in range(touching):
        for axis in range(3):
            for k in range(3):
                reactions[which[n, 0], k] += impulses[which[n, 0], which[n, 1], axis] * axes[n, axis, k]
