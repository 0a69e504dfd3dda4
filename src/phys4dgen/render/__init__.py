"""Cameras and the CPU renderer of Gaussians (paper: Sec. C.1): EWA projection, tile lists, compositing.

The public functions live in ``cameras``, ``view_table``, ``views`` and ``rasterise``; the last two import Numba.
"""
