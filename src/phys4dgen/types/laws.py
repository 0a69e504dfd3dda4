"""The constitutive laws that a material may ask for, and the numbers that each needs beyond density, E and nu."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

__all__ = ["KNOWN_NUMBERS", "LAW_NUMBERS", "LawNumber", "complete_numbers", "wrong_number"]


@dataclass(frozen=True)
class LawNumber:
    """One number of a law.

    Attributes:
        name: with its unit.
        low, high: what it may be, both included.
        default: if not given; None where it must be given.
    """

    name: str
    low: float
    high: float
    default: float | None = None


_YIELD_STRESS = LawNumber("yield_stress_pa", 1e-3, 1e12)
_DAMPING_TIME = LawNumber("damping_time_s", 0.0, 10.0, 0.0)

LAW_NUMBERS: Mapping[str, tuple[LawNumber, ...]] = MappingProxyType(
    {
        "neo_hookean": (_DAMPING_TIME,),
        "fixed_corotated": (_DAMPING_TIME,),
        "stvk_hencky": (_DAMPING_TIME,),
        "von_mises": (
            _YIELD_STRESS,
            LawNumber("hardening_modulus_pa", -1e12, 1e12, 0.0),
            LawNumber("residual_yield_stress_pa", 0.0, 1e12, 0.0),
            _DAMPING_TIME,
        ),
        "drucker_prager": (
            LawNumber("friction_angle_deg", 1.0, 60.0),
            LawNumber("cohesion_pa", 0.0, 1e9, 0.0),
        ),
        "snow": (
            LawNumber("critical_compression", 1e-4, 0.2),
            LawNumber("critical_stretch", 1e-4, 0.2),
            LawNumber("hardening_coefficient", 0.0, 30.0),
        ),
        "viscoplastic": (_YIELD_STRESS, LawNumber("viscosity_pas", 0.0, 1e9, 0.0)),
        "herschel_bulkley": (
            _YIELD_STRESS,
            LawNumber("consistency_pasn", 1e-6, 1e9),
            LawNumber("flow_exponent", 0.2, 2.0),
        ),
        "fluid": (LawNumber("viscosity_pas", 0.0, 1e6),),
    }
)
"""Numbers of each law, by its name in materials.yaml; what they mean stands in ``mpm/laws/<name>.py``."""

KNOWN_NUMBERS = frozenset({number.name for numbers in LAW_NUMBERS.values() for number in numbers} | {"strength_pa"})
"""Everything that a material may say beyond density, E and nu; ``strength_pa`` is for information."""


def complete_numbers(law: str, given: Mapping[str, float]) -> dict[str, float]:
    """The numbers of a law, defaults filled in; NaN where one is missing that has none."""
    return {
        number.name: given.get(number.name, math.nan if number.default is None else number.default)
        for number in LAW_NUMBERS[law]
    }


def wrong_number(law: str, given: Mapping[str, float], youngs_modulus_pa: float, poisson_ratio: float) -> str | None:
    """What is missing or impossible among the numbers of a law, as a clause; None if all is well."""
    for number in LAW_NUMBERS[law]:
        value = given.get(number.name, number.default)
        if value is None:
            return f"the law {law} needs {number.name}, from {number.low:g} to {number.high:g}"
        if not (math.isfinite(value) and number.low <= value <= number.high):
            return f"{number.name} of the law {law} must lie in [{number.low:g}, {number.high:g}], got {value:g}"
    if law == "von_mises":
        numbers = complete_numbers(law, given)
        steepest = -youngs_modulus_pa / (1 + poisson_ratio)  # -2 mu; beyond -3 mu stress would fall without strain
        if numbers["hardening_modulus_pa"] < steepest:
            return (
                f"hardening_modulus_pa must be at least {steepest:.3g} (-E/(1+nu)) for this stiffness, got "
                f"{numbers['hardening_modulus_pa']:g}"
            )
        if numbers["residual_yield_stress_pa"] > numbers["yield_stress_pa"]:
            return (
                f"residual_yield_stress_pa {numbers['residual_yield_stress_pa']:g} must not exceed yield_stress_pa "
                f"{numbers['yield_stress_pa']:g}"
            )
    return None
