"""The film: covariances and colours turned with the motion, every frame rendered."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from phys4dgen.animate import AxisTracker, Deformer
from phys4dgen.progress import Progress
from phys4dgen.render.cameras import video_path
from phys4dgen.render.ground import ShadowPlane
from phys4dgen.render.gsplat_backend import GsplatRasteriser, gsplat_is_ready
from phys4dgen.render.rasterise import Rasteriser
from phys4dgen.scene import Scene
from phys4dgen.stages.asset import Asset
from phys4dgen.stages.motion import Motion
from phys4dgen.stages.overlays import Overlay
from phys4dgen.types import Camera

__all__ = ["Film", "FilmFrame", "film"]


@dataclass(frozen=True, eq=False)
class FilmFrame:
    """One frame as it is rendered and written.

    Attributes:
        index: from 0.
        image: [H, W, 3], uint8.
        means, rotations: of all Gaussians; rotations turn the colours.
        axes: returns quaternions (w, x, y, z) and scales; to be asked of every frame in order, or of none, because
            the axes of a frame continue those of the frame before.
    """

    index: int
    image: NDArray[np.uint8]
    means: NDArray[np.float32]
    rotations: NDArray[np.float32]
    axes: Callable[[], tuple[NDArray[np.float32], NDArray[np.float32]]]


@dataclass(frozen=True, eq=False)
class Film:
    """All frames of the film, made one at a time.

    Attributes:
        fps: of the video.
        times_s: simulated time of each frame, [T].
        cameras: one per frame.
        frames: yields the frames.
    """

    fps: float
    times_s: NDArray[np.float64]
    cameras: list[Camera]
    frames: Callable[[], Iterator[FilmFrame]]


_BACKGROUNDS = {"white": (1.0, 1.0, 1.0), "black": (0.0, 0.0, 0.0), "grey": (0.5, 0.5, 0.5)}


def film(scene: Scene, asset: Asset, motion: Motion, progress: Progress, *, overlay: Overlay | None = None) -> Film:
    """Turn covariances and colours with the motion and render every frame, as it looks or as an overlay shows it."""
    wanted = scene.output.video
    lower, upper = _swept_box(asset, motion)
    extent = upper - lower
    across = math.hypot(extent[0], extent[1])
    if isinstance(wanted.height, str):
        height = int(np.clip(wanted.width * extent[2] / across * 1.05, 0.6 * wanted.width, 1.25 * wanted.width))
        height += height % 2
    else:
        height = wanted.height
    cameras = video_path(
        len(motion.times_s),
        lower=lower,
        upper=upper,
        rotation=asset.frame.rotation,
        width=wanted.width,
        height=height,
        orbit_deg=wanted.orbit_deg,
        elevation_deg=wanted.elevation_deg,
        azimuth_deg=wanted.azimuth_deg,
    )
    gaussians = asset.gaussians
    background = _BACKGROUNDS[wanted.background]
    ground = _ground(asset, motion, lower, upper)

    def frames() -> Iterator[FilmFrame]:
        deformer, tracker, rasteriser = Deformer(gaussians), AxisTracker(gaussians), _rasteriser()
        for k, (positions, gradients) in enumerate(motion.frames()):
            rotations, covariances6 = deformer.deform(gradients)
            picture = rasteriser.render(
                positions,
                covariances6,
                gaussians.opacities,
                camera=cameras[k],
                sh=gaussians.sh if overlay is None else None,
                colors=None if overlay is None else overlay.colors(positions, gradients),
                sh_rotations=rotations if overlay is None else None,
                background=background,
            )
            rgb = picture.rgb
            if ground is not None:
                darkness = ground.darkness(positions, covariances6, gaussians.opacities)
                rgb = ground.composite(picture, darkness, camera=cameras[k], background=background)
            image = np.rint(np.clip(rgb, 0, 1) * 255).astype(np.uint8)
            if overlay is not None:
                image = overlay.annotate(image, float(motion.times_s[k]), positions, cameras[k])
            yield FilmFrame(k, image, positions, rotations, partial(tracker.advance, gradients))
            progress.update(k + 1, len(cameras), "frames rendered")

    fps = scene.fps if isinstance(wanted.fps, str) else wanted.fps
    return Film(fps, motion.times_s, cameras, frames)


def _rasteriser() -> Rasteriser | GsplatRasteriser:
    """The CUDA kernels of gsplat where there is a device for them, else ours."""
    return GsplatRasteriser() if gsplat_is_ready() else Rasteriser()


def _ground(asset: Asset, motion: Motion, lower: NDArray[np.float64], upper: NDArray[np.float64]) -> ShadowPlane | None:
    """What the object's shadow falls on, where there is a ground."""
    height_m = motion.facts.ground_height_m
    if height_m is None:
        return None
    height = height_m / asset.frame.metres_per_unit
    return ShadowPlane(lower=lower, upper=upper, height=height, rotation=asset.frame.rotation)


def _swept_box(asset: Asset, motion: Motion) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The robust box of everything the object passes through, upright axes, input units."""
    # The haze round a capture would make the object small in the picture.
    solid = np.flatnonzero(asset.gaussians.opacities > 0.3)
    visible = solid if len(solid) > 1000 else np.arange(len(asset.gaussians))
    sample = visible[:: max(1, len(visible) // 20_000)]
    lower, upper = np.full(3, np.inf), np.full(3, -np.inf)
    for positions, _ in motion.frames():
        points = positions[sample].astype(np.float64) @ asset.frame.rotation.T
        low, high = np.percentile(points, [0.2, 99.8], axis=0)
        lower, upper = np.minimum(lower, low), np.maximum(upper, high)
    margin = 0.02 * (upper - lower).max()
    return lower - margin, upper + margin
