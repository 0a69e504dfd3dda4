"""Section ``boundaries``: what the object may not pass."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from phys4dgen.scene.sections.values import Auto, Section

__all__ = ["Ground"]


class Ground(Section):
    """A level plane on which the object falls or stands."""

    kind: Literal["ground"] = "ground"
    """ground: nothing passes below it"""
    friction: Annotated[float, Field(ge=0, le=10)] = 0.4
    """Coulomb's coefficient"""
    contact: Literal["separate", "slip", "sticky"] = "separate"
    """separate: pushes, never pulls, and rubs; slip: holds down without friction; sticky: what touches it stays"""
    below_m: Auto | Annotated[float, Field(ge=0, le=1000)] = "auto"
    """from the object's lowest point down to the plane; auto: drop_height_rel where the preset is drop, else 0"""
