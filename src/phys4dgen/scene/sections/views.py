"""Section ``views``: pictures of the object for parts and for people."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from phys4dgen.scene.sections.values import Section

__all__ = ["ViewSet"]


class ViewSet(Section):
    """Which views of the object are rendered into ``views/`` for parts and for people."""

    preset: Literal["object", "carve", "scene"] = "object"
    """object: 29 views, carve: 49, scene: 120; the table is in docs/conventions.md"""
    size_px: Annotated[int, Field(ge=64, le=4096)] = 512
    """width and height of a view"""
