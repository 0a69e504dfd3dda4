"""Which way is up in a splat: a guess from how the object could stand, with an honest confidence.

Splat files do not say which axis is up, and captures are often tilted. Every candidate direction (``contact``) gets a
score, the weighted sum of its cues (``cues``). The weights are those under which the true direction is likeliest
(multinomial logit) over bundled objects, three captures and shapes by others; ``benchmarks/up.py`` measures what they
are worth, docs/conventions.md says so.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import QhullError

from phys4dgen.types import Gaussians
from phys4dgen.upright.contact import candidate_downs, fitted_to_base
from phys4dgen.upright.cues import Cues, Stand, cues_of, light_and_leaves, stand_on
from phys4dgen.upright.occupied import occupied_cells

__all__ = ["UpGuess", "guess_up"]

_WEIGHTS = np.array(
    Cues(
        stability=0.13,
        contact=3.3,
        open_base=4.7,
        centred=9.5,
        lift=69.0,
        turning=7.3,
        mirror=4.6,
        light=20.0,
        leaves=12.0,
    )
)

_SURE = 0.85
"""Confidence from which on the guess may be used without a warning."""

_LEAST_TIP_DEG = 0.0
_LEAST_SUPPORT = 0.06
"""What stands on less than these (a cone on its tip) is not trusted to stand like that."""

_SAME_DEG = 10.0
_SNAP_DEG = 5.0
_USUAL_UPS = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
"""Of COLMAP and 3DGS, glTF, and Blender; they decide only where the object does not, and then with a warning."""

_USUAL_BONUS = 3.0
_FEWEST_CELLS = 30


class UpGuess(NamedTuple):
    """The most likely up direction.

    Attributes:
        up: unit vector, input coordinates, shape [3]; an axis of the input exactly, where one is within 5 degrees.
        confidence: probability of the direction among all candidates, as fitted, in [0, 1].
        is_sure: it may be used without asking.
        reason: one sentence for the report.
    """

    up: NDArray[np.float64]
    confidence: float
    is_sure: bool
    reason: str


class _Choice(NamedTuple):
    """A candidate that was chosen."""

    down: NDArray[np.float64]
    stand: Stand
    probability: float


def guess_up(gaussians: Gaussians) -> UpGuess:
    """Guess the up direction; where it is not sure, the reason begins with "unsure" and the user should say it."""
    cells = occupied_cells(gaussians)
    if cells is None or len(cells.points) < _FEWEST_CELLS:
        return UpGuess(_USUAL_UPS[0], 0.0, False, "unsure: there is too little to see; took -y")
    try:
        downs = candidate_downs(cells)
        stands = [stand_on(cells, down) for down in downs]
    except QhullError:
        return UpGuess(_USUAL_UPS[0], 0.0, False, "unsure: everything lies in one plane; took -y")
    look = light_and_leaves(gaussians, cells)
    scores = np.array([cues_of(stand, look, down) for stand, down in zip(stands, downs, strict=True)]) @ _WEIGHTS
    best = _chosen(downs, stands, scores)
    stand = best.stand
    could_stand = stand.tip_deg > _LEAST_TIP_DEG and stand.support_share > _LEAST_SUPPORT
    is_sure = could_stand and best.probability >= _SURE
    doubt = ""
    if not is_sure:
        usual = (_USUAL_UPS @ -downs.T).max(0) > np.cos(np.radians(_SAME_DEG))
        preferred = _chosen(downs, stands, scores + _USUAL_BONUS * usual)
        doubt = f", a probability of {best.probability:.0%}"
        if preferred.down @ best.down < np.cos(np.radians(_SAME_DEG)):
            doubt = f", and {axis_name(-best.down)} fits as well but is unusual"
        best = preferred
    up = _snapped(-fitted_to_base(cells, best.down))
    return UpGuess(up, best.probability, is_sure, _reason(up, best.stand, doubt))


def _chosen(downs: NDArray[np.float64], stands: list[Stand], scores: NDArray[np.float64]) -> _Choice:
    """The candidate with the highest score, with the probability of all that point nearly the same way."""
    likely = np.exp(scores - scores.max())
    best = int(scores.argmax())
    same = downs @ downs[best] > np.cos(np.radians(_SAME_DEG))
    return _Choice(downs[best], stands[best], float(likely[same].sum() / likely.sum()))


def _snapped(up: NDArray[np.float64]) -> NDArray[np.float64]:
    """The input's own axis where it is near: whoever made the file has mostly levelled it."""
    axis = int(np.abs(up).argmax())
    exact = np.zeros(3)
    exact[axis] = np.sign(up[axis])
    return exact if up @ exact > np.cos(np.radians(_SNAP_DEG)) else up / np.linalg.norm(up)


def _reason(up: NDArray[np.float64], stand: Stand, doubt: str) -> str:
    how = (
        f"with {axis_name(up)} up it stands on {stand.support_share:.0%} of its footprint and falls at "
        f"{max(stand.tip_deg, 0):.0f} degrees"
    )
    return f"unsure: {how}{doubt}" if doubt else how


def axis_name(direction: NDArray[np.float64]) -> str:
    """``-y``, or a rounded vector."""
    axis = int(np.abs(direction).argmax())
    if abs(direction[axis]) > np.cos(np.radians(0.5)):
        return f"{'+' if direction[axis] > 0 else '-'}{'xyz'[axis]}"
    return f"({', '.join(f'{value:.2f}' for value in direction)})"
