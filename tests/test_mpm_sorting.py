"""Between segments: which rows of the grid each chunk may write to."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from phys4dgen.mpm.kernels.sorting import span_rows

NX, NY, NZ = 16, 14, 24


def spans_one_by_one(cells, ranges, fields, shift, chunks):
    """What ``span_rows`` gives, particle by particle: rows that a particle may write to after it drifts by a cell."""
    spans = np.zeros((chunks, fields.max() + NX, NY, 2), np.int32)
    for chunk in range(chunks):
        for law, (first, last) in enumerate(ranges[:, chunk]):
            for x, y, z in (cells[:, first:last] - shift[:, None]).T:
                low, high = (z - 1) // 4 * 4, -(-(z + 5) // 4) * 4
                near = spans[chunk, fields[law] + x - 1 : fields[law] + x + 4, y - 1 : y + 4]
                empty = near[..., 1] == 0
                near[..., 0] = np.where(empty, low, np.minimum(near[..., 0], low))
                near[..., 1] = np.where(empty, high, np.maximum(near[..., 1], high))
    return spans


@st.composite
def sorted_particles(draw):
    """Lowest nodes of the particles of one to three laws in the order of their cells, cut into chunks."""
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    laws, chunks, at = draw(st.integers(1, 3)), draw(st.integers(1, 3)), 0
    shift, columns, ranges = rng.integers(-20, 20, 3), [], np.zeros((laws, chunks, 2), np.int64)
    for law in range(laws):
        count = draw(st.integers(0, 40))
        cells = np.stack([rng.integers(1, n - 5, count) for n in (NX, NY, NZ)])
        columns.append(cells[:, np.lexsort(cells[::-1])] + shift[:, None])
        cuts = np.sort(np.concatenate([[0], rng.integers(0, count + 1, chunks - 1), [count]]))
        ranges[law, :, 0], ranges[law, :, 1], at = at + cuts[:-1], at + cuts[1:], at + count
    return np.concatenate(columns, 1).astype(np.int32), ranges, rng.integers(0, 2, laws) * NX, shift, chunks


@settings(max_examples=60, deadline=None)
@given(sorted_particles())
def test_spans_hold_what_particles_may_write_and_no_more(given_particles):
    cells, ranges, fields, shift, chunks = given_particles
    expected = spans_one_by_one(cells, ranges, fields, shift, chunks)
    spans = np.zeros_like(expected)
    span_rows(cells, ranges, fields, shift, spans)
    np.testing.assert_array_equal(spans, expected)
