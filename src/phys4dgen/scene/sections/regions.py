"""Regions of the object at rest, in the input's coordinates: what a force or a pin is limited to."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Tag, field_validator

from phys4dgen.scene.sections.values import Direction, Length, Section, Vector, kind_of

__all__ = ["BoxRegion", "CylinderRegion", "Region", "SphereRegion", "checked_size"]


def checked_size(size: tuple[float, float, float]) -> tuple[float, float, float]:
    """Three edges, refused where one is not positive."""
    if min(size) <= 0:
        raise ValueError(f"expected three positive edges, got {list(size)}")
    return size


class BoxRegion(Section):
    """A box."""

    kind: Literal["box"] = "box"
    """box"""
    center: Vector
    """in the input's coordinates"""
    size: Vector
    """its three edges, whole, in the input's units"""
    rotation_deg: Vector = (0.0, 0.0, 0.0)
    """turns about the input's x, then y, then z axis"""

    _positive_edges = field_validator("size")(checked_size)


class SphereRegion(Section):
    """A sphere."""

    kind: Literal["sphere"] = "sphere"
    """sphere"""
    center: Vector
    """in the input's coordinates"""
    radius: Length
    """in the input's units"""


class CylinderRegion(Section):
    """A cylinder."""

    kind: Literal["cylinder"] = "cylinder"
    """cylinder"""
    center: Vector
    """middle of its axis, in the input's coordinates"""
    axis: Direction
    """in the input's axes"""
    radius: Length
    """in the input's units"""
    height: Length
    """whole, in the input's units"""


Region = Annotated[
    Annotated[BoxRegion, Tag("box")]
    | Annotated[SphereRegion, Tag("sphere")]
    | Annotated[CylinderRegion, Tag("cylinder")],
    kind_of("box"),
]
"""What lies inside at rest; ``kind`` says which, box if it is left out."""
