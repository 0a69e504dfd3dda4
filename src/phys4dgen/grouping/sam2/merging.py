"""Which ids are the same thing, decided in 3D: a tracker loses things behind others, finds them again, confuses them.

Each id is first cut where the Gaussians that it claims jump from one view to the next (the tracker went over to
another thing); what is left between two cuts is a *run*. Runs are then joined, the most alike first, where they claim
the same of the Gaussians that both could see; where no Gaussian was seen by both, where they touch and look alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from phys4dgen.grouping.sam2.tracks import Tracks

__all__ = ["Surface", "joined_ids"]

_NEIGHBOURS = 16
"""Of a Gaussian among those that a view shows: their majority replaces its own claim, which removes specks."""
_SAME_THING = 0.4
"""Least IoU of an id's claims in one view and the next, among what both show."""
_AGREEMENT = 0.5
"""Least agreement of two runs that are one thing."""
_EVIDENCE = 8
"""Least number of claimed Gaussians of each run that the views of the other show."""
_EVIDENCE_SHARE = 0.05
"""Likewise, of the smaller run."""
_TOUCH_REL = 0.02
"""Runs nearer than this share of the object's diagonal touch."""
_TOUCHING = 0.02
"""Share of the smaller run that must touch the larger one."""
_COLOR_DIFFERENCE = 9.0
"""Largest distance of mean colours of runs that look alike, CIELAB with half the lightness."""


@dataclass(frozen=True, eq=False)
class Surface:
    """The Gaussians that ids are compared by.

    Attributes:
        means: centres, shape [M, 3].
        lab: CIELAB with half the lightness, shape [M, 3].
        seen: per view, which of the M Gaussians stand behind the view's samples, each of shape [M_view].
    """

    means: NDArray[np.float64]
    lab: NDArray[np.float64]
    seen: Sequence[NDArray[np.intp]]


@dataclass(eq=False)
class _Run:
    """A piece of an id, or several that have been joined.

    Attributes:
        members: pairs of id and view.
        claimed: number of views that claim each Gaussian, shape [M].
        shown: number of the run's views that show it, shape [M].
    """

    members: list[tuple[int, int]]
    claimed: NDArray[np.float32]
    shown: NDArray[np.float32]

    @property
    def support(self) -> NDArray[np.bool_]:
        """What at least half of the views that could see it claim."""
        return (self.claimed > 0) & (2 * self.claimed >= self.shown)


def joined_ids(tracks: Tracks, surface: Surface) -> NDArray[np.int32]:
    """The thing that each id means in each view, numbered from 0; -1 where it is not seen. Shape [ids, V].

    Args:
        tracks: of V views along a path, sampled at the Gaussians of ``surface``.
        surface: what the views see.
    """
    cleaner = [_Neighbourhood(surface.means[seen]) for seen in surface.seen]
    runs = [run for number in range(len(tracks.claims)) for run in _runs(number, tracks, surface, cleaner)]
    things = _joined_by_looks(_joined_by_overlap(runs), surface)
    meaning = np.full((len(tracks.claims), len(surface.seen)), -1, np.int32)
    for thing, run in enumerate(things):
        for number, view in run.members:
            meaning[number, view] = thing
    return meaning


