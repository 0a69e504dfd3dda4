"""Where LGM's four views are seen from, and the rays of their pixels.

World axes: y up; azimuth 0 looks from +z at the front of the object, 90 deg from +x, that is from the viewer's right.
The cameras stand 1.5 from the origin at its height; the object fills [-1, 1] at most.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from phys4dgen.reconstruct.lgm.configuration import VIEWS
from phys4dgen.render.cameras import DEFAULT_FOVY_DEG, intrinsics, look_at
from phys4dgen.types import Camera

__all__ = ["AZIMUTHS_DEG", "CAMERA_RADIUS", "FOVY_DEG", "pluecker_coordinates", "view_cameras"]

CAMERA_RADIUS = 1.5
FOVY_DEG = DEFAULT_FOVY_DEG
AZIMUTHS_DEG = tuple(360 / VIEWS * view for view in range(VIEWS))


def view_cameras(size_px: int) -> tuple[Camera, ...]:
    """The four cameras in the order of the views: front, from the viewer's right, back, from the viewer's left.

    Args:
        size_px: width and height of a view.
    """
    K = intrinsics(FOVY_DEG, size_px, size_px)
    cameras = []
    for azimuth_deg in AZIMUTHS_DEG:
        azimuth = math.radians(azimuth_deg)
        eye = [CAMERA_RADIUS * math.sin(azimuth), 0.0, CAMERA_RADIUS * math.cos(azimuth)]
        cameras.append(Camera(look_at(eye, [0, 0, 0], [0, 1, 0]), K, size_px, size_px))
    return tuple(cameras)


def pluecker_coordinates(camera: Camera) -> NDArray[np.float32]:
    """Moment o x d and unit direction d of the ray through each pixel's centre; shape [6, H, W].

    The moment, unlike the camera's centre o, is the same for every point of the ray.
    """
    u, v = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    in_camera = np.stack([u, v, np.ones_like(u)], -1) @ np.linalg.inv(camera.K).T
    directions = in_camera @ camera.viewmat[:3, :3]
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    moments = np.cross(camera.position, directions)
    return np.moveaxis(np.concatenate([moments, directions], -1), -1, 0).astype(np.float32)
