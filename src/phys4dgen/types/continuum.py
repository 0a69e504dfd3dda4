"""The material points that are simulated."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from phys4dgen.types.checks import checked_array

__all__ = ["ROD", "SHEET", "SOLID", "Continuum"]

SOLID, SHEET, ROD = 0, 1, 2
"""Values of ``Continuum.shape``: how a particle's neighbourhood is built."""


@dataclass(frozen=True, eq=False)
class Continuum:
    """P particles that stand for the true volume of the object, in the input's coordinates.

    Attributes:
        positions: at the true thickness, shape [P, 3], float64, input coordinates.
        part: part number, shape [P], int32.
        is_interior: the particle takes its part's interior material, shape [P], bool.
        volume_m3: true volume that the particle stands for, shape [P], float64.
        gaussian_index: the Gaussian that the particle is, or -1, shape [P], int32.
        piece: connected piece of the part (skinning never crosses pieces), shape [P], int32.
        shape: SOLID, SHEET or ROD, shape [P], int8.
        thickness_m: true thickness of the sheet or diameter of the rod at the particle, NaN in solids, shape [P].
        thickness_measured: the thickness was read from the Gaussians (else it is a placeholder), shape [P], bool.
        offset_m: from the mid-surface or centre line to the particle, metres, z up axes, 0 in solids, shape [P, 3].
        site: number of the place on the sheet or rod; the particles of one cross-section share theirs, others have one
            each, shape [P], int32.
        spacing_m: distance between neighbouring particles that the seeding aimed at, metres.
    """

    positions: NDArray[np.float64]
    part: NDArray[np.int32]
    is_interior: NDArray[np.bool_]
    volume_m3: NDArray[np.float64]
    gaussian_index: NDArray[np.int32]
    piece: NDArray[np.int32]
    shape: NDArray[np.int8]
    thickness_m: NDArray[np.float64]
    thickness_measured: NDArray[np.bool_]
    offset_m: NDArray[np.float64]
    site: NDArray[np.int32]
    spacing_m: float

    def __post_init__(self) -> None:
        positions = checked_array(self.positions, "positions", (None, 3), np.float64)
        p = len(positions)
        if p == 0:
            raise ValueError("positions: expected at least one particle, got none.")
        checked = {
            "positions": positions,
            "part": checked_array(self.part, "part", (p,), np.int32),
            "is_interior": checked_array(self.is_interior, "is_interior", (p,), np.bool_),
            "volume_m3": checked_array(self.volume_m3, "volume_m3", (p,), np.float64),
            "gaussian_index": checked_array(self.gaussian_index, "gaussian_index", (p,), np.int32),
            "piece": checked_array(self.piece, "piece", (p,), np.int32),
            "shape": checked_array(self.shape, "shape", (p,), np.int8),
            "thickness_m": checked_array(self.thickness_m, "thickness_m", (p,), np.float64, finite=False),
            "thickness_measured": checked_array(self.thickness_measured, "thickness_measured", (p,), np.bool_),
            "offset_m": checked_array(self.offset_m, "offset_m", (p, 3), np.float64),
            "site": checked_array(self.site, "site", (p,), np.int32),
        }
        if not (checked["volume_m3"] > 0).all():
            raise ValueError("volume_m3: expected positive volumes.")
        if not np.isfinite(checked["thickness_m"][checked["shape"] != SOLID]).all():
            raise ValueError("thickness_m: expected a finite thickness for every sheet and rod particle.")
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.positions)

    def subset(self, chosen: NDArray[np.bool_]) -> Continuum:
        """The particles that a mask [P] selects, in their order; all numbers in them stay."""
        arrays = {entry.name: getattr(self, entry.name) for entry in fields(self) if entry.name != "spacing_m"}
        return Continuum(**{name: array[chosen] for name, array in arrays.items()}, spacing_m=self.spacing_m)
