"""Grid momentum to grid velocity: sum the private grids, divide by mass, accelerate, damp, hold, meet obstacles.

One plane of constant x per call; planes are independent, so they run on all threads. Bodies that must not weld have
velocity fields of their own: copies of the grid, one behind the other along x, which meet at the nodes that they share.
"""

from __future__ import annotations

import math

import numpy as np
from numba.core import types

from phys4dgen.mpm.kernels.by_address import FLOATS, address_of, caller_of
from phys4dgen.mpm.kernels.contact import allowed_velocity
from phys4dgen.mpm.kernels.layout import inner_kernel
from phys4dgen.mpm.kernels.pair_contact import PAIRS, call_limit_pairs
from phys4dgen.vector.float_state import begin_flush_to_zero, restore_float_state
from phys4dgen.vector.lanes import constant16, maximum, splat16, where
from phys4dgen.vector.memory import load16, store
from phys4dgen.vector.shuffles import group_last, load_group_each

__all__ = ["address_of_grid_plane", "call_grid_plane"]

_f = np.float32
_SMALLEST_MASS = _f(1e-12)  # of the mean particle mass; lighter nodes carry no velocity
_x_lane = constant16([1, 0, 0, 0] * 4)
_y_lane = constant16([0, 1, 0, 0] * 4)
_z_lane = constant16([0, 0, 1, 0] * 4)
_mass_lane = constant16([0, 0, 0, 1] * 4)
_node_in_group = constant16([0] * 4 + [1] * 4 + [2] * 4 + [3] * 4)


@inner_kernel
def _row_span(spans, plane, row):
    """First and one past last node along z of a row that any chunk may have written to; 0, 0 where none."""
    low, high = 0, 0
    for chunk in range(spans.shape[0]):
        first, last = spans[chunk, plane, row, 0], spans[chunk, plane, row, 1]
        if last > first:
            if high == 0 or first < low:
                low = first
            if last > high:
                high = last
    return low, high


@inner_kernel
def _set_velocities(plane, first_plane, spans, momentum, velocity, unblocked, free, grid, dx, gain, damping, rigid):
    """Velocities of one plane of the field that begins with plane ``first_plane``, without contacts."""
    ny, nz = grid[3], grid[4]
    ex, ey, ez, mass_lane = _x_lane(), _y_lane(), _z_lane(), _mass_lane()
    gained = ex * gain[0] + ey * gain[1] + ez * gain[2]
    zero = splat16(_f(0))
    least = splat16(_SMALLEST_MASS)
    # v_rigid = u + omega x (x_node - centre): constant along x and y in a row, linear along z
    wx, wy, wz = rigid[3], rigid[4], rigid[5]
    rx = (plane + grid[0]) * dx - rigid[6]
    per_node = (ex * wy - ey * wx) * dx
    chunks = spans.shape[0]
    own_plane = first_plane + plane
    for row in range(ny):
        low, high = _row_span(spans, own_plane, row)
        if high <= low:
            continue
        ry = (row + grid[1]) * dx - rigid[7]
        rz = (low + grid[2]) * dx - rigid[8]
        row_start = ex * (rigid[0] + wy * rz - wz * ry) + ey * (rigid[1] + wz * rx - wx * rz)
        undamped = row_start + ez * (rigid[2] + wx * ry - wy * rx) + per_node * _node_in_group()
        base = (own_plane * ny + row) * nz
        at_free = (plane * ny + row) * nz
        for column in range(low, high, 4):
            at = (base + column) * 4
            total = zero
            for chunk in range(chunks):
                if spans[chunk, own_plane, row, 0] <= column < spans[chunk, own_plane, row, 1]:
                    total = total + load16(momentum[chunk], at)
                    store(momentum[chunk], at, zero)
            mass = group_last(total)
            v = total / maximum(mass, least)
            v = v + gained
            v = (v - damping * (v - undamped)) * load_group_each(free, at_free + column)
            v = where(mass > least, v, zero)
            v = v + mass_lane * (mass - v)
            store(velocity, at, v)
            if len(unblocked) > 0:
                store(unblocked, at, v)
            undamped = undamped + _f(4) * per_node


