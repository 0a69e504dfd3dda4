"""Between the splat's coordinates and PhysGaussian's MPM space: rotations, a selection, a shift and a scale."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from phys4dgen.errors import SceneError
from phys4dgen.physgaussian.configuration import Configuration
from phys4dgen.types import Gaussians

__all__ = ["Placement", "place", "simulated"]

MIDDLE = 1.0
"""Where the object's centre lies in MPM space, on every axis."""


@dataclass(frozen=True, eq=False)
class Placement:
    """m = (R x - c) s + 1.

    Attributes:
        rotation: R, proper, [3, 3].
        center: c, of the box of the simulated Gaussians after the rotation, [3].
        scale: s, MPM units per unit of the splat.
    """

    rotation: NDArray[np.float64]
    center: NDArray[np.float64]
    scale: float

    def to_mpm(self, points: NDArray[Any]) -> NDArray[np.float64]:
        """Points [.., 3] of the splat in MPM space."""
        return (np.asarray(points, np.float64) @ self.rotation.T - self.center) * self.scale + MIDDLE

    def point(self, mpm: Any) -> tuple[float, float, float]:
        """A point of MPM space in the splat's coordinates."""
        return _triple(((np.asarray(mpm, np.float64) - MIDDLE) / self.scale + self.center) @ self.rotation)

    def vector(self, mpm: Any) -> tuple[float, float, float]:
        """A direction, velocity or force in the splat's axes; its length stays, a unit of MPM space is a metre."""
        return _triple(np.asarray(mpm, np.float64) @ self.rotation)

    def length(self, mpm: float) -> float:
        """A length of MPM space in the splat's units."""
        return float(mpm / self.scale)

    def box(self, center: Any, half: Any) -> dict[str, Any]:
        """A box of MPM space as ``center``, ``size`` and ``rotation_deg`` of a region or obstacle."""
        box: dict[str, Any] = {
            "kind": "box",
            "center": self.point(center),
            "size": tuple(self.length(2 * side) for side in half),
        }
        angles = Rotation.from_matrix(self.rotation.T).as_euler("xyz", degrees=True)
        return box | ({"rotation_deg": _triple(angles)} if np.abs(angles).max() > 1e-9 else {})


def simulated(gaussians: Gaussians, config: Configuration) -> NDArray[np.bool_]:
    """Which Gaussians PhysGaussian simulates: opaque enough, and inside ``sim_area`` after the rotations; [N].

    Raises:
        SceneError: none is left.
    """
    chosen = gaussians.opacities > config.opacity_threshold
    if config.sim_area is not None:
        area = np.array(config.sim_area).reshape(3, 2)
        turned = gaussians.means.astype(np.float64) @ _rotation(config).T
        chosen &= ((turned > area[:, 0]) & (turned < area[:, 1])).all(1)
    if not chosen.any():
        raise SceneError(
            f"sim_area, opacity_threshold: no Gaussian of {len(gaussians)} is left to simulate; sim_area is in the "
            "splat's units after rotation_degree, before scaling."
        )
    return chosen


def place(gaussians: Gaussians, config: Configuration) -> Placement:
    """Where PhysGaussian puts the Gaussians that it simulates.

    Args:
        gaussians: those that are simulated.
        config: the configuration.
    """
    rotation = _rotation(config)
    turned = gaussians.means.astype(np.float64) @ rotation.T
    lower, upper = turned.min(0), turned.max(0)
    extent = float((upper - lower).max())
    if not extent > 0:
        raise SceneError("the simulated Gaussians lie in one point; expected an object with an extent.")
    return Placement(rotation, (lower + upper) / 2, config.scale / extent)


def _rotation(config: Configuration) -> NDArray[np.float64]:
    """R_k ... R_1, right-handed turns about the axes 0, 1, 2."""
    matrix = np.eye(3)
    for degrees, axis in zip(config.rotation_degree, config.rotation_axis, strict=True):
        matrix = Rotation.from_rotvec(np.eye(3)[axis] * degrees, degrees=True).as_matrix() @ matrix
    return matrix


def _triple(values: Any) -> tuple[float, float, float]:
    """Three plain numbers, free of the dust of rounding."""
    x, y, z = (float(value) + 0.0 for value in np.round(np.asarray(values, np.float64), 9))
    return x, y, z
