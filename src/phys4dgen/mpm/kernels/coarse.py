"""Stiffness of smooth motions: what particles add to it, block by block."""

from __future__ import annotations

import numpy as np

from phys4dgen.mpm.kernels.layout import strict_kernel

__all__ = ["add_stiffness"]


@strict_kernel
def add_stiffness(lowest, offsets, moduli, inverse_dx, first_spline, spline_weights, is_free, size, number_of, blocks):
    """Add K_ab = sum V (lam g_a g_b^T + mu g_b g_a^T + mu (g_a . g_b) I), g the gradients of the splines a and b.

    A spline is what its values at the free nodes of the fine grid interpolate to.

    Args:
        lowest: field and lowest fine node of each particle, int64 [K, 4].
        offsets: of each from its central node, in cells, [K, 3].
        moduli: lambda and mu times volume, [2, K].
        inverse_dx: 1/m.
        first_spline: first spline along each axis that reaches a fine node, int64 [3, nodes].
        spline_weights: of that and the next two, [3, nodes, 3].
        is_free: of the fine nodes, bool [fields, nx, ny, nz].
        size: splines along x, y, z, int64 [3].
        number_of: row of ``blocks`` of each spline, flat, int64.
        blocks: result, added to, between each spline and the 343 around it, [n, 343, 3, 3].
    """
    gradients = np.zeros((4, 4, 4, 3))
    w, arm = np.zeros((3, 3)), np.zeros((3, 3))
    for p in range(len(lowest)):
        lam, mu = moduli[0, p], moduli[1, p]
        if not mu > 0:
            continue
        field, x, y, z = lowest[p]
        for axis in range(3):
            offset = offsets[p, axis]
            w[axis, 0] = 0.5 * (0.5 - offset) ** 2
            w[axis, 1] = 0.75 - offset**2
            w[axis, 2] = 0.5 * (0.5 + offset) ** 2
            for node in range(3):
                arm[axis, node] = 4 * inverse_dx * (node - 1 - offset)
        first_x, first_y, first_z = first_spline[0, x], first_spline[1, y], first_spline[2, z]
        gradients[:] = 0
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    if not is_free[field, x + i, y + j, z + k]:
                        continue
                    share = w[0, i] * w[1, j] * w[2, k]
                    gx, gy, gz = share * arm[0, i], share * arm[1, j], share * arm[2, k]
                    from_x = first_spline[0, x + i] - first_x
                    from_y = first_spline[1, y + j] - first_y
                    from_z = first_spline[2, z + k] - first_z
                    for a in range(3):
                        for b in range(3):
                            both = spline_weights[0, x + i, a] * spline_weights[1, y + j, b]
                            for c in range(3):
                                value = both * spline_weights[2, z + k, c]
                                gradients[from_x + a, from_y + b, from_z + c, 0] += value * gx
                                gradients[from_x + a, from_y + b, from_z + c, 1] += value * gy
                                gradients[from_x + a, from_y + b, from_z + c, 2] += value * gz
        for a in range(64):
            ax, ay, az = a // 16, a // 4 % 4, a % 4
            ga = gradients[ax, ay, az]
            if ga[0] == 0 and ga[1] == 0 and ga[2] == 0:
                continue
            row = number_of[((field * size[0] + first_x + ax) * size[1] + first_y + ay) * size[2] + first_z + az]
            for b in range(64):
                bx, by, bz = b // 16, b // 4 % 4, b % 4
                gb = gradients[bx, by, bz]
                dot = ga[0] * gb[0] + ga[1] * gb[1] + ga[2] * gb[2]
                if gb[0] == 0 and gb[1] == 0 and gb[2] == 0:
                    continue
                block = blocks[row, ((bx - ax + 3) * 7 + by - ay + 3) * 7 + bz - az + 3]
                for i in range(3):
                    block[i, i] += mu * dot
                    for j in range(3):
                        block[i, j] += lam * ga[i] * gb[j] + mu * ga[j] * gb[i]
