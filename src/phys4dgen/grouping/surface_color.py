"""The colour that each Gaussian shows where it is the visible surface, averaged over views.

A captured splat is layers of noisy Gaussians; the blend that a viewer sees is far cleaner than the colour stored in any
one of them. The depth test is the paper's (Paper: Sec. 3.2, lifting of masks): a Gaussian is seen in a view when its
depth agrees with the rendered median depth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phys4dgen.types import Camera, Gaussians, Views

__all__ = ["MIN_OPACITY", "SurfaceColor", "surface_color", "visible_pixels"]

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


def visible_pixels(
    means: NDArray[np.float32],
    camera: Camera,
    alpha: NDArray[np.float32],
    *,
    depth: NDArray[np.float32],
    tolerance: float,
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Which Gaussians are the visible surface of a view, and at which pixel.

    Args:
        means: centres, shape [N, 3].
        camera: the view's camera.
        alpha: accumulated opacity of the view, shape [H, W].
        depth: median depth of the view, shape [H, W].
        tolerance: largest difference from the rendered depth, input units.

    Returns:
        Index of the Gaussian, row and column, each of shape [M].
    """
    pixels, z = camera.project(means)
    inside = (z > 0) & (pixels >= 0).all(1) & (pixels[:, 0] < camera.width) & (pixels[:, 1] < camera.height)
    index = np.flatnonzero(inside)
    column, row = pixels[index].astype(np.intp).T
    surface = (alpha[row, column] > _MIN_ALPHA) & (np.abs(depth[row, column] - z[index]) < tolerance)
    return index[surface], row[surface], column[surface]


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
    color_sum = np.zeros((len(gaussians), 3))
    seen = np.zeros((len(gaussians), len(views)), np.bool_)
    for v, camera in enumerate(views.cameras):
        index, row, column = visible_pixels(means, camera, views.alpha[v], depth=views.depth[v], tolerance=tolerance)
        index = candidates[index]
        opacity = views.alpha[v, row, column].astype(np.float64)[:, None]
        color_sum[index] += (views.rgb[v, row, column] - (1 - opacity) * np.asarray(background)) / opacity
        seen[index, v] = True
    count = np.maximum(seen.sum(1), 1)[:, None]
    eyes = np.stack([camera.position for camera in views.cameras])
    return SurfaceColor(rgb=np.clip(color_sum / count, 0, 1), seen=seen, eyes=eyes)
