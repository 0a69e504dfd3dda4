"""Gaussians -> pictures: one view, many views, or the map of which part each pixel shows.

Paper: Sec. 3.2 (multi-view rendering). The arrays-only renderer beneath is ``rasterise``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from queue import SimpleQueue

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from phys4dgen.render.rasterise import WHITE, DepthMode, Rasteriser, RenderResult, packed_covariances
from phys4dgen.types import Camera, Gaussians, Views

__all__ = ["render_gaussians", "render_label_maps", "render_labels", "render_views"]


def render_gaussians(
    gaussians: Gaussians,
    camera: Camera,
    *,
    background: ArrayLike = WHITE,
    depth: DepthMode = "median",
    antialiased: bool = False,
    near: float | None = None,
    rasteriser: Rasteriser | None = None,
) -> RenderResult:
    """Render static Gaussians; the options are those of ``rasterise``."""
    return (rasteriser or Rasteriser()).render(
        gaussians.means, gaussians.covariances(), gaussians.opacities,
        camera=camera, sh=gaussians.sh, background=background, depth=depth, antialiased=antialiased, near=near,
    )  # fmt: skip


def render_labels(
    gaussians: Gaussians, labels: ArrayLike, camera: Camera, *, antialiased: bool = False, near: float | None = None
) -> NDArray[np.int32]:
    """Which label each pixel shows: that of the Gaussian at the median depth, -1 where alpha < 0.5.

    The median picks one Gaussian per pixel, the one that the median depth map shows, so that label and depth always
    speak of the same surface.

    Args:
        gaussians: N Gaussians.
        labels: integers from 0, shape [N].
        camera: the view.
        antialiased: as in ``rasterise``.
        near: as in ``rasterise``.

    Returns:
        Label map, shape [H, W], int32.
    """
    return Rasteriser().render_labels(
        gaussians.means, gaussians.covariances(), gaussians.opacities,
        labels=labels, camera=camera, antialiased=antialiased, near=near,
    )  # fmt: skip


def render_views(
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    *,
    background: ArrayLike = WHITE,
    antialiased: bool = False,
    near: float | None = None,
    threads: int | None = None,
    on_view: Callable[[int], None] | None = None,
) -> Views:
    """Render the same Gaussians from many cameras of one picture size, with median depth.

    Threads take whole pictures, which keeps all cores busy through every stage of the renderer.

    Args:
        gaussians: N Gaussians.
        cameras: V cameras.
        background: RGB behind the Gaussians.
        antialiased: as in ``rasterise``.
        near: as in ``rasterise``.
        threads: pictures rendered at the same time; by default Numba's number of threads.
        on_view: called in the calling thread with the number of pictures done (for a progress bar).
    """
    if not cameras:
        raise ValueError("cameras: expected at least one camera, got none.")
    height, width = cameras[0].height, cameras[0].width
    if any((camera.height, camera.width) != (height, width) for camera in cameras):
        raise ValueError(f"cameras: expected one picture size, got {width} x {height} px and others.")
    v = len(cameras)
    rgb = np.zeros((v, height, width, 3), np.float32)
    alpha = np.zeros((v, height, width), np.float32)
    depth = np.zeros((v, height, width), np.float32)
    covariances = packed_covariances(gaussians.covariances())

    def render_view(rasteriser: Rasteriser, i: int) -> None:
        picture = rasteriser.render(
            gaussians.means, covariances, gaussians.opacities,
            camera=cameras[i], sh=gaussians.sh, background=background, antialiased=antialiased, near=near,
        )  # fmt: skip
        rgb[i], alpha[i], depth[i] = picture.rgb, picture.alpha, picture.depth

    for done in _each_view(render_view, v, threads):
        if on_view is not None:
            on_view(done)
    return Views(cameras=tuple(cameras), rgb=rgb, alpha=alpha, depth=depth)


def render_label_maps(gaussians: Gaussians, labels: ArrayLike, cameras: Sequence[Camera]) -> NDArray[np.int32]:
    """``render_labels`` from many cameras of one picture size, several at a time; shape [V, H, W]."""
    covariances = packed_covariances(gaussians.covariances())
    maps = np.zeros((len(cameras), cameras[0].height, cameras[0].width), np.int32)

    def render_map(rasteriser: Rasteriser, i: int) -> None:
        maps[i] = rasteriser.render_labels(
            gaussians.means, covariances, gaussians.opacities, labels=labels, camera=cameras[i]
        )

    for _ in _each_view(render_map, len(cameras), None):
        pass
    return maps


def _each_view(draw: Callable[[Rasteriser, int], None], count: int, threads: int | None) -> Iterator[int]:
    """Draw views 0 .. count-1, ``threads`` at a time, each with a renderer of its own; yields how many are done."""
    workers = min(count, numba.get_num_threads() if threads is None else threads)
    idle: SimpleQueue[Rasteriser] = SimpleQueue()
    for _ in range(workers):
        idle.put(Rasteriser(threads=1))

    def with_renderer(i: int) -> None:
        rasteriser = idle.get()
        try:
            draw(rasteriser, i)
        finally:
            idle.put(rasteriser)

    with ThreadPoolExecutor(workers, "views") as pool:
        for done, _ in enumerate(pool.map(with_renderer, range(count)), start=1):
            yield done
