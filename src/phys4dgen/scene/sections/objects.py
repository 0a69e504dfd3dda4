"""Section ``objects``: several objects in one scene, each with its own input and pose."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import Field, model_validator

from phys4dgen.scene.sections.grouping import Grouping
from phys4dgen.scene.sections.reconstruct import Reconstruct
from phys4dgen.scene.sections.select import Select
from phys4dgen.scene.sections.values import Auto, AxisName, Direction, FilePath, Positive, Section, Vector

__all__ = ["PlacedObject"]


class PlacedObject(Section):
    """One of several objects: what it is, where it stands and how it moves at first.

    It is understood by itself, in its own coordinates; then it is put into the scene, in metres with z up.
    """

    input: FilePath
    """a splat, a picture or a mesh; relative to this file"""
    up: AxisName | Direction = "auto"
    """as of a single object, in the input's axes"""
    height_m: Auto | Positive = "auto"
    """real extent along up, before it is turned; auto: 0.3 with a warning, unless longest_m is given"""
    longest_m: Positive | None = None
    """real extent of the longest side, instead of height_m"""
    position_m: Vector = (0.0, 0.0, 0.0)
    """where the middle of the underside of its box is, turned as it is: [0, 0, 0] stands in the middle of the ground"""
    rotation_deg: Vector = (0.0, 0.0, 0.0)
    """turns about the scene's x, then y, then z axis, after up has become z"""
    velocity_ms: Vector = (0.0, 0.0, 0.0)
    """with which it starts"""
    spin_deg_s: Vector = (0.0, 0.0, 0.0)
    """degrees per second about the scene's axes through its centre of mass, with which it starts"""
    reconstruct: Reconstruct | None = None
    """of a picture or a mesh; null: as the scene's"""
    select: Select = Field(default_factory=Select)
    """the object in a captured scene; what is not selected is left out"""
    grouping: Grouping | None = None
    """how it is divided into parts; null: as the scene's"""

    @model_validator(mode="after")
    def _one_size(self) -> PlacedObject:
        if self.longest_m is not None and self.height_m != "auto":
            raise ValueError("height_m and longest_m both give the size; keep one of them")
        return self

    def with_paths_from(self, folder: Path) -> PlacedObject:
        """A copy whose relative paths are taken from ``folder``."""
        changed: dict[str, Any] = {"input": folder / self.input, "select": self.select.with_paths_from(folder)}
        if self.reconstruct is not None:
            changed["reconstruct"] = self.reconstruct.with_paths_from(folder)
        if self.grouping is not None:
            changed["grouping"] = self.grouping.with_paths_from(folder)
        return self.model_copy(update=changed)
