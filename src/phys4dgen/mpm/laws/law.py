"""What a constitutive law is to the engine, and the one call through which kernels reach it.

A law is a Numba *type*: a kernel that takes a law is compiled once for each law that a scene contains, without a
branch inside its loop, and cached on disk like any other compiled function. Its parameters and its state are particle
columns that only its own particles use, so a law pays for no other law's numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import Any

import numpy as np
from numba.core import types
from numba.extending import NativeValue, models, register_model, typeof_impl, unbox
from numpy.typing import NDArray

__all__ = ["LAWS", "Gradient", "Law", "LawId", "LawType", "law_named", "register"]


class LawId(IntEnum):
    """Names of the constitutive laws; the values are what ``Body.law`` holds."""

    NEO_HOOKEAN = 0
    FIXED_COROTATED = 1
    STVK_HENCKY = 2
    VON_MISES = 3
    DRUCKER_PRAGER = 4
    SNOW = 5
    VISCOPLASTIC = 6
    HERSCHEL_BULKLEY = 7
    FLUID = 8


class Gradient(Enum):
    """How far the engine carries the deformation gradient of a law's particles."""

    ELASTIC = "elastic"
    """F is elastic and gives the stress: it is summed with compensated rounding, in nine more state columns."""
    TOTAL = "total"
    """F holds the flow too and is for the Gaussians alone; the stress comes from the law's own state."""


Columns = tuple[NDArray[np.float64], ...]


@dataclass(frozen=True)
class Law:
    """A constitutive law.

    Attributes:
        law_id: its name in the public interface.
        parameters: names of the parameter columns that the kernel reads.
        prepare: those columns, [P] each, from material numbers by name: "youngs_modulus_pa", "lame_mu_pa",
            "lame_lambda_pa" and the law's own of ``types.laws``.
        response: inlined vector function (h, c, dt, parameters, state) -> (tau, state). h: nine lanes of displacement
            gradient H = F - I after the substep (H and not F, because a small strain beside the 1 of F would lose its
            digits); c: nine lanes of velocity gradient C in 1/s; dt: the substep in s by which ``state`` is to be
            advanced, 0 where only the stress of this state is asked for; tau: six lanes of Kirchhoff stress in Pa.
        energy_density_pa: NumPy function (F [P, 3, 3], parameters [m, P], state [k, P]) -> stored energy per rest
            volume, J/m3, [P].
        state: names of the state columns, zero at rest.
        gradient: how the engine carries F.
        stiffening: NumPy function (parameters, state) -> by how much the P-wave modulus has grown over that at rest,
            [P]; None if it does not grow much.
        damped: with Kelvin-Voigt viscosity (``kelvin_voigt.damped``).
        stretches: NumPy function (principal Kirchhoff stresses [P, 3], mu [P], lambda [P]) -> principal stretches
            [P, 3] that have them; None of a law that does not keep its shape under its weight.
    """

    law_id: LawId
    parameters: tuple[str, ...]
    prepare: Callable[[Mapping[str, NDArray[np.float64]]], Columns]
    response: Any
    energy_density_pa: Callable[[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
    state: tuple[str, ...] = ()
    gradient: Gradient = Gradient.ELASTIC
    stiffening: Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]] | None = None
    damped: bool = False
    stretches: Callable[[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]] | None = (
        None
    )

    @property
    def name(self) -> str:
        """Tells compiled kernels apart."""
        return f"DAMPED_{self.law_id.name}" if self.damped else self.law_id.name

    @property
    def column_count(self) -> int:
        """Columns that a particle of this law needs beyond the common ones."""
        return len(self.parameters) + len(self.state) + (9 if self.gradient is Gradient.ELASTIC else 0)


LAWS: dict[LawId, Law] = {}
"""Every law that the engine has, by name; ``laws/__init__.py`` registers them."""

_BY_NAME: dict[str, Law] = {}


def register(law: Law) -> Law:
    """Make a law known to the engine."""
    if not law.damped:
        LAWS[law.law_id] = law
    _BY_NAME[law.name] = law
    return law


def law_named(name: str) -> Law:
    """The registered law of that ``Law.name``."""
    return _BY_NAME[name]


class LawType(types.Opaque):
    """The Numba type of one law."""

    def __init__(self, law_name: str) -> None:
        self.law_name = law_name
        super().__init__(name=f"Law({law_name})")


register_model(LawType)(models.OpaqueModel)


@typeof_impl.register(Law)
def _typeof_law(law: Law, context: Any) -> LawType:
    return LawType(law.name)


@unbox(LawType)
def _unbox_law(law_type: Any, value: Any, context: Any) -> NativeValue:
    return NativeValue(context.context.get_dummy_value())
