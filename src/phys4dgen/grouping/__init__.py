"""Which part each Gaussian belongs to (Paper: Sec. 3.2): by appearance, or from a file.

The public functions live in ``appearance`` and ``from_file``; the first one imports Numba.
"""
