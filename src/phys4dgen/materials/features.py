"""What the rules look at: colour, shape, height and neighbours of every part."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phys4dgen.types import ROD, SHEET, SOLID, Continuum, Frame, Gaussians, Parts
from phys4dgen.types.color import srgb_to_lab

__all__ = ["PartFeatures", "part_features"]

_SECTORS = 16
"""Compass directions in which one part is looked for around another."""
_ENCLOSED_SHARE = 0.8
_CONTACT_HEIGHT = 0.05
"""A part reaches the ground if its foot lies in this lowest share of the object's height."""
_ROOT_HEIGHT = 0.1
"""Around the top of a part, where another part is looked for that stands on it; of the object's height."""
_ROOT_SHARE = 0.005
"""Share of that other part that must be found there."""
_CELLS = 48
"""Cells along the object's longest side in which area is counted."""


@dataclass(frozen=True)
class PartFeatures:
    """One part as the rules see it.

    Attributes:
        name: of the part.
        lightness: CIELAB L, 0 (black) to 100 (white).
        chroma: distance from grey in CIELAB.
        hue_deg: hue angle in CIELAB: 20-70 orange and brown, 90 yellow, 100-180 green, 270 blue, 0 pink and red.
        foot: lowest height as a share of the object's height, 0 at the ground.
        top: greatest height, likewise.
        width: greatest horizontal half width as a share of the object's height.
        area_share: share of the object's surface.
        roundness: spread of the distance from the middle over its mean; 0 for a ball, 0.1 for a cube, more for others.
        sheet_share: share of the part's surface that is a thin sheet, NaN where no continuum was given.
        rod_share: share of the part's surface that is a thin rod, NaN likewise.
        enclosed_by: names of the parts that stand around it on nearly all sides.
        encloses: names of the parts that it stands around.
        stands_on: names of the parts that reach lower and that it is rooted on.
        carries: names of the parts that stand on it.
    """

    name: str
    lightness: float
    chroma: float
    hue_deg: float
    foot: float
    top: float
    width: float
    area_share: float
    roundness: float
    sheet_share: float
    rod_share: float
    enclosed_by: tuple[str, ...]
    encloses: tuple[str, ...]
    stands_on: tuple[str, ...]
    carries: tuple[str, ...]

    @property
    def on_ground(self) -> bool:
        """It reaches the lowest 5 % of the height."""
        return self.foot < _CONTACT_HEIGHT

    @property
    def is_thin(self) -> bool | None:
        """Mostly sheet or rod; None where nobody measured it."""
        return None if np.isnan(self.sheet_share) else self.sheet_share + self.rod_share > 0.5

    @property
    def is_rod(self) -> bool | None:
        """Mostly rod; None where nobody measured it."""
        return None if np.isnan(self.rod_share) else self.rod_share > 0.5


def part_features(
    gaussians: Gaussians, parts: Parts, frame: Frame, continuum: Continuum | None = None
) -> tuple[PartFeatures, ...]:
    """Features of every part, in the order of the part numbers.

    Args:
        gaussians: N static Gaussians.
        parts: their parts.
        frame: which way is up.
        continuum: the particles, which know where the object is a sheet or a rod; None leaves that open.
    """
    points = gaussians.means.astype(np.float64) @ frame.rotation.T
    lower, upper = gaussians.robust_bounds(rotation=frame.rotation)
    height = max(float(upper[2] - lower[2]), 1e-12)
    points = (points - [(lower[0] + upper[0]) / 2, (lower[1] + upper[1]) / 2, lower[2]]) / height
    inside = (points[:, 2] > -0.02) & (points[:, 2] < 1.02)
    areas = _areas(points, parts, float((upper - lower).max()) / height / _CELLS)
    extents = [_Extent.of(points, gaussians, parts.labels == i, inside) for i in range(parts.count)]
    colors = _colors(gaussians, parts)
    thin = _thin_shares(continuum, parts.count)

    def names(related: list[bool]) -> tuple[str, ...]:
        return tuple(name for name, yes in zip(parts.names, related, strict=True) if yes)

    count = range(parts.count)
    encloses = [[i != j and extents[i].encloses(extents[j]) for j in count] for i in count]
    carries = [[i != j and extents[i].carries(extents[j]) for j in count] for i in count]
    return tuple(
        PartFeatures(
            name=parts.names[i],
            lightness=float(colors[i, 0]),
            chroma=float(np.hypot(colors[i, 1], colors[i, 2])),
            hue_deg=float(np.degrees(np.arctan2(colors[i, 2], colors[i, 1])) % 360),
            foot=extents[i].foot,
            top=extents[i].top,
            width=float(extents[i].reach.max()),
            area_share=float(areas[i]),
            roundness=_roundness(extents[i].points),
            sheet_share=float(thin[i, 0]),
            rod_share=float(thin[i, 1]),
            enclosed_by=names([row[i] for row in encloses]),
            encloses=names(encloses[i]),
            stands_on=names([row[i] for row in carries]),
            carries=names(carries[i]),
        )
        for i in count
    )


