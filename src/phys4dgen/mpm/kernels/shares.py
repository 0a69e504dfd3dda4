"""How much mass particles bring to each node, and the sums of what they carry."""

from __future__ import annotations

import numpy as np

from phys4dgen.mpm.kernels.layout import MASS, POSITION, strict_kernel

__all__ = ["node_masses"]


@strict_kernel
def node_masses(particles, values, inverse_dx, shift, total, weighted):
    """Add the particles' masses to the nodes around them, with quadratic B-spline weights.

    Args:
        particles: columns of ``layout``, float32 [columns, stride].
        values: what each particle carries per mass, 1 where it is to be counted, float32 [stride].
        inverse_dx: cells per metre, float32.
        shift: world node of the grid's first node, int64 [3].
        total: result, added to, float32 [nx, ny, nz].
        weighted: as ``total``, masses times values.
    """
    weights = np.zeros((3, 3), np.float32)
    node = np.zeros(3, np.int64)
    half = np.float32(0.5)
    for p in range(particles.shape[1]):
        mass = particles[MASS, p]
        if not mass > 0:
            continue
        inside = True
        for axis in range(3):
            place = particles[POSITION + axis, p] * inverse_dx
            below = np.floor(place - half)
            offset = place - below - np.float32(1)
            weights[axis, 0] = half * (half - offset) * (half - offset)
            weights[axis, 1] = np.float32(0.75) - offset * offset
            weights[axis, 2] = half * (half + offset) * (half + offset)
            node[axis] = int(below) - shift[axis]
            inside = inside and 0 <= node[axis] < total.shape[axis] - 2
        if not inside:
            continue
        value = values[p]
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    share = mass * weights[0, i] * weights[1, j] * weights[2, k]
                    total[node[0] + i, node[1] + j, node[2] + k] += share
                    weighted[node[0] + i, node[1] + j, node[2] + k] += share * value
