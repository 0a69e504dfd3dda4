"""Rigid parts: from particle velocities to the rigid motion with the same momenta, and back.

A rigid group has no stress. After its particles have read velocity v and gradient C from the grid, they get those of
the rigid motion with the same linear momentum P and the same angular momentum L about the group's centre,

    P = sum m v,   L = sum m (r x v + dx^2/4 axial(C)),   I = sum m (|r|^2 1 - r r^T) + M dx^2/2 1,

where the terms in dx belong to the affine velocity fields of APIC. Sums, centre and rotation are float64 and particles
are placed at centre + R r_rest, so that the shape never drifts. The rotation is advanced by the midpoint rule and the
spin taken anew from L, which keeps L exactly and the energy of a tumbling body to second order.

Soft particles share nodes with rigid ones and see the grid before this projection, where nothing passes a force
through the group: a rigid weight would creep into what carries it. So each particle keeps a constraint velocity, the
sum of what its gathered velocity lacked to the rigid motion closest to all of them; scattered with the rigid motion it
acts on the grid as the stress of a rigid body does. It has neither momentum nor angular momentum.

Contact with the ground acts on the vertices of the group's convex hull: sequential impulses with Coulomb friction
(E. Catto, *Iterative dynamics with temporal coherence*, 2005), speculative, so that nothing sinks in.
"""

from __future__ import annotations

import math

import numpy as np

from phys4dgen.mpm.kernels.contact import SLIP, STICKY
from phys4dgen.mpm.kernels.layout import (
    AFFINE,
    DISPLACEMENT_GRADIENT,
    GRADIENT_REST,
    INDEX,
    MASS,
    POSITION,
    POSITION_REST,
    VELOCITY,
    strict_kernel,
)

__all__ = [
    "CENTRE",
    "FITTED_SPIN",
    "FITTED_VELOCITY",
    "LAST_ROTATION",
    "MOTION_COUNT",
    "ROTATION",
    "SPIN",
    "SUM_COUNT",
    "VELOCITY_OF_CENTRE",
    "move_rigid",
    "place_rigid",
    "sum_rigid",
]

CENTRE = 0  # 3 columns of a group's motion, m from the origin
VELOCITY_OF_CENTRE = 3  # 3 columns, m/s
SPIN = 6  # 3 columns, rad/s
ROTATION = 9  # 9 columns, row by row
FITTED_VELOCITY = 18  # 3 columns, m/s, and
FITTED_SPIN = 21  # 3 columns, rad/s: the rigid motion closest to the velocities gathered last, without C
LAST_ROTATION = 24  # 9 columns: the rotation when they were gathered
MOTION_COUNT = 33
SUM_COUNT = 9  # P of a group, the share of L in the velocities, that in C

_SWEEPS = 40  # of sequential impulses over the contact points
_PUSH_OUT = 0.2  # share of a penetration that is undone per substep


@strict_kernel
def _three(values, at):
    return values[at], values[at + 1], values[at + 2]


@strict_kernel
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@strict_kernel
def _rotated(motion, at, x):
    """The rotation in columns ``at`` of a group's motion, times a vector."""
    return (
        motion[at] * x[0] + motion[at + 1] * x[1] + motion[at + 2] * x[2],
        motion[at + 3] * x[0] + motion[at + 4] * x[1] + motion[at + 5] * x[2],
        motion[at + 6] * x[0] + motion[at + 7] * x[1] + motion[at + 8] * x[2],
    )


