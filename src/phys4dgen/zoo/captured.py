"""A bundled object as a real capture would hold it: noisy, half transparent Gaussians, floaters, and holes.

The figures are those measured on real splats: of the Gaussians of a capture 30 % have an opacity above 0.5, 45 % one
between 0.1 and 0.5, 25 % less; the lightness of neighbours differs by a heavy-tailed 6, 11 and 22 units in these three
classes, a and b by less; every eighth has taken on colour from its neighbours; many are needles; one in fifty is a big
faint floater of any colour. Where no photograph shows anything there is nothing: about holes, under what stands on a
table, and inside. A splat is optimised to look like its photographs; a Gaussian that none of them shows is never
placed there or is pruned (as in Niemeyer et al., "RadSplat", 2024, Sec. 3.3, by the largest weight in any pixel).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from phys4dgen.render.cameras import view_cameras
from phys4dgen.render.views import render_label_maps
from phys4dgen.types import SH_C0, Gaussians, rotation_from_quats
from phys4dgen.types.color import lab_to_srgb, srgb_to_lab

__all__ = ["FLOATER", "as_captured", "without_underside"]

FLOATER = -1
"""Label of a Gaussian that belongs to no part."""

_OPACITY_CLASSES = ((0.30, 0.5, 1.0, 6.0), (0.45, 0.1, 0.5, 11.0), (0.25, 0.01, 0.1, 22.0))
"""Share, lowest and highest opacity, and standard deviation of the lightness, of each class."""
_TAIL = 4
"""Degrees of freedom of Student's t: the smaller, the more outliers."""
_NOISE_OF_LAB = np.array([1.0, 0.45, 0.65]) * 0.8
_BLEED_SHARE = 0.12
_BLEED_NEIGHBOURS = 24
_FLOATER_SHARE = 0.02
_HOLE_RADIUS = 0.05
"""Of half the object's diagonal."""
_PHOTOGRAPH_PX = 512
_PHOTOGRAPHED_FROM = (np.eye(3), np.diag([1.0, -1.0, -1.0]))
"""Rotations under which the ``object`` views are taken: from one side all around, and from the other."""
_MAX_HOLE_SHARE = 0.25
"""A part that would lose more than this to holes keeps all of its Gaussians."""

_UNDERSIDE_HEIGHT = 0.06
"""Of the object's height: what lies lower and level is its underside."""
_UNDERSIDE_SLOPE = 0.7
"""Least vertical component of the normal of an underside."""


def as_captured(
    gaussians: Gaussians, labels: NDArray[np.int32], *, seed: int = 0, hole_count: int = 5
) -> tuple[Gaussians, NDArray[np.int32]]:
    """The same object with the faults of a capture, in a new order.

    Args:
        gaussians: N clean Gaussians.
        labels: part of each, shape [N].
        seed: of all noise; the same seed gives the same arrays.
        hole_count: places about which the surface is missing.

    Returns:
        About as many Gaussians as can be seen from outside, without view-dependent colour, and their parts; ``FLOATER``
        for those of no part.
    """
    rng = np.random.default_rng([seed, 41])
    shown = _shown(gaussians)
    gaussians, labels = gaussians.subset(shown), labels[shown]
    kept = ~_in_holes(gaussians.means, labels, hole_count, np.random.default_rng([seed, 43]))
    gaussians, labels = gaussians.subset(kept), labels[kept]
    n = len(gaussians)
    opacities, lightness_noise = _opacities(n, rng)
    means = gaussians.means.astype(np.float64)
    distance, near = KDTree(means).query(means, min(_BLEED_NEIGHBOURS, n), workers=-1)
    spacing = distance.reshape(n, -1)[:, min(4, n - 1)]
    lab = srgb_to_lab(gaussians.base_colors)
    lab += lightness_noise[:, None] * _NOISE_OF_LAB * rng.standard_t(_TAIL, (n, 3))
    bled = np.flatnonzero(rng.uniform(size=n) < _BLEED_SHARE)
    giver = near.reshape(n, -1)[bled, rng.integers(0, near.reshape(n, -1).shape[1], len(bled))]
    lab[bled] = 0.5 * (lab[bled] + lab[giver])
    needle = np.exp(rng.normal(0, 0.4, (n, 3)))
    solid = Gaussians(
        means=(means + rng.normal(0, 0.25, (n, 3)) * spacing[:, None]).astype(np.float32),
        quats_wxyz=gaussians.quats_wxyz,
        scales=(1.3 * gaussians.scales * needle).astype(np.float32),  # larger, because they are less opaque
        opacities=opacities.astype(np.float32),
        sh=_flat_color(lab_to_srgb(lab)),
    )
    floaters = _floaters(solid, rng)
    joined = Gaussians(
        **{name: np.concatenate([getattr(solid, name), getattr(floaters, name)]) for name in vars(solid)}
    )
    order = rng.permutation(len(joined))
    parts = np.concatenate([labels, np.full(len(floaters), FLOATER, np.int32)])[order].astype(np.int32)
    return joined.subset(order), parts


