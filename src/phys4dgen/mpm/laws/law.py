"""What a constitutive law is to the engine, and the one call through which kernels reach it.

A law is a Numba *type*: a kernel that takes a law is compiled once for each law that a scene contains, without a
branch inside its loop, and cached on disk like any other compiled function.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numba.core import types
from numba.extending import NativeValue, models, overload, register_model, typeof_impl, unbox
from numpy.typing import NDArray

__all__ = ["LAWS", "Law", "LawId", "register", "respond"]


class LawId(IntEnum):
    """Names of the constitutive laws; the values are what ``Body.law`` holds."""

    NEO_HOOKEAN = 0
    FIXED_COROTATED = 1


EnergyDensity = Callable[[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]


@dataclass(frozen=True)
class Law:
    """A constitutive law.

    Attributes:
        law_id: its name in the public interface.
        response: inlined vector function (H, mu, lam) -> (H, tau): nine lanes of displacement gradient H = F - I, Lame
            parameters in Pa; returns H after plastic flow (unchanged in elastic laws) and six lanes of Kirchhoff stress
            in Pa. H and not F, because a small strain beside the 1 of F would lose its digits.
        energy_density_pa: NumPy function (F [P, 3, 3], mu [P], lam [P]) -> stored energy per rest volume, J/m3, [P].
    """

    law_id: LawId
    response: Any
    energy_density_pa: EnergyDensity


LAWS: dict[LawId, Law] = {}
"""Every law that the engine has, by name; ``laws/__init__.py`` registers them."""


def register(law: Law) -> Law:
    """Make a law known to the engine."""
    LAWS[law.law_id] = law
    return law


class LawType(types.Opaque):
    """The Numba type of one law."""

    def __init__(self, law_name: str) -> None:
        self.law_name = law_name
        super().__init__(name=f"Law({law_name})")


register_model(LawType)(models.OpaqueModel)


@typeof_impl.register(Law)
def _typeof_law(law: Law, context: Any) -> LawType:
    return LawType(law.law_id.name)


@unbox(LawType)
def _unbox_law(law_type: Any, value: Any, context: Any) -> NativeValue:
    return NativeValue(context.context.get_dummy_value())


def respond(law: Any, h: Any, mu: Any, lam: Any) -> Any:
    """Inside kernels: (H, tau) of ``law`` for nine lanes of H = F - I and the Lame parameters; see ``Law.response``."""
    raise NotImplementedError("respond works inside compiled kernels only.")


@overload(respond, jit_options={"forceinline": True, "fastmath": True, "error_model": "numpy"})
def _respond(law, h, mu, lam):
    response = LAWS[LawId[law.law_name]].response

    def call(law, h, mu, lam):
        return response(h, mu, lam)

    return call
