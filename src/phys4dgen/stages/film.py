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
from phys4dgen.render.solids import Solid, composite_solids
from phys4dgen.scene import Scene
from phys4dgen.stages.asset import Asset
from phys4dgen.stages.backdrop import Backdrop
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
        means, rotations: of the object's Gaussians; rotations turn the colours.
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


_OBSTACLE_MARGIN = 0.15
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
        backdrop = Backdrop(asset, is_overlay=overlay is not None)
        for k, (positions, gradients) in enumerate(motion.frames()):
            rotations, covariances6 = deformer.deform(gradients)
            picture = backdrop.render(
                rasteriser,
                positions,
                covariances6,
                rotations,
                camera=cameras[k],
                background=background,
                colors=None if overlay is None else overlay.colors(positions, gradients),
            )
            rgb = picture.rgb
            if ground is not None:
                darkness = ground.darkness(positions, covariances6, gaussians.opacities)
                rgb = ground.composite(picture, darkness, camera=cameras[k], background=background)
            solids = _solids_at(asset, motion, k)
            if solids:
                rgb = composite_solids(picture, rgb, solids, camera=cameras[k], background=background)
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


def _solids_at(asset: Asset, motion: Motion, frame: int) -> list[Solid]:
    """The obstacles that are there in a frame, where they are."""
    facts, time_s = motion.facts, float(motion.times_s[frame])
    found = []
    for drawn in facts.obstacles:
        if drawn["from_s"] <= time_s and (drawn["to_s"] is None or time_s < drawn["to_s"]):
            shift = asset.frame.from_metres(np.array(facts.obstacle_shifts_m[frame][drawn["number"]]))
            half, axes = np.array(drawn["half"], np.float64), np.array(drawn["axes"], np.float64)
            found.append(Solid(np.array(drawn["center"]) + shift, half, float(drawn["radius"]), axes))
    return found


def _swept_box(asset: Asset, motion: Motion) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The robust box of everything the object passes through, upright axes, input units."""
    # The haze round a capture would make the object small in the picture.
    solid = np.flatnonzero(asset.gaussians.opacities > 0.3)
    visible = solid if len(solid) > 1000 else np.arange(len(asset.gaussians))
    sample = visible[:: max(1, len(visible) // 20_000)]
    lower, upper = np.full(3, np.inf), np.full(3, -np.inf)
    corners: list[NDArray[np.float64]] = []
    for k, (positions, _) in enumerate(motion.frames()):
        points = positions[sample].astype(np.float64) @ asset.frame.rotation.T
        low, high = np.percentile(points, [0.2, 99.8], axis=0)
        lower, upper = np.minimum(lower, low), np.maximum(upper, high)
        corners += [solid.corners @ asset.frame.rotation.T for solid in _solids_at(asset, motion, k)]
    if corners:  # so much of the obstacles as does not make the object small
        reach = _OBSTACLE_MARGIN * (upper - lower).max()
        around = np.concatenate(corners)
        lower = np.maximum(np.minimum(lower, around.min(0)), lower - reach)
        upper = np.minimum(np.maximum(upper, around.max(0)), upper + reach)
    margin = 0.02 * (upper - lower).max()
    return lower - margin, upper + margin