def without_underside(
    gaussians: Gaussians, labels: NDArray[np.int32], up: NDArray[np.float64]
) -> tuple[Gaussians, NDArray[np.int32]]:
    """The same object as seen by somebody who never lifted it: what faces the table is missing.

    Args:
        gaussians: N clean Gaussians, flat along their surface.
        labels: part of each, shape [N].
        up: unit vector that points up, shape [3].
    """
    height = gaussians.means.astype(np.float64) @ up
    low = height < height.min() + _UNDERSIDE_HEIGHT * np.ptp(height)
    thinnest = rotation_from_quats(gaussians.quats_wxyz)[np.arange(len(gaussians)), :, gaussians.scales.argmin(1)]
    kept = ~(low & (np.abs(thinnest @ up) > _UNDERSIDE_SLOPE))
    return gaussians.subset(kept), labels[kept]


def _shown(gaussians: Gaussians) -> NDArray[np.bool_]:
    """Which Gaussians are the surface in a pixel of any of 58 photographs from all sides, shape [N]."""
    shown = np.zeros(len(gaussians), np.bool_)
    for rotation in _PHOTOGRAPHED_FROM:
        lower, upper = gaussians.robust_bounds(rotation=rotation)
        cameras = view_cameras("object", lower=lower, upper=upper, rotation=rotation, size_px=_PHOTOGRAPH_PX)
        front = render_label_maps(gaussians, np.arange(len(gaussians)), cameras)
        shown[front[front >= 0]] = True
    return shown


def _in_holes(
    means: NDArray[np.float32], labels: NDArray[np.int32], count: int, rng: np.random.Generator
) -> NDArray[np.bool_]:
    """Which Gaussians lie in one of ``count`` balls about some of them, shape [N]."""
    radius = _HOLE_RADIUS * _half_diagonal(means)
    centres = means[rng.integers(0, len(means), count)]
    missing = np.isfinite(KDTree(centres).query(means, distance_upper_bound=radius)[0]) if count else labels < 0
    lost = np.bincount(labels[missing], minlength=labels.max() + 1) / np.maximum(np.bincount(labels), 1)
    return missing & (lost[labels] <= _MAX_HOLE_SHARE)


def _half_diagonal(means: NDArray[np.float32]) -> float:
    return float(np.linalg.norm(np.ptp(means, axis=0))) / 2


def _opacities(n: int, rng: np.random.Generator) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Opacity of every Gaussian and the noise of its lightness, each of shape [N]."""
    shares, lowest, highest, noise = np.array(_OPACITY_CLASSES).T
    of_class = rng.choice(len(shares), n, p=shares)
    return rng.uniform(lowest[of_class], highest[of_class]), noise[of_class]


def _floaters(solid: Gaussians, rng: np.random.Generator) -> Gaussians:
    """Big faint Gaussians of any colour around the object."""
    n = max(1, round(_FLOATER_SHARE * len(solid)))
    radius = _half_diagonal(solid.means)
    quats = rng.normal(size=(n, 4))
    home = solid.means[rng.integers(0, len(solid), n)]
    return Gaussians(
        means=(home + rng.normal(0, 0.08 * radius, (n, 3))).astype(np.float32),
        quats_wxyz=(quats / np.linalg.norm(quats, axis=1, keepdims=True)).astype(np.float32),
        scales=(0.03 * radius * np.exp(rng.normal(0, 0.5, (n, 3)))).astype(np.float32),
        opacities=rng.uniform(0.01, 0.15, n).astype(np.float32),
        sh=_flat_color(rng.uniform(size=(n, 3))),
    )


def _flat_color(rgb: NDArray[np.float64]) -> NDArray[np.float32]:
    return ((rgb - 0.5) / SH_C0).astype(np.float32)[:, None]