@strict_kernel
def sum_rigid(particles, first, last, group_of, offsets, motion, dx, sums):
    """Add the momenta of particles [first, last), about the centres before the substep, to ``sums``.

    Args:
        particles: columns of ``layout``, float32 [COLUMN_COUNT, stride], after a pass that gathered.
        first: first particle.
        last: one past the last.
        group_of: group of each particle of the body, int32 [P].
        offsets: rest positions from the group's centre, m, float64 [P, 3].
        motion: centre, velocity, spin and rotation of each group before the substep, float64 [groups, MOTION_COUNT].
        dx: cell side, m.
        sums: P and the two shares of L of each group, float64 [groups, SUM_COUNT].
    """
    index = particles[INDEX].view(np.int32)
    for p in range(first, last):
        body_index = index[p]
        if body_index < 0:
            continue
        g = group_of[body_index]
        m = np.float64(particles[MASS, p])
        rx, ry, rz = _rotated(
            motion[g], ROTATION, (offsets[body_index, 0], offsets[body_index, 1], offsets[body_index, 2])
        )
        vx, vy, vz = (
            np.float64(particles[VELOCITY, p]),
            np.float64(particles[VELOCITY + 1, p]),
            np.float64(particles[VELOCITY + 2, p]),
        )
        affine = np.float64(dx) * np.float64(dx) / 4
        ax = np.float64(particles[AFFINE + 7, p]) - np.float64(particles[AFFINE + 5, p])
        ay = np.float64(particles[AFFINE + 2, p]) - np.float64(particles[AFFINE + 6, p])
        az = np.float64(particles[AFFINE + 3, p]) - np.float64(particles[AFFINE + 1, p])
        sums[g, 0] += m * vx
        sums[g, 1] += m * vy
        sums[g, 2] += m * vz
        sums[g, 3] += m * (ry * vz - rz * vy)
        sums[g, 4] += m * (rz * vx - rx * vz)
        sums[g, 5] += m * (rx * vy - ry * vx)
        sums[g, 6] += m * affine * ax
        sums[g, 7] += m * affine * ay
        sums[g, 8] += m * affine * az


@strict_kernel
def place_rigid(particles, first, last, group_of, offsets, motion, constraint):
    """Put particles [first, last), padding too, where their group's motion has them.

    Args:
        particles: as ``sum_rigid``; velocities as gathered on entry, those to scatter on return.
        first: as ``sum_rigid``.
        last: as ``sum_rigid``.
        group_of: as ``sum_rigid``.
        offsets: as ``sum_rigid``.
        motion: motion of each group after the substep, float64 [groups, MOTION_COUNT].
        constraint: velocities that keep the grid rigid, in the frame of the group at rest, m/s, float32 [P, 3];
            updated.
    """
    index = particles[INDEX].view(np.int32)
    for p in range(first, last):
        body_index = index[p]
        is_real = body_index >= 0
        if not is_real:
            body_index = ~body_index
        to = motion[group_of[body_index]]
        X = (offsets[body_index, 0], offsets[body_index, 1], offsets[body_index, 2])
        if is_real:
            r = _rotated(to, LAST_ROTATION, X)
            turned = _cross(_three(to, FITTED_SPIN), r)
            missing = (
                to[FITTED_VELOCITY] + turned[0] - particles[VELOCITY, p],
                to[FITTED_VELOCITY + 1] + turned[1] - particles[VELOCITY + 1, p],
                to[FITTED_VELOCITY + 2] + turned[2] - particles[VELOCITY + 2, p],
            )
            for k in range(3):
                constraint[body_index, k] += (
                    to[LAST_ROTATION + k] * missing[0]
                    + to[LAST_ROTATION + 3 + k] * missing[1]
                    + to[LAST_ROTATION + 6 + k] * missing[2]
                )
        inner = (
            np.float64(constraint[body_index, 0]),
            np.float64(constraint[body_index, 1]),
            np.float64(constraint[body_index, 2]),
        )
        held = _rotated(to, ROTATION, inner)
        r = _rotated(to, ROTATION, X)
        wx, wy, wz = _three(to, SPIN)
        turned = _cross((wx, wy, wz), r)
        for axis in range(3):
            place = to[CENTRE + axis] + r[axis]
            rounded = np.float32(place)
            particles[POSITION + axis, p] = rounded
            particles[POSITION_REST + axis, p] = place - rounded
            particles[VELOCITY + axis, p] = to[VELOCITY_OF_CENTRE + axis] + turned[axis] + held[axis]
        gradient = (0.0, -wz, wy, wz, 0.0, -wx, -wy, wx, 0.0)
        for k in range(9):
            identity = 1.0 if k % 4 == 0 else 0.0
            particles[AFFINE + k, p] = gradient[k]
            particles[DISPLACEMENT_GRADIENT + k, p] = to[ROTATION + k] - identity
            particles[GRADIENT_REST + k, p] = 0


