"""Section ``changes``: materials that change while the object moves (melting, hardening, burning down)."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, Field, model_validator

from phys4dgen.scene.sections.values import PartAddress, Section

__all__ = ["MaterialChange"]


def _floats(value: Any) -> Any:
    """Numbers of YAML, whole ones too, as floats."""
    if not isinstance(value, dict):
        return value
    return {k: float(v) if isinstance(v, int) and not isinstance(v, bool) else v for k, v in value.items()}


class MaterialChange(Section):
    """A part that becomes something else; its mass stays."""

    part: PartAddress
    """name of the part"""
    from_s: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    """when it begins"""
    over_s: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    """time in which the change goes through the part, from its surface inwards; 0: all at once"""
    material: str | None = None
    """what it becomes, by its name in the library; null: what it is, with the numbers below"""
    law: str | None = None
    """law of the new material; null: that of the library's, or the part's own"""
    youngs_modulus_pa: Annotated[float, Field(gt=0, le=2e12)] | None = None
    """null: that of the library's, or the part's own"""
    poisson_ratio: Annotated[float, Field(ge=0, lt=0.5)] | None = None
    """null: that of the library's, or the part's own"""
    numbers: Annotated[dict[str, float], BeforeValidator(_floats)] = Field(default_factory=dict)
    """further numbers of the law, such as viscosity_pas or yield_stress_pa"""

    @model_validator(mode="after")
    def _changes_something(self) -> MaterialChange:
        if self.material is None and self.law is None and self.youngs_modulus_pa is None and not self.numbers:
            raise ValueError("say what it becomes: material, law, youngs_modulus_pa or numbers")
        return self
