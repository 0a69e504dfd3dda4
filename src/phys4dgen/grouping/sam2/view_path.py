"""Views in an order in which each looks like the one before it.

A tracker's memory takes the last views for the most telling ones, so the 120 random views of the paper (Sec. 3.2) have
to be put in order first.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from phys4dgen.render.view_table import short_tour
from phys4dgen.types import Camera

__all__ = ["key_places", "smooth_path"]


def smooth_path(cameras: Sequence[Camera]) -> NDArray[np.int64]:
    """The cameras' numbers along a short path, shape [V].

    Neighbours differ little in orientation, roll included, and in place. The path is a closed tour, cut at its longest
    step.

    Args:
        cameras: V cameras in any order.
    """
    if len(cameras) < 3:
        return np.arange(len(cameras))
    places = np.array([camera.position for camera in cameras])
    spread = np.linalg.norm(places - places.mean(0), axis=1).mean() or 1.0
    poses = np.hstack([np.array([camera.viewmat[:3, :3].ravel() for camera in cameras]), places / spread])
    tour = short_tour(poses)
    step = np.linalg.norm(poses[tour] - poses[np.roll(tour, 1)], axis=1)
    return np.roll(tour, -int(step.argmax()))


def key_places(count: int, wanted: int) -> list[int]:
    """Places on a path of ``count`` views at which new things are looked for: the middle first, then ever between.

    Starting in the middle keeps every view within half the path of the masks that it is tracked from.

    Args:
        count: views on the path.
        wanted: places at most.
    """
    places = [count // 2]
    while len(places) < min(wanted, count):
        distance = np.abs(np.arange(count)[:, None] - np.array(places)).min(1)
        places.append(int(distance.argmax()))
    return places
