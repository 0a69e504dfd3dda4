"""The canonical frame: the object centred, its longest side 0.8 of a square picture, and the camera that saw it.

This is the framing of LGM (Tang et al., "LGM: Large Multi-View Gaussian Model", ECCV 2024), whose camera is 49.1 deg
high at a distance of 1.5. The same section of the plane z = 0 is seen from a distance of 3.2 by 24.2 deg; a longer lens
bends an object of unknown depth less, so the stand-in uses that one.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from phys4dgen.render.cameras import intrinsics, look_at
from phys4dgen.types import Camera

__all__ = ["CAMERA_DISTANCE", "FILL", "HALF_HEIGHT", "canonical_camera", "framed", "longest_side"]

FILL = 0.8
"""Share of the picture that the object's longest side takes."""
HALF_HEIGHT = 1.5 * math.tan(math.radians(49.1 / 2))
"""Half the height of the picture in the plane z = 0, units of the splat; LGM's."""
CAMERA_DISTANCE = 3.2
"""Of the stand-in's camera from the plane z = 0."""


def longest_side(alpha: NDArray[np.float32]) -> int:
    """Longest side of the object's box, pixels of the picture."""
    return max(last - first for first, last in _box(alpha))


def framed(rgba: NDArray[np.float32], size_px: int) -> NDArray[np.float32]:
    """The object in the canonical frame.

    Args:
        rgba: straight sRGB and opacity, shape [H, W, 4].
        size_px: side of the result.

    Returns:
        Straight sRGB and opacity, shape [size_px, size_px, 4].
    """
    (top, bottom), (left, right) = _box(rgba[..., 3])
    side = max(bottom - top, right - left) / FILL
    pad = math.ceil(side)
    premultiplied = np.concatenate([rgba[..., :3] * rgba[..., 3:], rgba[..., 3:]], -1)
    padded = np.pad(premultiplied[top:bottom, left:right], ((pad, pad), (pad, pad), (0, 0)))
    centre_y, centre_x = pad + (bottom - top) / 2, pad + (right - left) / 2
    section = (centre_x - side / 2, centre_y - side / 2, centre_x + side / 2, centre_y + side / 2)
    channels = [
        np.asarray(
            Image.fromarray(np.ascontiguousarray(padded[..., c], np.float32)).resize(
                (size_px, size_px), Image.Resampling.BICUBIC, box=section
            )
        )
        for c in range(4)
    ]
    alpha = np.clip(channels[3], 0, 1)
    rgb = np.stack(channels[:3], -1) / np.maximum(alpha[..., None], 1e-4)
    rgb[alpha < 0.02] = 0
    return np.concatenate([np.clip(rgb, 0, 1), alpha[..., None]], -1).astype(np.float32)


def canonical_camera(size_px: int, *, horizon: float = 0.0, upright: NDArray[np.float64] | None = None) -> Camera:
    """The camera that saw the framed picture.

    Args:
        size_px: width and height.
        horizon: height of the camera, units of the splat. The picture stays the one that is centred on the origin: like
            a view camera with its lens shifted, the camera looks straight ahead and its principal point moves.
        upright: rotation from the axes in which the camera looks along -z with y up to those of the splat, [3, 3].
    """
    fovy_deg = 2 * math.degrees(math.atan(HALF_HEIGHT / CAMERA_DISTANCE))
    K = intrinsics(fovy_deg, size_px, size_px)
    K[1, 2] -= horizon * size_px / (2 * HALF_HEIGHT)
    viewmat = look_at([0, horizon, CAMERA_DISTANCE], [0, horizon, 0], [0, 1, 0])
    if upright is not None:
        viewmat[:3, :3] = viewmat[:3, :3] @ upright.T
    return Camera(viewmat=viewmat, K=K, width=size_px, height=size_px)


def _box(alpha: NDArray[np.float32]) -> tuple[tuple[int, int], tuple[int, int]]:
    """First and one past the last row and column of the object."""
    inside = alpha > 0.5
    rows, columns = np.flatnonzero(inside.any(1)), np.flatnonzero(inside.any(0))
    return (int(rows[0]), int(rows[-1]) + 1), (int(columns[0]), int(columns[-1]) + 1)