class _Neighbourhood:
    """Majority among near Gaussians that one view shows."""

    def __init__(self, points: NDArray[np.float64]) -> None:
        count = min(_NEIGHBOURS, len(points))
        self._near = KDTree(points).query(points, count)[1].reshape(len(points), -1) if count else None

    def majority(self, claims: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """The claims without specks and pinholes."""
        return claims if self._near is None else claims[self._near].mean(1) > 0.5


def _runs(number: int, tracks: Tracks, surface: Surface, cleaner: Sequence[_Neighbourhood]) -> list[_Run]:
    """An id, cut where it jumps."""
    count = len(surface.means)
    runs: list[_Run] = []
    before: NDArray[np.int8] | None = None
    for view, claims in enumerate(tracks.claims[number]):
        if claims is None:
            continue
        clean = cleaner[view].majority(claims)
        if not clean.any():
            continue
        state = np.full(count, -1, np.int8)  # -1 not shown, 0 shown, 1 claimed
        state[surface.seen[view]] = clean
        if before is None or _jumps(before, state):
            runs.append(_Run([], np.zeros(count, np.float32), np.zeros(count, np.float32)))
        runs[-1].members.append((number, view))
        runs[-1].claimed += state == 1
        runs[-1].shown += state >= 0
        before = state
    return runs


def _jumps(before: NDArray[np.int8], now: NDArray[np.int8]) -> bool:
    """Whether an id has gone over to something else, or nothing tells that it has not."""
    both = (before >= 0) & (now >= 0)
    either = int((both & ((before == 1) | (now == 1))).sum())
    common = int((both & (before == 1) & (now == 1)).sum())
    return either < _EVIDENCE or common < _SAME_THING * either


def _joined_by_overlap(runs: list[_Run]) -> list[_Run]:
    """Join runs that claim the same of what both could see, the most alike first."""
    runs = list(runs)
    if len(runs) < 2:
        return runs
    supports = np.array([run.support for run in runs], np.float32)
    shown = np.array([run.shown > 0 for run in runs], np.float32)
    agreement = _agreement(supports, shown, supports, shown)
    np.fill_diagonal(agreement, -1)
    alive = np.ones(len(runs), np.bool_)
    while True:
        i, j = np.unravel_index(int(agreement.argmax()), agreement.shape)
        if agreement[i, j] < _AGREEMENT:
            return [run for run, keep in zip(runs, alive, strict=True) if keep]
        runs[i] = _together(runs[i], runs[j])
        alive[j] = False
        supports[i], shown[i] = runs[i].support, runs[i].shown > 0
        row = _agreement(supports[i : i + 1], shown[i : i + 1], supports, shown)[0]
        row[~alive] = row[i] = -1
        agreement[i], agreement[:, i] = row, row
        agreement[j], agreement[:, j] = -1, -1


def _agreement(
    supports: NDArray[np.float32],
    shown: NDArray[np.float32],
    others: NDArray[np.float32],
    others_shown: NDArray[np.float32],
) -> NDArray[np.float64]:
    """The smaller share of two runs' common Gaussians in what each claims of what the other could see.

    -1 where too few Gaussians tell. A part of a thing does not agree with the thing: the smaller share is small.

    Args:
        supports: of R runs, 0 or 1, shape [R, M].
        shown: what their views show, likewise.
        others: supports of Q runs.
        others_shown: what those views show.

    Returns:
        Shape [R, Q].
    """
    common = supports @ others.T
    mine, theirs = supports @ others_shown.T, shown @ others.T
    least = np.minimum(mine, theirs)
    smaller = np.minimum(supports.sum(1)[:, None], others.sum(1))
    enough = least >= np.maximum(_EVIDENCE, _EVIDENCE_SHARE * smaller)
    return np.where(enough, common / np.maximum(np.maximum(mine, theirs), 1), -1.0)


def _joined_by_looks(runs: list[_Run], surface: Surface) -> list[_Run]:
    """Join runs whose views never showed the same Gaussians, where they touch and have one colour."""
    runs = sorted(runs, key=lambda run: -int(run.support.sum()))
    reach = _TOUCH_REL * float(np.linalg.norm(np.ptp(surface.means, axis=0)))
    joined: list[_Run] = []
    for run in runs:
        partner = next((place for place, other in enumerate(joined) if _look_alike(other, run, surface, reach)), None)
        if partner is None:
            joined.append(run)
        else:
            joined[partner] = _together(joined[partner], run)
    return joined


def _look_alike(larger: _Run, smaller: _Run, surface: Surface, reach: float) -> bool:
    a, b = larger.support, smaller.support
    if not a.any() or not b.any():
        return False
    told = min((a & (smaller.shown > 0)).sum(), (b & (larger.shown > 0)).sum())
    if told >= max(_EVIDENCE, _EVIDENCE_SHARE * b.sum()):
        return False  # both were seen together and did not agree
    if np.linalg.norm(surface.lab[a].mean(0) - surface.lab[b].mean(0)) > _COLOR_DIFFERENCE:
        return False
    near = KDTree(surface.means[a]).query(surface.means[b], distance_upper_bound=reach)[0] < reach
    return bool(near.mean() >= _TOUCHING)


def _together(a: _Run, b: _Run) -> _Run:
    return _Run(a.members + b.members, a.claimed + b.claimed, a.shown + b.shown)
