"""Section ``motion``: the preset that moves the object."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from phys4dgen.scene.sections.values import Auto, Direction, PartAddress, Positive, Section

__all__ = ["Motion"]


class Motion(Section):
    """What happens to the object, besides the forces given."""

    preset: Literal["auto", "sway", "drop", "press", "twist", "melt", "rest"] = "auto"
    """sway: a gust on what is not held; drop: falls on a ground; press: a plate comes from above and goes back; twist:
    the top is turned and let go; melt: a part becomes fluid; rest: nothing; auto: rest where forces or solid boundaries
    are given, else sway if a gust of 3 g is enough for it and breaks nothing, else drop"""
    part: PartAddress | None = None
    """of melt: what melts; of twist: what is turned, null: the highest fifth"""
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
    press_depth_rel: Annotated[float, Field(gt=0, lt=1)] = 0.3
    """of press: how far the plate goes after it has touched, of the height"""
    press_force_n: Positive | None = None
    """of press: instead, the force of the plate in newtons"""
    twist_deg: Annotated[float, Field(ge=-3600, le=3600)] = 90.0
    """of twist: how far it is turned about the vertical"""
