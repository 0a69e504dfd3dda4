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

Contact with ground and obstacles comes between the two: ``rigid_contact``.
"""

from __future__ import annotations

import numpy as np

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
from phys4dgen.mpm.kernels.rigid_contact import strike
from phys4dgen.mpm.kernels.rigid_motion import (
    CENTRE,
    FITTED_SPIN,
    FITTED_VELOCITY,
    LAST_ROTATION,
    ROTATION,
    SPIN,
    VELOCITY_OF_CENTRE,
    cross,
    rotated,
    three,
    times,
    turn,
    world_inverse_inertia,
)

__all__ = ["clear_sums", "move_rigid", "place_rigid", "sum_rigid"]


@strict_kernel
def clear_sums(sums):
    """Set the sums of one chunk to zero, float64 [groups, SUM_COUNT] (assigning to slices takes long to compile)."""
    for group in range(sums.shape[0]):
        for column in range(sums.shape[1]):
            sums[group, column] = 0.0


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
        rx, ry, rz = rotated(
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
            r = rotated(to, LAST_ROTATION, X)
            turned = cross(three(to, FITTED_SPIN), r)
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
        held = rotated(to, ROTATION, inner)
        r = rotated(to, ROTATION, X)
        wx, wy, wz = three(to, SPIN)
        turned = cross((wx, wy, wz), r)
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
        for axis in range(3):
            v[axis], momentum[axis] = 0.0, 0.0
        for chunk in range(len(sums)):
            for axis in range(3):
                v[axis] += sums[chunk, g, axis] / mass[g]
                momentum[axis] += sums[chunk, g, 3 + axis]
        rotation = motion[g, ROTATION : ROTATION + 9]
        for k in range(9):  # not an assignment of slices, which takes as long to compile as all of this
            motion[g, LAST_ROTATION + k] = rotation[k]
        world_inverse_inertia(rotation, inverse_point_inertia[g], W)
        spin = times(W, momentum[0], momentum[1], momentum[2])
        for axis in range(3):
            motion[g, FITTED_VELOCITY + axis] = v[axis]
            motion[g, FITTED_SPIN + axis] = spin[axis]
            for chunk in range(len(sums)):
                momentum[axis] += sums[chunk, g, 6 + axis]
        world_inverse_inertia(rotation, inverse_inertia[g], W)
        if len(obstacles) > 0:
            mine = slice(starts[g], starts[g + 1])
            strike(
                motion[g], rotation, v, momentum, mass[g], W, points[mine], radii[mine], impulses[:, mine], obstacles,
                reactions, resting_ms, dt,
            )  # fmt: skip
        wx, wy, wz = times(W, momentum[0], momentum[1], momentum[2])
        turn(rotation, wx * dt / 2, wy * dt / 2, wz * dt / 2, half)
        world_inverse_inertia(half, inverse_inertia[g], W)
        wx, wy, wz = times(W, momentum[0], momentum[1], momentum[2])
        turn(motion[g, LAST_ROTATION : LAST_ROTATION + 9], wx * dt, wy * dt, wz * dt, rotation)
        world_inverse_inertia(rotation, inverse_inertia[g], W)
        spin = times(W, momentum[0], momentum[1], momentum[2])
        for axis in range(3):
            motion[g, CENTRE + axis] += dt * v[axis]
            motion[g, VELOCITY_OF_CENTRE + axis] = v[axis]
            motion[g, SPIN + axis] = spin[axis]
    for o in range(len(obstacles)):
        for axis in range(3):
            obstacles[o, 1 + axis] += dt * obstacles[o, 4 + axis]