@strict_kernel
def _turn(rotation, wx, wy, wz, result):
    """``result`` = exp([w]x) ``rotation``, re-orthonormalised; w in radians, both [9]."""
    angle = math.sqrt(wx * wx + wy * wy + wz * wz)
    s = math.sin(angle) / angle if angle > 1e-12 else 1.0
    half = math.sin(angle / 2) / (angle / 2) if angle > 1e-12 else 1.0
    k = half * half / 2
    cosine = math.cos(angle)
    e = (
        cosine + k * wx * wx, k * wx * wy - s * wz, k * wx * wz + s * wy,
        k * wx * wy + s * wz, cosine + k * wy * wy, k * wy * wz - s * wx,
        k * wx * wz - s * wy, k * wy * wz + s * wx, cosine + k * wz * wz,
    )  # fmt: skip
    for i in range(3):
        for j in range(3):
            result[3 * i + j] = e[3 * i] * rotation[j] + e[3 * i + 1] * rotation[3 + j] + e[3 * i + 2] * rotation[6 + j]
    # rows: unit first row, second made orthogonal to it, third their cross product
    a, b, c = result[0], result[1], result[2]
    n = 1 / math.sqrt(a * a + b * b + c * c)
    a, b, c = a * n, b * n, c * n
    along = a * result[3] + b * result[4] + c * result[5]
    d, f, h = result[3] - along * a, result[4] - along * b, result[5] - along * c
    n = 1 / math.sqrt(d * d + f * f + h * h)
    d, f, h = d * n, f * n, h * n
    result[0], result[1], result[2] = a, b, c
    result[3], result[4], result[5] = d, f, h
    result[6], result[7], result[8] = b * h - c * f, c * d - a * h, a * f - b * d


@strict_kernel
def _world_inverse_inertia(rotation, inverse_inertia, result):
    """``result`` = R I^-1 R^T, float64 [3, 3]."""
    for i in range(3):
        for j in range(3):
            total = 0.0
            for k in range(3):
                for m in range(3):
                    total += rotation[3 * i + k] * inverse_inertia[k, m] * rotation[3 * j + m]
            result[i, j] = total


@strict_kernel
def _times(matrix, x, y, z):
    return (
        matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z,
        matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z,
        matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z,
    )


@strict_kernel
def _strike_ground(motion, rotation, v, momentum, mass, W, points, radii, impulses, ground, resting_ms, dt):
    """Impulses of the ground on one group; changes its velocity ``v`` [3] and angular momentum ``momentum`` [3].

    Per contact point the normal velocity after the substep must not carry the point below the ground; the friction of
    each point stays in the Coulomb cone of its normal impulse. Both are found by sweeping over the points, starting
    from the impulses of the last substep.
    """
    height, kind, friction, restitution = ground
    count = len(points)
    arms = np.zeros((count, 3))
    wanted = np.zeros(count)
    near = np.zeros(count, np.int64)
    touching = 0
    spin = _times(W, momentum[0], momentum[1], momentum[2])
    for i in range(count):
        for axis in range(3):
            arms[i, axis] = (
                rotation[3 * axis] * points[i, 0]
                + rotation[3 * axis + 1] * points[i, 1]
                + rotation[3 * axis + 2] * points[i, 2]
            )
        gap = motion[CENTRE + 2] + arms[i, 2] - radii[i] - height
        falling = v[2] + spin[0] * arms[i, 1] - spin[1] * arms[i, 0]
        reach = 4 * resting_ms * dt
        if gap + min(falling, 0.0) * dt > reach:
            impulses[i] = 0
            continue
        arms[i, 2] -= radii[i]  # the point that touches
        wanted[i] = -gap / dt if gap > 0 else min(-_PUSH_OUT * gap / dt, 2 * resting_ms)
        if falling < -2 * resting_ms and gap + falling * dt <= 0:
            wanted[i] = max(wanted[i], -restitution * falling)
        near[touching] = i
        touching += 1
    for n in range(touching):  # start from the last substep's impulses
        i = near[n]
        for axis in range(3):
            v[axis] += impulses[i, axis] / mass
        momentum[0] += arms[i, 1] * impulses[i, 2] - arms[i, 2] * impulses[i, 1]
        momentum[1] += arms[i, 2] * impulses[i, 0] - arms[i, 0] * impulses[i, 2]
        momentum[2] += arms[i, 0] * impulses[i, 1] - arms[i, 1] * impulses[i, 0]
    for _ in range(_SWEEPS if touching > 0 else 0):
        for n in range(touching):
            i = near[n]
            rx, ry, rz = arms[i, 0], arms[i, 1], arms[i, 2]
            for turn in range(3):
                axis = 2 - turn  # the normal first, then y and x
                ex, ey, ez = 1.0 * (axis == 0), 1.0 * (axis == 1), 1.0 * (axis == 2)
                tx, ty, tz = ry * ez - rz * ey, rz * ex - rx * ez, rx * ey - ry * ex
                ux, uy, uz = _times(W, tx, ty, tz)
                compliance = 1 / mass + tx * ux + ty * uy + tz * uz
                wx, wy, wz = _times(W, momentum[0], momentum[1], momentum[2])
                velocity = v[axis] + wx * tx + wy * ty + wz * tz
                before = impulses[i, axis]
                if axis == 2:
                    after = before + (wanted[i] - velocity) / compliance
                    if kind != SLIP and kind != STICKY:
                        after = max(after, 0.0)
                else:
                    after = before - velocity / compliance
                    if kind != STICKY:
                        other = impulses[i, 1 - axis]
                        limit = 0.0 if kind == SLIP else friction * impulses[i, 2]
                        allowed = math.sqrt(max(limit * limit - other * other, 0.0))
                        after = min(max(after, -allowed), allowed)
                step = after - before
                impulses[i, axis] = after
                v[axis] += step / mass
                momentum[0] += step * tx
                momentum[1] += step * ty
                momentum[2] += step * tz


