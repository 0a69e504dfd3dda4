"""Section ``forces``: what acts on the parts, besides the motion's own."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from phys4dgen.scene.sections.values import ALL_PARTS, PartName, Section, Vector

__all__ = ["AccelerationForce"]


class AccelerationForce(Section):
    """An acceleration on every particle of a part during a time window."""

    kind: Literal["acceleration"] = "acceleration"
    """acceleration: metres per second squared on all of the part's mass"""
    part: PartName = ALL_PARTS
    """name of a part, or all"""
    value_ms2: Vector
    """in the input's axes"""
    from_s: Annotated[float, Field(ge=0)] = 0.0
    """start of the window"""
    to_s: Annotated[float, Field(gt=0)]
    """end of the window"""

    @model_validator(mode="after")
    def _window_is_ordered(self) -> AccelerationForce:
        if self.to_s <= self.from_s:
            raise ValueError(f"to_s must be later than from_s, got {self.from_s:g} to {self.to_s:g} s")
        return self
