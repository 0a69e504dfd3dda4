"""Solid obstacles in a film: smooth translucent bodies, so that what they press can be seen through them.

A body is a box with rounded edges, which is a ball where the box is a point and a rod where it is a line. Plates and
blocks are drawn as the sharp box around them, by slabs; balls and rods by sphere tracing (J. C. Hart, 1996). Four rays
per pixel smooth the edges.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phys4dgen.render.rasterise import RenderResult
from phys4dgen.types import Camera

__all__ = ["Solid", "composite_solids"]

_COLOR = np.array([0.56, 0.62, 0.70])
_OPACITY = 0.62
_LIGHT = np.array([-0.35, -0.65, -0.67])  # camera axes, towards the light: up, to the left and behind the camera
_AMBIENT = 0.62
_STEPS = 20
_SUBPIXELS = ((0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75))


@dataclass(frozen=True, eq=False)
class Solid:
    """All points within ``radius`` of a box, input coordinates.

    Attributes:
        center: of the box, [3].
        half: half its edges, [3].
        radius: of the rounding.
        axes: its axes as columns, [3, 3].
    """

    center: NDArray[np.float64]
    half: NDArray[np.float64]
    radius: float
    axes: NDArray[np.float64]

    @property
    def corners(self) -> NDArray[np.float64]:
        """The corners of the box around it, [8, 3]."""
        signs = np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3, indexing="ij"), -1).reshape(-1, 3)
        return self.center + signs * (self.half + self.radius) @ self.axes.T


def composite_solids(
    picture: RenderResult,
    rgb: NDArray[np.float32],
    solids: list[Solid],
    *,
    camera: Camera,
    background: ArrayLike,
) -> NDArray[np.float32]:
    """The picture with solids in front of and behind what it shows, [H, W, 3].

    Args:
        picture: as rendered over ``background``; its alpha and depth say what is in front.
        rgb: the picture with what else was drawn, [H, W, 3].
        solids: drawn in the order of their distance.
        camera: of the picture.
        background: colour behind everything.
    """
    image = rgb.astype(np.float64)
    behind = np.asarray(background, np.float64)
    far = [float(camera.viewmat[2, :3] @ solid.center) for solid in solids]
    for index in np.argsort(far)[::-1]:
        window = _window(solids[index], camera)
        if window is None:
            continue
        rows, columns = window
        alpha, depth = picture.alpha[rows, columns], picture.depth[rows, columns]
        seen = np.where(alpha > 0.5, depth, np.inf)
        here = image[rows, columns]
        for dx, dy in _SUBPIXELS:
            hit, shade = _seen(solids[index], camera, rows, columns, dx, dy)
            share = _OPACITY / len(_SUBPIXELS) * np.isfinite(hit)
            color = _COLOR * shade[..., None]
            in_front = hit < seen
            cover = np.where(in_front, share, 0.0)[..., None]
            here = here + cover * (color - image[rows, columns])
            through = np.where(in_front, 0.0, share * (1 - alpha))[..., None]
            here = here + through * (color - behind)
        image[rows, columns] = here
    return image.astype(np.float32)


def _window(solid: Solid, camera: Camera) -> tuple[slice, slice] | None:
    """Rows and columns of the picture that the solid may cover."""
    points = solid.corners @ camera.viewmat[:3, :3].T + camera.viewmat[:3, 3]
    if (points[:, 2] <= 1e-6).any():
        return slice(0, camera.height), slice(0, camera.width)
    u, v, w = camera.K @ points.T
    left, top = np.floor([(u / w).min(), (v / w).min()]).astype(int) - 1
    right, bottom = np.ceil([(u / w).max(), (v / w).max()]).astype(int) + 1
    left, top = max(left, 0), max(top, 0)
    right, bottom = min(right, camera.width), min(bottom, camera.height)
    return None if right <= left or bottom <= top else (slice(top, bottom), slice(left, right))


def _seen(
    solid: Solid, camera: Camera, rows: slice, columns: slice, dx: float, dy: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Depth along the optical axis (infinite where the ray misses) and brightness, [H, W], through points of pixels."""
    K, rotation = camera.K, camera.viewmat[:3, :3]
    u, v = np.meshgrid(np.arange(columns.start, columns.stop) + dx, np.arange(rows.start, rows.stop) + dy)
    rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones_like(u)], -1)
    eye = (-rotation.T @ camera.viewmat[:3, 3] - solid.center) @ solid.axes
    rays = rays @ (rotation @ solid.axes)
    reach = solid.half + solid.radius
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (-reach - eye) / rays, (reach - eye) / rays
    enters, leaves = np.minimum(first, second), np.maximum(first, second)
    axis = enters.argmax(-1)
    near, far = enters.max(-1), leaves.min(-1)
    hit = np.where((near < far) & (near > 0), near, np.inf)
    normals = -np.sign(np.take_along_axis(rays, axis[..., None], -1)) * np.eye(3)[axis]
    if (solid.half < 0.25 * solid.radius).any():  # a ball or a rod
        found = np.isfinite(hit)
        hit[found], normals[found] = _traced(solid, eye, rays[found], near[found], far[found])
    light = (_LIGHT / np.linalg.norm(_LIGHT)) @ rotation @ solid.axes
    return hit, _AMBIENT + (1 - _AMBIENT) * np.maximum(normals @ light, 0)


def _traced(
    solid: Solid,
    eye: NDArray[np.float64],
    rays: NDArray[np.float64],
    near: NDArray[np.float64],
    far: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Depth and normal [n, 3] of the rounded body on rays that meet the box around it; infinite where they miss."""
    lengths = np.linalg.norm(rays, axis=-1)
    depth = near.copy()
    away = np.zeros(len(rays))
    outside = np.zeros_like(rays)
    for _ in range(_STEPS):
        points = eye + depth[:, None] * rays
        outside = np.sign(points) * np.maximum(np.abs(points) - solid.half, 0)
        away = np.linalg.norm(outside, axis=1) - solid.radius
        depth = depth + np.maximum(away, 0) / lengths
    hits = (away < 0.02 * solid.radius) & (depth < far)
    normals = outside / np.maximum(np.linalg.norm(outside, axis=1), 1e-12)[:, None]
    return np.where(hits, depth, np.inf), normals
