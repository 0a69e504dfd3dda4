"""The SIMD value type for Numba and its mathematics; used by ``mpm`` and ``animate``.

``lanes`` has the type, its operators, loads, stores and shuffles; ``math`` the functions and 3 x 3 matrices;
``float_state`` switches denormal numbers off inside a kernel.
"""
