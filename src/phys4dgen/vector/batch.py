"""How many particles the mathematics of the kernels computes side by side: a batch.

Two vectors of 16 numbers a value hide each other's latency where a processor computes 16 at once, and cost registers
where it computes 8: Intel's processors with AVX-512 want 32 lanes, all others 16. Measured on two servers (decision
14, with the transfers of that time): with 16 a Xeon is 15 to 20 % slower, an EPYC that splits vectors of 512 bits (Zen
4) 14 to 22 % faster, and 15 to 29 % faster when made to use AVX2. The numbers that come out are the same but for a last
bit here and there.
"""

from __future__ import annotations

from typing import Any

import llvmlite.binding
from numba.core import config

__all__ = ["BATCH_LANES", "WIDEST_BATCH", "batch_lanes_of"]

WIDEST_BATCH = 32
"""A multiple of every number of lanes: what is padded to it can be computed by any processor."""

_COMPUTE_16_AT_ONCE = (
    "knl",
    "knm",
    "skylake-avx512",
    "cascadelake",
    "cooperlake",
    "cannonlake",
    "icelake",
    "rocketlake",
    "tigerlake",
    "sapphirerapids",
    "emeraldrapids",
    "graniterapids",
    "diamondrapids",
)


def batch_lanes_of(processor: str) -> int:
    """Lanes of a batch on a processor by LLVM's name."""
    return WIDEST_BATCH if processor.startswith(_COMPUTE_16_AT_ONCE) else WIDEST_BATCH // 2


_settings: Any = config  # to a type checker its attributes, which are set at run time, do not exist

# of the processor that Numba compiles for, whose name is also part of the key of its cache
BATCH_LANES = batch_lanes_of(_settings.CPU_NAME or llvmlite.binding.get_host_cpu_name())
"""Lanes of a batch on this machine."""