@dataclass(frozen=True, eq=False)
class _Extent:
    """Where a part is, in units of the object's height, z up from the ground.

    Attributes:
        centre: horizontal centre, shape [2].
        foot: 2 % quantile of the height.
        top: 98 % quantile of the height.
        points: its Gaussians, shape [M, 3].
        reach: 90 % quantile of the horizontal distance from the centre by compass sector, 0 where empty, shape [16].
    """

    centre: NDArray[np.float64]
    foot: float
    top: float
    points: NDArray[np.float64]
    reach: NDArray[np.float64]

    @staticmethod
    def of(
        points: NDArray[np.float64], gaussians: Gaussians, mine: NDArray[np.bool_], inside: NDArray[np.bool_]
    ) -> _Extent:
        """Extent of the Gaussians ``mine``, without faint ones and strays where enough are left."""
        for chosen in (mine & inside & (gaussians.opacities > 0.1), mine & inside, mine):
            if chosen.sum() >= 8:
                break
        else:
            chosen = mine
        own = points[chosen]
        foot, top = np.quantile(own[:, 2], [0.02, 0.98])
        centre = np.median(own[:, :2], axis=0)
        return _Extent(
            centre=centre,
            foot=float(np.clip(foot, 0, 1)),
            top=float(np.clip(top, 0, 1)),
            points=own,
            reach=_reach(own, centre),
        )

    def encloses(self, other: _Extent) -> bool:
        """Whether this part stands around the other one, at the other one's own height, on nearly all sides."""
        margin = 0.02
        beside = self.points[(self.points[:, 2] > other.foot - margin) & (self.points[:, 2] < other.top + margin)]
        if len(beside) < 8 or other.foot < self.foot:
            return False
        around = _reach(beside, other.centre)
        return bool((around > other.reach).mean() >= _ENCLOSED_SHARE)

    def carries(self, other: _Extent) -> bool:
        """Whether the other part rises above this one and is rooted over this one's footprint.

        Leaves may hang down beside a pot; what counts is that some of the other part is near this one's upper end.
        """
        if not (other.top > self.top and other.foot > self.foot):
            return False
        offset = other.points[:, :2] - self.centre
        over = np.hypot(offset[:, 0], offset[:, 1]) <= self.reach.max()
        near_top = np.abs(other.points[:, 2] - self.top) < _ROOT_HEIGHT
        return bool((over & near_top).mean() >= _ROOT_SHARE)


def _reach(points: NDArray[np.float64], centre: NDArray[np.float64]) -> NDArray[np.float64]:
    """90 % quantile of the horizontal distance from ``centre`` in each compass sector, 0 where empty; shape [16]."""
    offset = points[:, :2] - centre
    distance = np.hypot(offset[:, 0], offset[:, 1])
    turn = np.arctan2(offset[:, 1], offset[:, 0]) / (2 * np.pi) % 1
    sector = np.minimum((turn * _SECTORS).astype(np.intp), _SECTORS - 1)
    return np.array([np.quantile(distance[sector == s], 0.9) if (sector == s).any() else 0.0 for s in range(_SECTORS)])


def _roundness(points: NDArray[np.float64]) -> float:
    """Robust spread of the distance from the middle of the box, over its median."""
    low, high = np.quantile(points, [0.01, 0.99], axis=0)
    distance = np.linalg.norm(points - (low + high) / 2, axis=1)
    middle = float(np.median(distance))
    return float(np.median(np.abs(distance - middle)) * 1.4826 / max(middle, 1e-12))


def _areas(points: NDArray[np.float64], parts: Parts, cell: float) -> NDArray[np.float64]:
    """Share of the occupied cells that each part takes; shape [G]."""
    index = np.clip(np.floor(points / max(cell, 1e-9)) + 2**19, 0, 2**20 - 1).astype(np.int64)
    key = (index[:, 0] << 40) | (index[:, 1] << 20) | index[:, 2]
    pairs = np.unique(np.stack([parts.labels.astype(np.int64), key], 1), axis=0)
    count = np.bincount(pairs[:, 0], minlength=parts.count)
    return count / count.sum()


def _colors(gaussians: Gaussians, parts: Parts) -> NDArray[np.float64]:
    """Median Lab colour of each part, weighted by opacity x area; shape [G, 3]."""
    lab = srgb_to_lab(gaussians.base_colors)
    scales = np.sort(gaussians.scales.astype(np.float64), axis=1)
    area = scales[:, 1] * scales[:, 2]
    weight = gaussians.opacities * np.minimum(area, np.quantile(area, 0.95))  # no huge stray decides
    out = np.zeros((parts.count, 3))
    for part in range(parts.count):
        mine = np.flatnonzero(parts.labels == part)
        for channel in range(3):
            order = mine[np.argsort(lab[mine, channel], kind="stable")]
            cumulative = np.cumsum(weight[order])
            out[part, channel] = lab[order[np.searchsorted(cumulative, cumulative[-1] / 2)], channel]
    return out


def _thin_shares(continuum: Continuum | None, part_count: int) -> NDArray[np.float64]:
    """Share of each part's surface that is sheet and rod; NaN where no particle tells. Shape [G, 2]."""
    if continuum is None:
        return np.full((part_count, 2), np.nan)
    thickness = np.where(continuum.shape == SOLID, continuum.spacing_m, continuum.thickness_m)
    area = continuum.volume_m3 / np.maximum(thickness, 1e-9)
    total = np.bincount(continuum.part, area, part_count)[:part_count]
    shares = [
        np.bincount(continuum.part, area * (continuum.shape == shape), part_count)[:part_count]
        for shape in (SHEET, ROD)
    ]
    return np.where(total[:, None] > 0, np.stack(shares, 1) / np.maximum(total[:, None], 1e-300), np.nan)
