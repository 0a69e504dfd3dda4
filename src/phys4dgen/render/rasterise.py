"""Arrays of Gaussians + camera -> picture: the stages of the CPU renderer put together.

Paper: Sec. C.1. The names and rules are gsplat's (viewmat, K, pixel centres at +0.5, 0.3 px^2 blur, alpha >= 1/255);
the stages are ``projection``, ``tiles`` and ``compositing``. All kernels release the GIL and work on slices, so that
threads are plain Python threads and the picture is bitwise the same for any number of them.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Literal

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from phys4dgen.render.compositing import composite_expected, composite_median
from phys4dgen.render.projection import RECORD_SIZE, TILE_PX, project_gaussians
from phys4dgen.render.tiles import count_tile_pairs, fill_tile_lists, prefix_tile_counts, sort_by_depth
from phys4dgen.types import Camera
from phys4dgen.types.checks import checked_array

__all__ = [
    "WHITE",
    "DepthMode",
    "Rasteriser",
    "RenderResult",
    "default_near",
    "packed_covariances",
    "rasterise",
]

DepthMode = Literal["median", "expected"]

WHITE = (1.0, 1.0, 1.0)

MAX_PAIRS_PER_BAND = 1 << 26
"""(Gaussian, tile) pairs listed at once (256 MB); a picture with more is composited in bands of tile rows."""

_MAX_LABEL = 1 << 24  # labels travel as float32, which is exact up to here
_NEAR_SAMPLES = 1024


@dataclass(frozen=True, eq=False)
class RenderResult:
    """One picture.

    Attributes:
        rgb: colours over the background, shape [H, W, 3], float32.
        alpha: accumulated opacity, shape [H, W], float32.
        depth: along the optical axis, input units, 0 where there is none, shape [H, W], float32. Median: the depth of
            the Gaussian at which transmittance falls through 0.5; expected: the alpha-weighted mean.
    """

    rgb: NDArray[np.float32]
    alpha: NDArray[np.float32]
    depth: NDArray[np.float32]


def packed_covariances(covariances: ArrayLike) -> NDArray[np.float32]:
    """Symmetric matrices [N, 3, 3], or already packed [N, 6], as xx, xy, xz, yy, yz, zz; shape [N, 6], float32."""
    array = np.asarray(covariances)
    if array.ndim == 3 and array.shape[1:] == (3, 3):
        upper = array.reshape(-1, 9)[:, [0, 1, 2, 4, 5, 8]]
        return np.ascontiguousarray(upper, np.float32)
    if array.ndim == 2 and array.shape[1] == 6:
        return np.ascontiguousarray(array, np.float32)
    raise ValueError(f"covariances: expected shape (N, 3, 3) or (N, 6), got {array.shape}.")


def default_near(means: NDArray[Any], camera: Camera) -> float:
    """Nearest depth drawn when none is asked for: 1 % of the median depth of what lies in front of the camera.

    It follows the scale of the input, which may be in any unit; at LGM's unit scale it is gsplat's 0.01.
    """
    sample = means[:: max(1, len(means) // _NEAR_SAMPLES)]
    with np.errstate(invalid="ignore", over="ignore"):  # NaN and infinity are dropped in the next line
        depth = sample @ camera.viewmat[2, :3] + camera.viewmat[2, 3]
    depth = depth[(depth > 0) & (depth < np.inf)]
    return 0.01 * float(np.median(depth)) if len(depth) else 0.0


class Rasteriser:
    """Renders pictures one after another in the same scratch memory.

    One instance serves one thread at a time. Rendering many frames through one instance saves allocating about
    150 bytes per Gaussian and frame.

    Args:
        threads: threads within a picture; by default Numba's (``numba.get_num_threads``).
    """

    def __init__(self, threads: int | None = None) -> None:
        self.threads = numba.get_num_threads() if threads is None else threads
        if self.threads < 1:
            raise ValueError(f"threads: expected at least 1, got {threads}.")
        self._pool = ThreadPoolExecutor(self.threads - 1, "raster") if self.threads > 1 else None
        self._reserve(0)
        self._tile_lists = np.zeros(0, np.int32)

    def render(
        self,
        means: ArrayLike,
        covariances: ArrayLike,
        opacities: ArrayLike,
        *,
        camera: Camera,
        sh: ArrayLike | None = None,
        colors: ArrayLike | None = None,
        background: ArrayLike = WHITE,
        depth: DepthMode = "median",
        antialiased: bool = False,
        sh_rotations: ArrayLike | None = None,
        near: float | None = None,
    ) -> RenderResult:
        """Render one picture; the arguments are those of ``rasterise``."""
        if depth not in ("median", "expected"):
            raise ValueError(f"depth: expected 'median' or 'expected', got {depth!r}.")
        composite = composite_median if depth == "median" else composite_expected
        return self._render(
            means, covariances, opacities, camera, composite,
            sh=sh, colors=colors, background=background, antialiased=antialiased, sh_rotations=sh_rotations, near=near,
        )  # fmt: skip

    def render_labels(
        self,
        means: ArrayLike,
        covariances: ArrayLike,
        opacities: ArrayLike,
        *,
        labels: ArrayLike,
        camera: Camera,
        antialiased: bool = False,
        near: float | None = None,
    ) -> NDArray[np.int32]:
        """Label of the Gaussian at the median depth of each pixel, -1 where alpha < 0.5; shape [H, W]."""
        n = len(np.asarray(means))
        label_array = np.asarray(labels)
        if label_array.shape != (n,) or label_array.dtype.kind not in "iu":
            got = f"{label_array.dtype} of shape {label_array.shape}"
            raise ValueError(f"labels: expected integers of shape ({n},), got {got}.")
        if n and (label_array.min() < 0 or label_array.max() >= _MAX_LABEL):
            got = f"[{label_array.min()}, {label_array.max()}]"
            raise ValueError(f"labels: expected numbers from 0 to {_MAX_LABEL - 1}, got {got}.")
        picture = self._render(
            means, covariances, opacities, camera, composite_median,
            colors=np.zeros((n, 3), np.float32), antialiased=antialiased, near=near,
            payloads=label_array.astype(np.float32), empty=-1,
        )  # fmt: skip
        return picture.depth.astype(np.int32)

    def _render(
        self,
        means: ArrayLike,
        covariances: ArrayLike,
        opacities: ArrayLike,
        camera: Camera,
        composite: Callable[..., None],
        *,
        sh: ArrayLike | None = None,
        colors: ArrayLike | None = None,
        background: ArrayLike = WHITE,
        antialiased: bool = False,
        sh_rotations: ArrayLike | None = None,
        near: float | None = None,
        payloads: ArrayLike = (),
        empty: float = 0,
    ) -> RenderResult:
        # Read-only views throughout: Numba compiles one specialisation, not one per caller's writeability.
        means = _kernel_array(means, "means", (None, 3))
        n = len(means)
        covariances = _kernel_array(packed_covariances(covariances), "covariances", (n, 6))
        opacities = _kernel_array(opacities, "opacities", (n,))
        if sh is not None and colors is None:
            shading = _kernel_array(sh, "sh", (n, None, 3))
            sh_degree = {1: 0, 4: 1, 9: 2, 16: 3}.get(shading.shape[1], -1)
            if sh_degree < 0:
                raise ValueError(f"sh: expected 1, 4, 9 or 16 coefficients per channel, got {shading.shape[1]}.")
        elif colors is not None and sh is None:
            shading = _kernel_array(_kernel_array(colors, "colors", (n, 3))[:, None], "colors", (n, 1, 3))
            sh_degree = -1
        else:
            raise ValueError(f"sh, colors: expected exactly one of the two, got {'none' if sh is None else 'both'}.")
        turns = np.zeros((0, 3, 3)) if sh_rotations is None else sh_rotations
        turns = _kernel_array(turns, "sh_rotations", (0 if sh_rotations is None else n, 3, 3))
        payloads = _kernel_array(payloads, "payloads", (None,))
        background = _kernel_array(background, "background", (3,))
        near = default_near(means, camera) if near is None else float(near)
        if not near >= 0:
            raise ValueError(f"near: expected a depth of 0 or more, got {near}.")

        width, height = camera.width, camera.height
        columns, rows = -(-width // TILE_PX), -(-height // TILE_PX)
        self._reserve(n)
        self._in_slices(
            project_gaussians,
            means, covariances, opacities, shading, sh_degree, turns, payloads, camera.viewmat, camera.K,
            width, height, near, bool(antialiased), self._records, self._keys, self._rects,
        )  # fmt: skip
        count = sort_by_depth(self._keys[:n], self._order, self._keys_scratch, self._order_scratch)
        counts = np.zeros((self.threads, rows * columns), np.int64)
        starts = np.zeros(rows * columns + 1, np.int64)
        self._in_slices(count_tile_pairs, self._order, count, self._rects, self._sorted_rects, columns, counts)
        prefix_tile_counts(counts, starts)

        rgb = np.zeros((height, width, 3), np.float32)
        alpha = np.zeros((height, width), np.float32)
        depth = np.zeros((height, width), np.float32)
        for first, last in _bands(starts[::columns], MAX_PAIRS_PER_BAND):
            tile_first, tile_end = first * columns, (last + 1) * columns
            base = int(starts[tile_first])
            pairs = int(starts[tile_end]) - base
            if pairs > len(self._tile_lists):
                self._tile_lists = np.zeros(pairs + pairs // 4, np.int32)
            self._in_slices(
                fill_tile_lists,
                self._order, count, self._sorted_rects, columns, first, last, base, counts, self._tile_lists,
            )  # fmt: skip
            self._in_slices(
                composite,
                self._records, self._tile_lists, starts, tile_first, tile_end, background, np.float32(empty),
                rgb, alpha, depth,
            )  # fmt: skip
        return RenderResult(rgb=rgb, alpha=alpha, depth=depth)

    def _reserve(self, n: int) -> None:
        """Make the per-Gaussian scratch arrays hold at least n Gaussians."""
        if n and n <= len(self._records):
            return
        self._records = np.zeros((n, RECORD_SIZE), np.float32)
        self._keys = np.zeros(n, np.uint32)
        self._keys_scratch = np.zeros(n, np.uint32)
        self._order = np.zeros(n, np.int32)
        self._order_scratch = np.zeros(n, np.int32)
        self._rects = np.zeros((n, 4), np.int16)
        self._sorted_rects = np.zeros((n, 4), np.int16)

    def _in_slices(self, kernel: Callable[..., None], *arguments: Any) -> None:
        """Run ``kernel(part, parts, *arguments)`` for every part, one per thread."""
        if self._pool is None:
            kernel(0, 1, *arguments)
            return
        others = [self._pool.submit(kernel, part, self.threads, *arguments) for part in range(1, self.threads)]
        kernel(0, self.threads, *arguments)
        for other in others:
            other.result()


def rasterise(
    means: ArrayLike,
    covariances: ArrayLike,
    opacities: ArrayLike,
    *,
    camera: Camera,
    sh: ArrayLike | None = None,
    colors: ArrayLike | None = None,
    background: ArrayLike = WHITE,
    depth: DepthMode = "median",
    antialiased: bool = False,
    sh_rotations: ArrayLike | None = None,
    near: float | None = None,
) -> RenderResult:
    """Render N Gaussians given by covariance. For a series of pictures use ``Rasteriser.render``.

    Paper: Sec. C.1.

    Args:
        means: centres, input units, shape [N, 3].
        covariances: shape [N, 3, 3], or packed xx, xy, xz, yy, yz, zz of shape [N, 6].
        opacities: in [0, 1], shape [N].
        camera: the view.
        sh: spherical-harmonic coefficients, shape [N, K, 3], K = 1, 4, 9 or 16. Give either this or ``colors``.
        colors: RGB drawn as it is, shape [N, 3].
        background: RGB behind the Gaussians.
        depth: "median" or "expected", see ``RenderResult``.
        antialiased: lower the opacity of Gaussians thinner than a pixel (Mip-Splatting's 2D filter) instead of
            drawing them too thick. Trained splats expect the classic False.
        sh_rotations: rotation R that each Gaussian has undergone, shape [N, 3, 3]; its SH is evaluated at R^T d.
        near: nearest depth drawn, input units; by default ``default_near``.

    Raises:
        ValueError: an argument has the wrong shape or value; names it.
    """
    return Rasteriser().render(
        means, covariances, opacities,
        camera=camera, sh=sh, colors=colors, background=background, depth=depth, antialiased=antialiased,
        sh_rotations=sh_rotations, near=near,
    )  # fmt: skip


def _kernel_array(value: ArrayLike, name: str, shape: tuple[int | None, ...]) -> NDArray[Any]:
    """A contiguous read-only float32 array of the given shape; NaN is left to the kernels, which skip it."""
    return checked_array(value, name, shape, np.float32, finite=False)


def _bands(row_starts: NDArray[np.int64], max_pairs: int) -> list[tuple[int, int]]:
    """Split tile rows into (first, last) bands of at most ``max_pairs`` pairs, but at least one row each."""
    rows = len(row_starts) - 1
    bands = []
    first = 0
    for row in range(rows):
        if row > first and row_starts[row + 1] - row_starts[first] > max_pairs:
            bands.append((first, row - 1))
            first = row
    bands.append((first, rows - 1))
    return bands
