"""Section ``output``: which files are written."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from phys4dgen.scene.sections.values import Auto, Section

__all__ = ["Output", "Video"]


class Video(Section):
    """The film of video.mp4, preview.png and contact_sheet.png."""

    width: Annotated[int, Field(ge=64, le=7680)] = 800
    """pixels"""
    height: Auto | Annotated[int, Field(ge=64, le=7680)] = "auto"
    """pixels; auto: from the object's shape"""
    orbit_deg: Annotated[float, Field(ge=-3600, le=3600)] = 60.0
    """how far the camera travels round the object during the film"""
    azimuth_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    """where the middle of that path lies, counterclockwise seen from above; 0: the view from -y of the z-up axes"""
    elevation_deg: Annotated[float, Field(ge=-89, le=89)] = 12.0
    """of the camera above the horizon"""
    fps: Auto | Annotated[float, Field(ge=1, le=240)] = "auto"
    """auto: simulation.fps"""
    background: Literal["white", "black", "grey"] = "white"
    """behind the object"""


class Output(Section):
    """Which files are written."""

    frames: Literal["ply", "none"] = "ply"
    """ply: one complete 3DGS PLY per frame"""
    video: Video = Field(default_factory=Video)
