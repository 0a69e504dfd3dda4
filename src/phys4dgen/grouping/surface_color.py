"""The colour that each Gaussian shows where it is the visible surface, averaged over views.

A captured splat is layers of noisy Gaussians; the blend that a viewer sees is far cleaner than the colour stored in any
one of them. The depth test is the paper's (Paper: Sec. 3.2, lifting of masks): a Gaussian is seen in a view when its
depth agrees with the rendered median depth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phys4dgen.grouping.visibility import for_all_chunks, visible_pixels
from phys4dgen.types import Gaussians, Views

__all__ = ["MIN_OPACITY", "SurfaceColor", "surface_color"]

MIN_OPACITY = 0.05
"""A Gaussian fainter than this is never taken for the visible surface."""
_MIN_ALPHA = 0.6
"""Below it a pixel is mostly background and its colour says little about the object."""


@dataclass(frozen=True, eq=False)
class SurfaceColor:
    """What the views say about each Gaussian.

    Attributes:
        rgb: mean rendered colour, shape [N, 3]; zeros where never seen.
        seen: whether a view sees the Gaussian as the visible surface, shape [N, V].
        eyes: camera centres, input coordinates, shape [V, 3].
    """

    rgb: NDArray[np.float64]
    seen: NDArray[np.bool_]
    eyes: NDArray[np.float64]


def surface_color(
    gaussians: Gaussians, views: Views, *, tolerance: float, background: tuple[float, float, float] = (1.0, 1.0, 1.0)
) -> SurfaceColor:
    """Average the rendered colour over the views in which a Gaussian is the visible surface.

    Args:
        gaussians: N static Gaussians.
        views: rendered over ``background``.
        tolerance: depth tolerance, input units.
        background: RGB behind the object; taken out of pixels that are not opaque.
    """
    candidates = np.flatnonzero(gaussians.opacities > MIN_OPACITY)
    means = gaussians.means[candidates]
    behind = np.asarray(background, np.float32)
    pictures = [
        (view - (1 - alpha[..., None]) * behind) / np.maximum(alpha[..., None], _MIN_ALPHA)
        for view, alpha in zip(views.rgb, views.alpha, strict=True)
    ]
    opaque_depth = np.where(views.alpha > _MIN_ALPHA, views.depth, 0)
    color_sum = np.zeros((len(means), 3))
    seen = np.zeros((len(means), len(views)), np.bool_)

    def look(rows: slice) -> None:
        for v, camera in enumerate(views.cameras):
            index, row, column, _ = visible_pixels(means[rows], camera, opaque_depth[v], tolerance=tolerance)
            color_sum[rows][index] += pictures[v][row, column]
            seen[rows][index, v] = True

    for_all_chunks(len(means), look)
    rgb = np.zeros((len(gaussians), 3))
    rgb[candidates] = np.clip(color_sum / np.maximum(seen.sum(1), 1)[:, None], 0, 1)
    seen_by = np.zeros((len(gaussians), len(views)), np.bool_)
    seen_by[candidates] = seen
    eyes = np.stack([camera.position for camera in views.cameras])
    return SurfaceColor(rgb=rgb, seen=seen_by, eyes=eyes)
