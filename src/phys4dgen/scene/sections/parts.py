"""Section ``parts``: what the user says about single parts."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from phys4dgen.scene.sections.values import Section

__all__ = ["PartOptions"]


class PartOptions(Section):
    """What the user says about one part."""

    hold: Literal["auto", "fixed", "rigid", "free"] = "auto"
    """fixed: does not move; rigid: moves and never deforms; free: moves, and deforms if its stiffness can be afforded;
    auto: fixed or free, as the motion preset decides"""
    material: str | None = None
    """of the surface, by its name in the library; null: as identified"""
    interior_material: str | None = None
    """null: as the surface"""
    thickness_m: Annotated[float, Field(gt=0, lt=1)] | None = None
    """of a sheet, a rod or the wall of a vessel; null: measured, else the library's"""
    separate: bool = False
    """the part touches what is beside it, slides on it and does not hang together with it (a lid, a fruit in a bowl)"""
