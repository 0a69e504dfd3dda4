"""The one change of coordinates of the product: input units and axes <-> metres with z up."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.types.checks import checked_array

__all__ = ["Frame", "rotation_to_z_up"]


@dataclass(frozen=True, eq=False)
class Frame:
    """How the input's coordinates stand in the world: x_m = metres_per_unit * rotation @ x_input.

    Attributes:
        rotation: proper rotation, input axes -> axes with z up, shape [3, 3].
        metres_per_unit: length of one input unit in metres.
    """

    rotation: NDArray[np.float64]
    metres_per_unit: float

    def __post_init__(self) -> None:
        rotation = checked_array(self.rotation, "rotation", (3, 3), np.float64)
        if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6) or np.linalg.det(rotation) < 0:
            raise ValueError(f"rotation: expected a proper rotation matrix, got {rotation.tolist()}.")
        if not (np.isfinite(self.metres_per_unit) and self.metres_per_unit > 0):
            raise ValueError(f"metres_per_unit: expected a positive number, got {self.metres_per_unit}.")
        object.__setattr__(self, "rotation", rotation)

    @property
    def up(self) -> NDArray[np.float64]:
        """Unit vector in input axes that points up."""
        return self.rotation[2]

    def to_metres(self, points: NDArray[Any]) -> NDArray[np.float64]:
        """Points [.., 3] in input coordinates -> metres, z up."""
        return np.asarray(points, np.float64) @ self.rotation.T * self.metres_per_unit

    def from_metres(self, points_m: NDArray[Any]) -> NDArray[np.float64]:
        """Points [.., 3] in metres, z up -> input coordinates."""
        return np.asarray(points_m, np.float64) @ self.rotation / self.metres_per_unit

    def tensor_to_input_axes(self, tensor: NDArray[Any]) -> NDArray[np.float64]:
        """Second-order tensors [.., 3, 3] (a deformation gradient) from z-up axes to the input's axes."""
        return self.rotation.T @ np.asarray(tensor, np.float64) @ self.rotation


def rotation_to_z_up(up: NDArray[Any]) -> NDArray[np.float64]:
    """The smallest rotation that turns ``up`` (any non-zero vector, input axes) to +z; shape [3, 3]."""
    u = np.asarray(up, np.float64)
    u = u / np.linalg.norm(u)
    cosine = float(u[2])
    if cosine < -1 + 1e-12:  # up is -z: half a turn about x
        return np.diag([1.0, -1.0, -1.0])
    v = np.cross(u, [0.0, 0.0, 1.0])
    skew = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.eye(3) + skew + skew @ skew / (1 + cosine)
