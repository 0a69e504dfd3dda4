"""Cameras that look at an object: look-at, orbits, views fitted to a box, the path of a video.

Paper: Sec. 3.2 (multi-view rendering); ARCHITECTURE.md 2, Views. Directions are given in the z-up axes of
``Frame.rotation``: azimuth 0 looks at the object from -y, azimuth grows counterclockwise seen from above (90 deg is
the view from +x), elevation 90 deg looks straight down. Cameras themselves live in the input's coordinates, OpenCV
axes (x right, y down, z forward).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phys4dgen.render.view_table import ViewPreset, view_directions
from phys4dgen.types import Camera

__all__ = ["DEFAULT_FOVY_DEG", "VIDEO_FOVY_DEG", "intrinsics", "look_at", "orbit_camera", "video_path", "view_cameras"]

DEFAULT_FOVY_DEG = 49.1
"""Vertical field of view of LGM's cameras, the paper's."""

VIDEO_FOVY_DEG = 30.0
"""Vertical field of view of videos: the mild perspective of a portrait lens."""

_FILL = 0.9  # of the picture by the box; the object itself, rounder than its box, then takes 70 to 90 %


def look_at(eye: ArrayLike, target: ArrayLike, up: ArrayLike) -> NDArray[np.float64]:
    """The viewmat of a camera at ``eye`` that looks at ``target``.

    Args:
        eye: camera centre, shape [3].
        target: point that lands on the optical axis, shape [3]; must differ from ``eye``.
        up: any vector that points up in the picture, shape [3]. Where it is parallel to the line of sight, the
            coordinate axis least parallel to that line stands in.

    Returns:
        World -> camera, shape [4, 4].
    """
    eye, target, up = (np.asarray(v, np.float64) for v in (eye, target, up))
    forward = target - eye
    distance = np.linalg.norm(forward)
    if not (np.isfinite(distance) and distance > 0):
        raise ValueError(f"eye, target: expected two different points, got {eye.tolist()} and {target.tolist()}.")
    forward = forward / distance
    right = np.cross(forward, up)
    if np.linalg.norm(right) <= 1e-9 * np.linalg.norm(up):
        right = np.cross(forward, np.eye(3)[np.argmin(np.abs(forward))])
    right = right / np.linalg.norm(right)
    viewmat = np.eye(4)
    viewmat[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    viewmat[:3, 3] = -viewmat[:3, :3] @ eye
    return viewmat


def intrinsics(fovy_deg: float, width: int, height: int) -> NDArray[np.float64]:
    """The matrix K of square pixels, principal point in the middle; shape [3, 3], pixels.

    Args:
        fovy_deg: vertical field of view.
        width: pixels.
        height: pixels.
    """
    if not 0 < fovy_deg < 180:
        raise ValueError(f"fovy_deg: expected an angle between 0 and 180, got {fovy_deg}.")
    focal = 0.5 * height / math.tan(0.5 * math.radians(fovy_deg))
    return np.array([[focal, 0, 0.5 * width], [0, focal, 0.5 * height], [0, 0, 1]])


def orbit_camera(
    *,
    azimuth_deg: float,
    elevation_deg: float,
    target: ArrayLike,
    rotation: ArrayLike,
    radius: float,
    fovy_deg: float,
    width: int,
    height: int,
) -> Camera:
    """A camera on a sphere around ``target``.

    Args:
        azimuth_deg: 0 is the view from -y of the z-up axes, 90 the one from +x.
        elevation_deg: above the horizon; at +-90 the picture's up is the limit of the views of that azimuth.
        target: centre of the sphere, input coordinates, shape [3].
        rotation: input axes -> z-up axes, shape [3, 3] (``Frame.rotation``).
        radius: of the sphere, input units.
        fovy_deg: vertical field of view.
        width: pixels.
        height: pixels.
    """
    axes = _camera_axes(azimuth_deg, elevation_deg) @ np.asarray(rotation, np.float64)
    viewmat = np.eye(4)
    viewmat[:3, :3] = axes
    viewmat[:3, 3] = -axes @ np.asarray(target, np.float64)
    viewmat[2, 3] += radius
    return Camera(viewmat=viewmat, K=intrinsics(fovy_deg, width, height), width=width, height=height)


def view_cameras(
    preset: ViewPreset,
    *,
    lower: ArrayLike,
    upper: ArrayLike,
    rotation: ArrayLike,
    size_px: int,
    fovy_deg: float = DEFAULT_FOVY_DEG,
) -> tuple[Camera, ...]:
    """The square views of a preset, each as close as the box allows: the box spans 90 % of the picture.

    The camera is moved sideways as well, so that the box is centred in the picture: in perspective the middle of a box
    is not the middle of its outline.

    Args:
        preset: a row of the view table, see ``view_directions``.
        lower: lower corner of the box, z-up axes, input units, shape [3] (``Gaussians.robust_bounds``).
        upper: upper corner.
        rotation: input axes -> z-up axes, shape [3, 3].
        size_px: width and height.
        fovy_deg: field of view.
    """
    K = intrinsics(fovy_deg, size_px, size_px)
    rotation = np.asarray(rotation, np.float64)
    corners = _box_corners(lower, upper)
    slope = _FILL * math.tan(0.5 * math.radians(fovy_deg))
    cameras = []
    for azimuth_deg, elevation_deg in view_directions(preset):
        axes = _camera_axes(azimuth_deg, elevation_deg)
        eye = _tightest_eye(corners @ axes.T, slope)
        viewmat = np.eye(4)
        viewmat[:3, :3] = axes @ rotation
        viewmat[:3, 3] = -eye
        cameras.append(Camera(viewmat=viewmat, K=K, width=size_px, height=size_px))
    return tuple(cameras)


def video_path(
    frame_count: int,
    *,
    lower: ArrayLike,
    upper: ArrayLike,
    rotation: ArrayLike,
    width: int,
    height: int,
    orbit_deg: float = 60.0,
    elevation_deg: float = 15.0,
    azimuth_deg: float = 0.0,
    fovy_deg: float = VIDEO_FOVY_DEG,
    fill: float = _FILL,
) -> list[Camera]:
    """An orbit that starts and ends at rest, at one distance from which the box is never cut.

    Args:
        frame_count: number of cameras.
        lower: lower corner of the box that stays in the picture, z-up axes, input units, shape [3].
        upper: upper corner.
        rotation: input axes -> z-up axes, shape [3, 3].
        width: pixels.
        height: pixels.
        orbit_deg: angle travelled counterclockwise (seen from above), half before and half after ``azimuth_deg``.
        elevation_deg: of all cameras.
        azimuth_deg: of the middle of the path.
        fovy_deg: vertical field of view.
        fill: largest share of width or height that the box takes.
    """
    if frame_count < 1:
        raise ValueError(f"frame_count: expected at least 1, got {frame_count}.")
    if not 0 < fill <= 1:
        raise ValueError(f"fill: expected a share in (0, 1], got {fill}.")
    corners = _box_corners(lower, upper)
    centre = corners.mean(axis=0)
    t = np.linspace(0, 1, frame_count) if frame_count > 1 else np.array([0.5])
    eased = t * t * t * (t * (6 * t - 15) + 10)  # smootherstep: no velocity and no acceleration at either end
    azimuths_deg = azimuth_deg + orbit_deg * (eased - 0.5)
    slope_y = fill * math.tan(0.5 * math.radians(fovy_deg))
    slopes = np.array([slope_y * width / height, slope_y])
    radius = 0.0
    for azimuth in azimuths_deg:
        points = (corners - centre) @ _camera_axes(azimuth, elevation_deg).T
        needed = np.abs(points[:, :2]) / slopes - points[:, 2:]
        radius = max(radius, float(needed.max()))
    target = centre @ np.asarray(rotation, np.float64)
    return [
        orbit_camera(
            azimuth_deg=float(azimuth),
            elevation_deg=elevation_deg,
            target=target,
            rotation=rotation,
            radius=radius,
            fovy_deg=fovy_deg,
            width=width,
            height=height,
        )
        for azimuth in azimuths_deg
    ]


def _camera_axes(azimuth_deg: float, elevation_deg: float) -> NDArray[np.float64]:
    """Right, down and forward of a camera on the orbit as rows, z-up axes.

    Up in the picture is the derivative of the direction by elevation, which the poles have too.
    """
    sin_a, cos_a = math.sin(math.radians(azimuth_deg)), math.cos(math.radians(azimuth_deg))
    sin_e, cos_e = math.sin(math.radians(elevation_deg)), math.cos(math.radians(elevation_deg))
    right = [cos_a, sin_a, 0.0]
    down = [sin_e * sin_a, -sin_e * cos_a, -cos_e]
    forward = [-cos_e * sin_a, cos_e * cos_a, -sin_e]
    return np.array([right, down, forward])


def _box_corners(lower: ArrayLike, upper: ArrayLike) -> NDArray[np.float64]:
    """The eight corners; a box without extent is given one, so that it can be looked at from a distance."""
    lower, upper = np.asarray(lower, np.float64), np.asarray(upper, np.float64)
    if lower.shape != (3,) or upper.shape != (3,) or not (lower <= upper).all():
        raise ValueError(f"lower, upper: expected two corners with lower <= upper, got {lower} and {upper}.")
    centre = 0.5 * (lower + upper)
    longest = float((upper - lower).max()) or 1.0
    half = np.maximum(0.5 * (upper - lower), 1e-3 * longest)
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return centre + signs * half


def _tightest_eye(points: NDArray[np.float64], slope: float) -> NDArray[np.float64]:
    """Camera centre, in camera axes, closest to ``points`` with |x|, |y| <= slope * depth for all of them.

    Each side of the picture is a plane through the centre and bounds it linearly: with a = max(x - slope z) and
    b = max(-x - slope z), the centre (cx, cz) must obey a <= cx - slope cz and b <= -cx - slope cz.

    Args:
        points: shape [N, 3], camera axes.
        slope: tangent of half the angle that the points may take.
    """
    lateral, z = points[:, :2], points[:, 2:]
    a = (lateral - slope * z).max(axis=0)
    b = (-lateral - slope * z).max(axis=0)
    return np.array([*(0.5 * (a - b)), float((-(a + b) / (2 * slope)).min())])
