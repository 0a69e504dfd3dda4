"""Stiffness of smooth motions: what particles add to it, block by block."""

from __future__ import annotations

import numpy as np

from phys4dgen.mpm.kernels.layout import strict_kernel

__all__ = ["add_stiffness"]


@strict_kernel
def add_stiffness(
    copies, lowest, offsets, moduli, inverse_dx, first_spline, spline_weights, is_free, number_of, blocks
):
    """Add K_ab = sum V (lam g_a g_b^T + mu g_b g_a^T + mu (g_a . g_b) I), g the gradients of the splines a and b.

    A spline is what its values at the free nodes of the fine grid interpolate to.

    Args:
        copies: the 27 fine nodes (copies of them, see ``strands``) around each particle, int32 [K, 27].
        lowest: where the lowest of them stands, int64 [K, 3].
        offsets: of each particle from its central node, in cells, [K, 3].
        moduli: lambda and mu times volume, [K, 2].
        inverse_dx: 1/m.
        first_spline: first spline along each axis that reaches a fine node, int64 [3, nodes].
        spline_weights: of that and the next two, [3, nodes, 3].
        is_free: of the n fine nodes, bool [n].
        number_of: number of the 27 splines that reach each fine node, int32 [n, 27].
        blocks: result, added to, [m, m, 3, 3].
    """
    gradients, number = np.zeros((64, 3)), np.zeros(64, np.int32)
    w, arm = np.zeros((3, 3)), np.zeros((3, 3))
    for p in range(len(copies)):
        lam, mu = moduli[p, 0], moduli[p, 1]
        if not mu > 0:
            continue
        for axis in range(3):
            offset = offsets[p, axis]
            w[axis, 0] = 0.5 * (0.5 - offset) ** 2
            w[axis, 1] = 0.75 - offset**2
            w[axis, 2] = 0.5 * (0.5 + offset) ** 2
            for node in range(3):
                arm[axis, node] = 4 * inverse_dx * (node - 1 - offset)
        x, y, z = lowest[p]
        gradients[:] = 0
        for node in range(27):
            at = copies[p, node]
            if not is_free[at]:
                continue
            i, j, k = node // 9, node // 3 % 3, node % 3
            share = w[0, i] * w[1, j] * w[2, k]
            gx, gy, gz = share * arm[0, i], share * arm[1, j], share * arm[2, k]
            from_x = first_spline[0, x + i] - first_spline[0, x]
            from_y = first_spline[1, y + j] - first_spline[1, y]
            from_z = first_spline[2, z + k] - first_spline[2, z]
            for a in range(3):
                for b in range(3):
                    both = spline_weights[0, x + i, a] * spline_weights[1, y + j, b]
                    for c in range(3):
                        value = both * spline_weights[2, z + k, c]
                        local = ((from_x + a) * 4 + from_y + b) * 4 + from_z + c
                        number[local] = number_of[at, 9 * a + 3 * b + c]
                        gradients[local, 0] += value * gx
                        gradients[local, 1] += value * gy
                        gradients[local, 2] += value * gz
        for a in range(64):
            ga = gradients[a]
            if ga[0] == 0 and ga[1] == 0 and ga[2] == 0:
                continue
            for b in range(64):
                gb = gradients[b]
                if gb[0] == 0 and gb[1] == 0 and gb[2] == 0:
                    continue
                dot = ga[0] * gb[0] + ga[1] * gb[1] + ga[2] * gb[2]
                block = blocks[number[a], number[b]]
                for i in range(3):
                    block[i, i] += mu * dot
                    for j in range(3):
                        block[i, j] += lam * ga[i] * gb[j] + mu * ga[j] * gb[i]
