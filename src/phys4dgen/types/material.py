"""Materials of the parts: values in SI units, and where each came from."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

__all__ = ["Material", "MaterialBook", "PartMaterials"]


@dataclass(frozen=True)
class Material:
    """One named material.

    Attributes:
        name: library name or the user's own.
        law: constitutive law asked for ("neo_hookean", "fixed_corotated", "von_mises" ...).
        density_kgm3: mass per true volume.
        youngs_modulus_pa: Young's modulus E.
        poisson_ratio: nu, below 0.5.
        thickness_m: usual thickness where the material is a sheet, else None.
        source: "user", "library", "rule", "default", "mllm:<model>" or "clip".
        extra: further parameters of the law by name with units (yield_stress_pa, friction_angle_deg ...).
        evidence: what speaks for it in one phrase (votes and spread of a model's answers), else empty.
        warnings: what the user should know about this choice.
    """

    name: str
    law: str
    density_kgm3: float
    youngs_modulus_pa: float
    poisson_ratio: float
    source: str
    thickness_m: float | None = None
    extra: Mapping[str, float] = field(default_factory=dict)
    evidence: str = ""
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name, low, high in (
            ("density_kgm3", 1.0, 25000.0),
            ("youngs_modulus_pa", 1.0, 2e12),
            ("poisson_ratio", 0.0, 0.4999),
        ):
            value = getattr(self, name)
            if not (math.isfinite(value) and low <= value <= high):
                raise ValueError(f"material '{self.name}': {name} must lie in [{low:g}, {high:g}], got {value:g}.")
        if self.thickness_m is not None and not (math.isfinite(self.thickness_m) and 0 < self.thickness_m < 10):
            raise ValueError(f"material '{self.name}': thickness_m must lie in (0, 10), got {self.thickness_m:g}.")
        object.__setattr__(self, "extra", MappingProxyType(dict(self.extra)))


@dataclass(frozen=True)
class PartMaterials:
    """Surface and interior material of one part (Paper: Sec. 3.4)."""

    surface: Material
    interior: Material


@dataclass(frozen=True)
class MaterialBook:
    """The materials of every part, by part name, in the order of the part numbers."""

    parts: Mapping[str, PartMaterials]

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", MappingProxyType(dict(self.parts)))
