"""Learned models that parts and materials may be asked of: which weights, and where they run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field

from phys4dgen.scene.sections.values import Auto, Section

__all__ = ["Clip", "Sam2"]

Weights = Annotated[str, Field(min_length=1, max_length=1024)]


class _Checkpoint(Section):
    """Weights that are named by a folder or an id."""

    weights: Weights

    def with_paths_from(self, folder: Path) -> Self:
        """A copy whose weights, where they are a folder there, are taken from ``folder``; an id stays as it is."""
        found = (folder / Path(self.weights).expanduser()).is_dir()
        return (
            self.model_copy(update={"weights": (folder / Path(self.weights).expanduser()).as_posix()})
            if found
            else self
        )


class Sam2(_Checkpoint):
    """Segment Anything 2 over the views (Paper: Sec. 3.2)."""

    weights: Weights = "facebook/sam2.1-hiera-tiny"
    """id of a video checkpoint on the Hugging Face hub, looked for in its cache and never fetched, or a folder"""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """auto: cuda where PyTorch sees one"""
    views: Auto | Annotated[int, Field(ge=3, le=1000)] = "auto"
    """views that are used, evenly along a smooth path through all; auto: all"""
    key_views: Annotated[int, Field(ge=1, le=100)] = 8
    """views in which parts are looked for at most, where those of earlier ones leave something unclaimed"""
    points_per_side: Annotated[int, Field(ge=2, le=64)] = 16
    """of the grid of prompts in a key view; more find smaller parts"""


class Clip(_Checkpoint):
    """CLIP, which joins pictures and words (Paper: Sec. 3.4)."""

    weights: Weights = "openai/clip-vit-base-patch16"
    """id of a checkpoint on the Hugging Face hub, looked for in its cache and never fetched, or a folder"""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """auto: cuda where PyTorch sees one"""
