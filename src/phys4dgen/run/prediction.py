"""How much disk a run will take, told before it starts."""

from __future__ import annotations

from phys4dgen.scene import Scene
from phys4dgen.types import Gaussians

__all__ = ["peak_bytes", "predicted_bytes"]

_TRAJECTORY_BYTES = 4 * (3 + 9)
"""Per Gaussian and frame: position and F, float32."""
_VIEW_BYTES_PER_PIXEL = 3.0
"""PNGs of colour, mask, depth and parts together, as measured on captures."""
_FILM_BYTES_PER_PIXEL = 0.1
_VIEW_COUNTS = {"object": 29, "carve": 49, "scene": 120}


def predicted_bytes(scene: Scene, gaussians: Gaussians) -> int:
    """Bytes that all files of the run will take, to about 10 % where frames are written."""
    n, coefficients = gaussians.sh.shape[:2]
    ply = n * 4 * (17 + 3 * (coefficients - 1))
    frames = scene.frame_count if scene.output.frames == "ply" else 0
    trajectory = n * scene.frame_count * _TRAJECTORY_BYTES
    views = _VIEW_COUNTS[scene.views.preset] * scene.views.size_px**2 * _VIEW_BYTES_PER_PIXEL
    video = scene.output.video
    height = video.width if isinstance(video.height, str) else video.height
    film = scene.frame_count * video.width * height * _FILM_BYTES_PER_PIXEL
    return int(ply * (frames + 1) + trajectory + views + film)


def peak_bytes(scene: Scene, gaussians: Gaussians) -> int:
    """Bytes that the run takes at most: while the trajectory is written it lies there twice, before any frame file."""
    trajectory = len(gaussians) * scene.frame_count * _TRAJECTORY_BYTES
    without_frames = scene.with_overrides({"output.frames": "none"})
    return max(predicted_bytes(scene, gaussians), predicted_bytes(without_frames, gaussians) + trajectory)
