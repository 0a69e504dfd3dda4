"""The SIMD value type for Numba and its mathematics; used by ``mpm`` and ``animate``.

``batch`` says how many lanes this machine computes side by side. ``lanes`` has the type, its operators and simple
functions; ``memory`` loads and stores; ``shuffles`` moves numbers between lanes; ``math`` has log and exp, ``matrix``
3 x 3 matrices; ``float_state`` switches denormal numbers off inside a kernel.
"""
