"""Section ``simulation``: the Material Point Method in space and time."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from phys4dgen.scene.sections.values import Auto, Positive, Section

__all__ = ["Simulation"]


class Simulation(Section):
    """The Material Point Method (Paper: Sec. 3.5)."""

    grid: Auto | Annotated[int, Field(ge=8, le=512)] = "auto"
    """cells along the longest side of the object, of several the largest; auto: 64, fewer where a massive object would
    take too many particles; of several objects so many along the smallest"""
    cell_m: Positive | None = None
    """edge of a grid cell in metres, instead of grid"""
    scale: Literal["metres", "paper"] = "metres"
    """metres: the object's real size; paper: a unit object in a cube of side 2 with 50 (picture) or 64 cells, frames of
    714 or 400 substeps of 5e-5 s; what is auto then follows the paper"""
    duration_s: Annotated[float, Field(gt=0, le=600)] = 2.0
    """of the film; frames = round(duration_s * fps)"""
    fps: Auto | Annotated[float, Field(ge=1, le=240)] = "auto"
    """frames of the film per second; auto: 24, 14 for a picture at the paper's scale"""
    frame_time_s: Auto | Annotated[float, Field(gt=0, le=10)] = "auto"
    """simulated time between two frames; auto: 1 / fps (real time), the paper's at its scale"""
    cfl: Annotated[float, Field(gt=0, le=0.7)] = 0.6
    """time step as a share of the time in which a wave crosses a cell"""
    damping_ratio: Annotated[float, Field(ge=0, lt=1)] = 0.08
    """of the lowest mode (mass-proportional)"""
    friction: Auto | Annotated[float, Field(ge=0, le=10)] = "auto"
    """Coulomb's coefficient where bodies rub: objects and separate parts on each other (auto: 0.5), and what touches
    held parts without growing out of them (auto: 0.3)"""
    max_substeps: Annotated[int, Field(ge=10, le=1_000_000)] = 1500
    """per frame: thin parts are thickened until they need no more"""
    substep_limit: Annotated[int, Field(ge=10, le=10_000_000)] = 6000
    """per frame: a part that still needs more moves as a rigid body"""
    threads: Auto | Annotated[int, Field(ge=1, le=1024)] = "auto"
    """auto: all cores; at a given number of chunks the result does not depend on it"""
    chunks: Auto | Annotated[int, Field(ge=1, le=1024)] = "auto"
    """groups of particles that are summed apart, which fixes the order of summation; auto: the number of threads"""

    @model_validator(mode="after")
    def _one_cell(self) -> Simulation:
        if self.cell_m is not None and self.grid != "auto":
            raise ValueError("grid and cell_m both say how large a cell is; keep one of them")
        return self
