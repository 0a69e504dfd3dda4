"""Which way is up in a splat: a guess from how things stand, with an honest confidence.

Splat files do not say which axis is up. Each of the six axis directions is scored as if the object stood on the plane
below it: by the share of its footprint that touches the plane, by how compact that contact is, by how far inside it
the centre of mass lies, by how low the mass lies, and by what capture tools and modellers use as up.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phys4dgen.types.gaussians import Gaussians

__all__ = ["UpGuess", "guess_up"]

COLUMNS = 32
"""The object's longest side in cells of the contact map."""

MIN_GAUSSIANS_PER_COLUMN = 3
"""A column of the contact map with fewer is taken for noise."""

RARE_DIRECTION = 0.6
"""Weight of +x, -x and -z: the common conventions are -y (COLMAP, 3DGS), +y (glTF) and +z (Blender, robotics)."""

SURE = 0.4
"""Confidence from which on the guess may be used without a warning."""


class UpGuess(NamedTuple):
    """The most likely up direction.

    Attributes:
        up: unit vector along an axis, input coordinates, shape [3].
        confidence: 1 - (second best score / best score), in [0, 1].
        reason: one sentence for the report.
    """

    up: NDArray[np.float64]
    confidence: float
    reason: str

    @property
    def is_sure(self) -> bool:
        """True if the best direction stands out."""
        return self.confidence >= SURE


class Stance(NamedTuple):
    """How the object would stand with one direction up."""

    score: float
    contact_share: float
    mass_height: float


def guess_up(gaussians: Gaussians) -> UpGuess:
    """Guess the up direction among +x, -x, +y, -y, +z and -z.

    Below confidence 0.4 the reason says "unsure" and names the runner-up: the user should then say what is up.
    """
    lower, upper = gaussians.robust_bounds()
    extent = upper - lower
    longest = float(extent.max())
    if longest <= 0:
        return UpGuess(np.array([0.0, -1.0, 0.0]), 0.0, "unsure: all Gaussians lie at one point; took -y.")
    seen = (gaussians.opacities > 0.1) & ((gaussians.means >= lower) & (gaussians.means <= upper)).all(axis=1)
    if not seen.any():
        seen[:] = True
    points = np.clip(gaussians.means[seen].astype(np.float64), lower, upper)
    # Opacity times visible area stands for mass; a few huge background Gaussians must not decide.
    axes = np.sort(np.minimum(gaussians.scales[seen].astype(np.float64), longest / 20), axis=1)
    mass = gaussians.opacities[seen].astype(np.float64) * axes[:, 1] * axes[:, 2]
    stances = {
        f"{'+' if sign > 0 else '-'}{'xyz'[axis]}": stance(points, mass, axis=axis, sign=sign, cell=longest / COLUMNS)
        for axis in range(3)
        for sign in (1, -1)
    }
    first, second = sorted(stances, key=lambda name: -stances[name].score)[:2]
    best = stances[first]
    confidence = 1 - stances[second].score / best.score if best.score > 0 else 0.0
    up = np.zeros(3)
    up["xyz".index(first[1])] = 1.0 if first[0] == "+" else -1.0
    reason = (
        f"with {first} up, {100 * best.contact_share:.0f} % of the footprint touches the ground and the centre of mass "
        f"lies at {100 * best.mass_height:.0f} % of the height"
    )
    if confidence < SURE:
        return UpGuess(up, confidence, f"unsure: {reason}, but {second} up fits nearly as well.")
    return UpGuess(up, confidence, f"{reason}.")


def stance(points: NDArray[np.float64], mass: NDArray[np.float64], *, axis: int, sign: int, cell: float) -> Stance:
    """Score one direction (see the module's docstring); each factor lies in [0, 1].

    Args:
        points: centres inside the robust box, shape [M, 3].
        mass: weight of each point, shape [M].
        axis: 0, 1 or 2.
        sign: +1 or -1.
        cell: side of a cell of the contact map, input units.
    """
    across = [other for other in range(3) if other != axis]
    height = sign * points[:, axis]
    ground, top = np.percentile(height, [0.5, 99.5])
    total = max(float(mass.sum()), 1e-300)
    mass_height = float(np.clip((mass @ height / total - ground) / max(top - ground, cell), 0, 1))

    index = np.floor((points[:, across] - points[:, across].min(axis=0)) / cell).astype(np.int64)
    rows, columns = index.max(axis=0) + 1
    flat = index[:, 0] * columns + index[:, 1]
    lowest = np.full(rows * columns, np.inf)
    np.minimum.at(lowest, flat, height)
    filled = np.bincount(flat, minlength=rows * columns) >= MIN_GAUSSIANS_PER_COLUMN
    touching = filled & (lowest < ground + cell)
    count = int(touching.sum())
    if count == 0:
        return Stance(0.0, 0.0, mass_height)
    contact_share = count / int(filled.sum())

    cells = np.stack(np.divmod(np.flatnonzero(touching), columns), axis=1) + 0.5
    centre = cells.mean(axis=0)
    # The root mean square radius of a full disc of this area; one cell has the radius of its own square.
    radius = math.sqrt(float(((cells - centre) ** 2).sum(axis=1).mean()) + 1 / 6)
    compactness = min(1.0, count / (2 * math.pi * radius**2))
    mass_centre = mass @ (points[:, across] - points[:, across].min(axis=0)) / total / cell
    steadiness = math.exp(-float(np.linalg.norm(mass_centre - centre)) / radius)
    convention = RARE_DIRECTION if axis == 0 or (axis == 2 and sign < 0) else 1.0
    score = contact_share * math.sqrt(compactness) * steadiness * (1 - mass_height) * convention
    return Stance(score, contact_share, mass_height)
