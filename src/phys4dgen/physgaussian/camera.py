"""PhysGaussian's camera -> the path of our film."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.physgaussian.configuration import Configuration
from phys4dgen.physgaussian.placement import Placement
from phys4dgen.types import rotation_to_z_up

__all__ = ["film_of"]

MAX_FILE_BYTES = 64 * 2**20
_STEEPEST_DEG = 89.0
_LONGEST_DEG = 3600.0


def film_of(config: Configuration, placement: Placement, folder: Path, notes: list[str]) -> dict[str, float]:
    """Azimuth and elevation of the camera and the angle that it travels, as ``output.video`` has them.

    Its distance and lens are not carried over: our film is framed by itself.

    Args:
        config: the configuration.
        placement: of the object in MPM space.
        folder: of the splat, with cameras.json.
        notes: what differs is added to it.
    """
    up = np.array(config.mpm_space_vertical_upward_axis)
    if np.linalg.norm(up) < 1e-9:
        notes.append("mpm_space_vertical_upward_axis: has no direction; the film looks from the front.")
        return {}
    up = up / np.linalg.norm(up)
    travel_deg = 0.0
    if config.default_camera_index >= 0:
        center = placement.point(config.mpm_space_viewpoint_center)
        seen_from = _training_camera(folder / "cameras.json", config.default_camera_index)
        if seen_from is None:
            notes.append(
                f"default_camera_index: cameras.json has no camera {config.default_camera_index}; the film looks "
                "from the front."
            )
            return {}
        direction = seen_from - np.array(center)
        notes.append("default_camera_index: the film looks from where that camera stood, framed by itself.")
    else:
        direction = np.array(placement.vector(_orbit_direction(config, up)))
        if config.move_camera:
            travel_deg = (config.delta_a or 0.0) * (config.frame_num - 1)
            travel_deg = min(max(travel_deg, -_LONGEST_DEG), _LONGEST_DEG)
        lost = [key for key in ("init_radius", "delta_e", "delta_r") if getattr(config, key)]
        if lost:
            notes.append(f"{', '.join(lost)}: not carried over, the film is framed by itself at one elevation.")
    in_world = rotation_to_z_up(np.array(placement.vector(up))) @ (direction / np.linalg.norm(direction))
    elevation_deg = math.degrees(math.asin(float(np.clip(in_world[2], -1, 1))))
    # the orbit of PhysGaussian turns with h1 -> h2 = h1 x up, clockwise seen from above
    azimuth_deg = math.degrees(math.atan2(in_world[0], -in_world[1])) - travel_deg / 2
    return {
        "azimuth_deg": round((azimuth_deg + 180) % 360 - 180, 6) + 0.0,
        "elevation_deg": round(min(max(elevation_deg, -_STEEPEST_DEG), _STEEPEST_DEG), 6) + 0.0,
        "orbit_deg": round(-travel_deg, 6) + 0.0,
    }


def _orbit_direction(config: Configuration, up: NDArray[np.float64]) -> NDArray[np.float64]:
    """From the centre to the camera in MPM space, unit length."""
    first = np.ones(3) - up.sum() * up
    if np.linalg.norm(first) < 1e-6:
        first = np.eye(3)[np.argmin(np.abs(up))] - up[np.argmin(np.abs(up))] * up
    first = first / np.linalg.norm(first)
    second = np.cross(first, up)
    azimuth, elevation = math.radians(config.init_azimuthm or 0.0), math.radians(config.init_elevation or 0.0)
    level = math.cos(azimuth) * first + math.sin(azimuth) * second
    return math.cos(elevation) * level + math.sin(elevation) * up


def _training_camera(path: Path, index: int) -> NDArray[np.float64] | None:
    """Where a camera of cameras.json stood; None where there is none."""
    if not path.is_file() or path.stat().st_size > MAX_FILE_BYTES:
        return None
    try:
        cameras: Any = json.loads(path.read_text("utf-8"))
        position = np.array(cameras[index]["position"], np.float64)
    except (ValueError, LookupError, TypeError, RecursionError):
        return None
    return position if position.shape == (3,) and np.isfinite(position).all() else None
