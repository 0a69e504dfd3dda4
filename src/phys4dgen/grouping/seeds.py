"""A click in a view: which Gaussian it means, and which patch of the surface."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from phys4dgen.errors import StageError
from phys4dgen.grouping.patch_graph import PatchGraph
from phys4dgen.render.views import render_labels
from phys4dgen.types import Camera, Gaussians

__all__ = ["gaussian_at", "seed_patches"]


def gaussian_at(gaussians: Gaussians, camera: Camera, x_px: float, y_px: float) -> int:
    """Index of the Gaussian that a pixel of a view shows (the one at the median depth).

    Args:
        gaussians: N static Gaussians.
        camera: the view's camera.
        x_px: column from the left edge of the picture.
        y_px: row from its upper edge.

    Raises:
        StageError: the point lies outside the picture or beside the object.
    """
    if not (0 <= x_px < camera.width and 0 <= y_px < camera.height):
        raise StageError(
            f"grouping: the click at {x_px:g}, {y_px:g} lies outside the view of {camera.width} x {camera.height} px."
        )
    found = int(render_labels(gaussians, np.arange(len(gaussians)), camera)[int(y_px), int(x_px)])
    if found < 0:
        raise StageError(f"grouping: the click at {x_px:g}, {y_px:g} is beside the object; click on a part of it.")
    return found


def seed_patches(graph: PatchGraph, gaussians: Gaussians, seeds: Mapping[str, Sequence[int]]) -> NDArray[np.intp]:
    """Number of the part that each patch was pointed at as, in the order of ``seeds``; -1 elsewhere, shape [S].

    Args:
        graph: S patches.
        gaussians: N static Gaussians.
        seeds: by the name of each part, indices of one or more Gaussians of it.

    Raises:
        StageError: two parts are pointed at in one patch.
    """
    visible = np.flatnonzero(graph.patch >= 0)
    places = KDTree(gaussians.means[visible])
    part_of_patch = np.full(len(graph), -1, np.intp)
    names = list(seeds)
    for number, name in enumerate(names):
        nearest = places.query(gaussians.means[list(seeds[name])])[1]
        for patch in graph.patch[visible[nearest]]:
            if part_of_patch[patch] not in (-1, number):
                raise StageError(
                    f"grouping: the clicks for '{names[part_of_patch[patch]]}' and '{name}' fall on one spot of the "
                    "surface; click further apart."
                )
            part_of_patch[patch] = number
    return part_of_patch
