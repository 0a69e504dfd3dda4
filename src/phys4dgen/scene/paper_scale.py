"""The paper's own numbers of space and time: ``simulation.scale: paper``.

Paper: App. C. A unit object lies in a cube of side 2, which is cut into 50 cells along each side where the object came
from a picture (the image-to-4D task) and into 64 where it was given as a splat (3D-to-4D). A frame is 714 or 400
substeps of 5e-5 s; of pictures 14 frames make a second of the film.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from phys4dgen.input_kinds import is_picture

__all__ = ["SUBSTEP_S", "PaperScale", "paper_scale"]

SUBSTEP_S = 5e-5
"""Of every substep."""


@dataclass(frozen=True)
class PaperScale:
    """What the paper simulates one kind of input with.

    Attributes:
        grid: cells along the object's longest side, half of those along the cube's.
        substeps: per frame.
        fps: frames of the film per second.
    """

    grid: int
    substeps: int
    fps: float

    @property
    def frame_time_s(self) -> float:
        """Simulated time between two frames; the film of a picture shows it at half speed."""
        return self.substeps * SUBSTEP_S


_OF_A_PICTURE = PaperScale(grid=25, substeps=714, fps=14.0)
_OF_A_SPLAT = PaperScale(grid=32, substeps=400, fps=24.0)


def paper_scale(path: Path) -> PaperScale:
    """The numbers for an input; the paper says nothing of the frames per second of a splat's film."""
    return _OF_A_PICTURE if is_picture(path) else _OF_A_SPLAT
