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

Contact with ground and obstacles acts on the vertices of the group's convex hull: sequential impulses with Coulomb
friction (E. Catto, *Iterative dynamics with temporal coherence*, 2005), speculative, so that nothing sinks in.
"""

from __future__ import annotations

import math

import numpy as np

from phys4dgen.mpm.kernels.contact import SLIP, STICKY
from phys4dgen.mpm.kernels.layout import (
    AFFINE,
    DISPLACEMENT_GRADIENT,
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
    axes[1, 0], axes[1, 1], axes[1, 2] = _cross((normal[0], normal[1], normal[2]), (axes[0, 0], axes[0, 1], axes[0, 2]))


@strict_kernel
def _add_impulse(axis, size, arm, mass, v, momentum):
    """Give a group an impulse of one size along a direction at an arm from its centre."""
    for k in range(3):
        v[k] += size * axis[k] / mass
    tx, ty, tz = _cross((arm[0], arm[1], arm[2]), (axis[0], axis[1], axis[2]))
    momentum[0] += size * tx
    momentum[1] += size * ty
    momentum[2] += size * tz


@strict_kernel
def _strike(motion, rotation, v, momentum, mass, W, points, radii, impulses, obstacles, reactions, resting_ms, dt):
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
    spin = _times(W, momentum[0], momentum[1], momentum[2])
    reach = 4 * resting_ms * dt
    for i in range(len(points)):
        arm = _rotated(rotation, 0, (points[i, 0], points[i, 1], points[i, 2]))
        turned = _cross(spin, arm)
        for o in range(len(obstacles)):
            obstacle = obstacles[o]
            if obstacle[20] < 0:
                impulses[o, i] = 0
                continue
            distance, normal[0], normal[1], normal[2] = _surface(
                obstacle, motion[CENTRE] + arm[0], motion[CENTRE + 1] + arm[1], motion[CENTRE + 2] + arm[2]
            )
            gap = distance - radii[i]
            leaving = 0.0
            for k in range(3):
                leaving += (v[k] + turned[k] - obstacle[4 + k]) * normal[k]
            if gap + min(leaving, 0.0) * dt > reach:
                impulses[o, i] = 0
                continue
            for k in range(3):
                arms[touching, k] = arm[k] - radii[i] * normal[k]  # the point that touches
            _set_axes(normal, axes[touching])
            least[touching] = -gap / dt if gap > 0 else min(-_PUSH_OUT * gap / dt, 2 * resting_ms)
            lets_go = obstacle[20] != SLIP and obstacle[20] != STICKY
            if lets_go and leaving < -2 * resting_ms and gap + leaving * dt <= 0:
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
            arm = _three(arms[n], 0)
            for turn in range(3):
                axis = 2 - turn  # the normal first, then the tangents
                direction = _three(axes[n, axis], 0)
                t = _cross(arm, direction)
                u = _times(W, t[0], t[1], t[2])
                compliance = 1 / mass + t[0] * u[0] + t[1] * u[1] + t[2] * u[2]
                w = _times(W, momentum[0], momentum[1], momentum[2])
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


@strict_kernel
def move_rigid(
    motion, sums, mass, inverse_inertia, inverse_point_inertia, points, radii, starts, impulses, reactions, obstacles,
    resting_ms, dt,
):  # fmt: skip
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
        impulses: of each obstacle on each contact point in the last substep, along two tangents and the normal, float64
            [O, K, 3]; updated.
        reactions: impulses of each obstacle on all groups, float64 [O, 3]; added to.
        obstacles: ``obstacles.obstacle_table``; moved by one substep.
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
        if len(obstacles) > 0:
            mine = slice(starts[g], starts[g + 1])
            _strike(
                motion[g], rotation, v, momentum, mass[g], W, points[mine], radii[mine], impulses[:, mine], obstacles,
                reactions, resting_ms, dt,
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
    for o in range(len(obstacles)):
        for axis in range(3):
            obstacles[o, 1 + axis] += dt * obstacles[o, 4 + axis]
