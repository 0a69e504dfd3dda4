"""What a bundled object is: Gaussians whose parts, volumes, areas, thicknesses and inside are known exactly."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from phys4dgen.types import Gaussians
from phys4dgen.types.checks import checked_array

__all__ = ["MotionName", "PartTruth", "ZooObject"]

MotionName = Literal["sway", "drop"]


@dataclass(frozen=True)
class PartTruth:
    """What one part is, and its exact geometry in metres.

    Attributes:
        material: its name in the material library.
        volume_m3: volume of the solid material (walls, not what they enclose).
        area_m2: mid-surface area of a sheet, lateral area of a rod, None for solids.
        thickness_m: constant thickness of a sheet, nominal diameter of a rod, wall thickness of a pot, else None.
    """

    material: str
    volume_m3: float
    area_m2: float | None = None
    thickness_m: float | None = None


@dataclass(frozen=True, eq=False)
class ZooObject:
    """A bundled object with its truth.

    Attributes:
        gaussians: the splat, in input units.
        labels: part of every Gaussian, numbered from the ground up, -1 for a floater, shape [N], int32.
        part_names: one name per part.
        up: unit vector that points up, shape [3].
        metres_per_unit: length of one input unit in metres.
        height_m: extent of the robust box (``Gaussians.robust_bounds``) along up, metres: the value of ``height_m``
            with which the product finds ``metres_per_unit`` again.
        measure: finds the truth; called once, when it is asked for.
        motion: the motion preset that shows the object best.
        default_scene: the other settings of the demo scene, keys as in scene.yaml.
        inside: maps points [M, 3] in input units to the part that fills each point, int32, -1 in the air.
    """

    gaussians: Gaussians
    labels: NDArray[np.int32]
    part_names: tuple[str, ...]
    up: NDArray[np.float64]
    metres_per_unit: float
    height_m: float
    measure: Callable[[], Mapping[str, PartTruth]]
    motion: MotionName
    default_scene: Mapping[str, Any]
    inside: Callable[[NDArray[Any]], NDArray[np.int32]]

    def __post_init__(self) -> None:
        object.__setattr__(self, "labels", checked_array(self.labels, "labels", (len(self.gaussians),), np.int32))
        object.__setattr__(self, "up", checked_array(self.up, "up", (3,), np.float64))

    @cached_property
    def truth(self) -> Mapping[str, PartTruth]:
        """Material and exact geometry by part name."""
        return self.measure()
