"""What every generator gives back, and the protocol that it keeps (paper: Sec. 3.1)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from phys4dgen.reconstruct.foreground import Cutout
from phys4dgen.types import Camera, Gaussians

__all__ = ["ImageTo3D", "Reconstruction", "Solid"]


class Solid(Protocol):
    """The inside of an object, known exactly."""

    def contains(self, points: NDArray[Any]) -> NDArray[np.bool_]:
        """Whether points [N, 3], in the coordinates of the Gaussians, lie inside; shape [N]."""
        ...


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """Gaussians made from one picture.

    Attributes:
        gaussians: the object; the picture's camera stands on +z of it, y is up.
        camera: the picture's camera, for ``picture``.
        picture: the cut-out in the canonical frame, straight sRGB and opacity, shape [S, S, 4], float32.
        backend: what made it, for the report; says "stand-in" where it is one.
        solid: exact inside test, or None where the generator knows a surface only.
        even_colors: colours of the Gaussians as if light came from everywhere, in which parts of one material look
            alike, shape [N, 3]; None where the generator cannot tell light from colour.
        warnings: what may be wrong, one sentence each.
        facts: figures for the report.
    """

    gaussians: Gaussians
    camera: Camera | None
    picture: NDArray[np.float32] | None
    backend: str
    solid: Solid | None = None
    even_colors: NDArray[np.float32] | None = None
    warnings: tuple[str, ...] = ()
    facts: dict[str, float] = field(default_factory=dict)


class ImageTo3D(Protocol):
    """Makes Gaussians of an object that was cut out of a picture."""

    def __call__(self, cutout: Cutout) -> Reconstruction:
        """The object in 3D."""
        ...