@inner_kernel
def _limit(plane, field, nodes_x, spans, velocity, unblocked, contacts, grid, dt):
    """What contacts allow on one plane of a field."""
    starts, nodes, planes, impulses, rubbing = contacts
    ny, nz = grid[3], grid[4]
    for row in range(ny):
        first, last = starts[plane * ny + row], starts[plane * ny + row + 1]
        if first == last:
            continue
        own_plane = field * nodes_x + plane
        low, high = _row_span(spans, own_plane, row)
        base = (own_plane * ny + row) * nz
        for contact in range(first, last):
            column, kind, spares_rigid = nodes[contact, 0], nodes[contact, 1], nodes[contact, 2]
            if low <= column < high and (nodes[contact, 4] < 0 or nodes[contact, 4] == field):
                at = (base + column) * 4
                v0, v1, v2, mass_here = velocity[at], velocity[at + 1], velocity[at + 2], velocity[at + 3]
                friction, drag = rubbing[field, contact, 0], rubbing[field, contact, 1] * dt
                u0, u1, u2 = allowed_velocity(v0, v1, v2, kind, planes[contact], friction, drag)
                velocity[at], velocity[at + 1], velocity[at + 2] = u0, u1, u2
                impulses[field, contact, 0] += mass_here * (u0 - v0)
                impulses[field, contact, 1] += mass_here * (u1 - v1)
                impulses[field, contact, 2] += mass_here * (u2 - v2)
                if spares_rigid == 0 and len(unblocked) > 0:
                    unblocked[at], unblocked[at + 1], unblocked[at + 2] = u0, u1, u2


@inner_kernel
def _grid_plane(
    plane, nodes_x, spans, momentum, velocity, unblocked, free, contacts, limit_pairs, pairs, grid, dx, dt, gains,
    damping, undamped, substep,
):  # fmt: skip
    """Update one plane of nodes of all fields.

    A plant fills little of its box: only the nodes that some chunk may have written to are visited.

    Args:
        plane: node number along x.
        nodes_x: nodes along x of one velocity field; field f begins with plane f nodes_x.
        spans: first and one past last node along z that each chunk may write to, by plane and row; multiples of 4,
            empty where it writes nothing, int32 [chunks, fields nx, ny, 2].
        momentum: private grids [chunks, 4 fields nodes], float32; set to zero again.
        velocity: result (vx, vy, vz, mass) per node, m/s and mean particle masses, flat float32.
        unblocked: the same but for what rigid parts meet by themselves, for them; empty if not needed.
        free: 1 where a node may move, 0 where it is held, per node, float32.
        contacts: nodes where something limits the velocity, in the order of rows (``contacts.contact_arrays``); the
            impulses that it takes are added up.
        limit_pairs: address of ``pair_contact.limit_pairs``; unused where there is one field.
        pairs: nodes where fields meet (``pair_contact.limit_pairs``).
        grid: (shift_x, shift_y, shift_z, ny, nz).
        dx: cell side in metres, float32.
        dt: substep in seconds, float32.
        gains: velocity that all nodes gain in each substep, m/s, [substeps, 3].
        damping: share of the velocity relative to ``undamped`` that is lost in a substep.
        undamped: velocity field that is not damped in each substep: linear velocity, angular velocity, centre (m),
            [substeps, 9].
        substep: which one this is.
    """
    state = begin_flush_to_zero()
    gain, rigid = gains[substep], undamped[substep]
    fields = spans.shape[1] // nodes_x
    for field in range(fields):
        _set_velocities(
            plane, field * nodes_x, spans, momentum, velocity, unblocked, free, grid, dx, gain, damping, rigid
        )
    if fields > 1:
        resting = math.sqrt(gain[0] * gain[0] + gain[1] * gain[1] + gain[2] * gain[2])
        call_limit_pairs(limit_pairs, plane, nodes_x, velocity, unblocked, pairs, grid, resting, dt)
    for field in range(fields):
        _limit(plane, field, nodes_x, spans, velocity, unblocked, contacts, grid, dt)
    restore_float_state(state)


_FLOAT_ROWS = types.Array(types.float32, 2, "C")
_FLOAT_TABLES = types.Array(types.float32, 3, "C")
_CONTACTS = types.Tuple(
    (
        types.Array(types.int32, 1, "C"),
        types.Array(types.int32, 2, "C"),
        _FLOAT_ROWS,
        _FLOAT_TABLES,
        _FLOAT_TABLES,
    )
)
_ARGUMENTS = (
    types.int64,  # plane
    types.int64,  # nodes_x
    types.Array(types.int32, 4, "C"),  # spans
    _FLOAT_ROWS,  # momentum
    FLOATS,  # velocity
    FLOATS,  # unblocked
    FLOATS,  # free
    _CONTACTS,
    types.int64,  # limit_pairs
    PAIRS,
    types.UniTuple(types.int64, 5),  # grid
    types.float32,  # dx
    types.float32,  # dt
    _FLOAT_ROWS,  # gains
    types.float32,  # damping
    _FLOAT_ROWS,  # undamped
    types.int64,  # substep
)

call_grid_plane = caller_of(_ARGUMENTS)
"""Inside kernels: the update of a plane by the function at an address, with its arguments."""


def address_of_grid_plane() -> int:
    """Address of the update of a plane; compiled or taken from Numba's cache at the first call."""
    return address_of(_grid_plane, _ARGUMENTS)
