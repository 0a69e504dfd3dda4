"""Section ``motion``: the preset that moves the object."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from phys4dgen.scene.sections.values import Auto, Direction, Positive, Section

__all__ = ["Motion"]


class Motion(Section):
    """What happens to the object, besides the forces given."""

    preset: Literal["auto", "sway", "drop", "rest"] = "auto"
    """sway: a gust on what is not held; drop: falls on a ground; rest: nothing; auto: rest where forces are given, else
    sway if a gust of 3 g is enough for it and breaks nothing, else drop"""
    wind: Auto | Direction = "auto"
    """direction of the gust in the input's axes; auto: horizontal"""
    amplitude_rel: Annotated[float, Field(gt=0, le=0.5)] = 0.10
    """displacement aimed at (99th percentile of the free Gaussians), of the height"""
    acceleration_ms2: Auto | Positive = "auto"
    """strength of the gust; auto: from a short probe that aims at amplitude_rel"""
    duration_s: Annotated[float, Field(gt=0, le=60)] = 0.3
    """length of the gust"""
    drop_height_rel: Annotated[float, Field(ge=0, le=10)] = 0.4
    """of drop: from the lowest point to the ground, of the height"""