@strict_kernel
def move_rigid(
    motion, sums, mass, inverse_inertia, inverse_point_inertia, points, radii, starts, impulses, ground, resting_ms, dt
):
    """Advance every group by one substep.

    Args:
        motion: motion of each group, float64 [groups, MOTION_COUNT]; advanced.
        sums: P and the two shares of L of each group by chunk, float64 [chunks, groups, SUM_COUNT].
        mass: of each group, in mean particle masses, float64 [groups].
        inverse_inertia: I^-1 at rest, float64 [groups, 3, 3].
        inverse_point_inertia: the same without the term of the affine velocities.
        points: contact points of all groups at rest, from the group's centre, m, float64 [K, 3].
        radii: how far material reaches beyond each contact point, m, float64 [K].
        starts: first contact point of each group, int64 [groups + 1].
        impulses: of the ground on each contact point in the last substep, float64 [K, 3]; updated.
        ground: (height in m from the origin, kind or -1, friction, restitution).
        resting_ms: velocity that loads add in a substep; slower impacts do not bounce.
        dt: substep, s.
    """
    W = np.zeros((3, 3))
    half = np.zeros(9)
    v = np.zeros(3)
    momentum = np.zeros(3)
    for g in range(len(motion)):
        v[:] = 0
        momentum[:] = 0
        for chunk in range(len(sums)):
            for axis in range(3):
                v[axis] += sums[chunk, g, axis] / mass[g]
                momentum[axis] += sums[chunk, g, 3 + axis]
        rotation = motion[g, ROTATION : ROTATION + 9]
        motion[g, LAST_ROTATION : LAST_ROTATION + 9] = rotation
        _world_inverse_inertia(rotation, inverse_point_inertia[g], W)
        spin = _times(W, momentum[0], momentum[1], momentum[2])
        for axis in range(3):
            motion[g, FITTED_VELOCITY + axis] = v[axis]
            motion[g, FITTED_SPIN + axis] = spin[axis]
            for chunk in range(len(sums)):
                momentum[axis] += sums[chunk, g, 6 + axis]
        _world_inverse_inertia(rotation, inverse_inertia[g], W)
        if ground[1] >= 0:
            mine = slice(starts[g], starts[g + 1])
            _strike_ground(
                motion[g], rotation, v, momentum, mass[g], W, points[mine], radii[mine], impulses[mine], ground,
                resting_ms, dt,
            )  # fmt: skip
        wx, wy, wz = _times(W, momentum[0], momentum[1], momentum[2])
        _turn(rotation, wx * dt / 2, wy * dt / 2, wz * dt / 2, half)
        _world_inverse_inertia(half, inverse_inertia[g], W)
        wx, wy, wz = _times(W, momentum[0], momentum[1], momentum[2])
        _turn(rotation.copy(), wx * dt, wy * dt, wz * dt, rotation)
        _world_inverse_inertia(rotation, inverse_inertia[g], W)
        spin = _times(W, momentum[0], momentum[1], momentum[2])
        for axis in range(3):
            motion[g, CENTRE + axis] += dt * v[axis]
            motion[g, VELOCITY_OF_CENTRE + axis] = v[axis]
            motion[g, SPIN + axis] = spin[axis]
