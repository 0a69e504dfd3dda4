"""Give thin parts the thickness that the user or the material's library entry knows, where none was measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from phys4dgen.types import SHEET, SOLID, Continuum, Frame

__all__ = ["with_thickness"]


def with_thickness(
    continuum: Continuum,
    *,
    frame: Frame,
    given_m: Mapping[int, float],
    library_m: Mapping[int, float],
) -> Continuum:
    """A continuum whose sheets and rods have the best thickness known.

    Args:
        continuum: as discovered.
        frame: input coordinates -> metres.
        given_m: thickness by part number that the user gave; it wins over what was measured (sheets and rods).
        library_m: usual thickness by part number; used for sheets whose thickness was not measured.

    Returns:
        The continuum with thickness, offsets, positions and volumes changed together.
    """
    wanted = continuum.thickness_m.copy()
    for part, thickness_m in library_m.items():
        unknown = (continuum.part == part) & (continuum.shape == SHEET) & ~continuum.thickness_measured
        wanted[unknown] = thickness_m
    for part, thickness_m in given_m.items():
        wanted[(continuum.part == part) & (continuum.shape != SOLID)] = thickness_m
    thin = continuum.shape != SOLID
    ratio = np.where(thin, wanted / np.where(thin, continuum.thickness_m, 1.0), 1.0)
    if (ratio == 1).all():
        return continuum
    shift_m = continuum.offset_m * (ratio - 1)[:, None]
    return replace(
        continuum,
        positions=continuum.positions + frame.from_metres(shift_m),
        # A sheet's area stays; a rod's cross-section grows with the square of its diameter.
        volume_m3=continuum.volume_m3 * np.where(continuum.shape == SHEET, ratio, ratio**2),
        thickness_m=np.where(thin, wanted, np.nan),
        offset_m=continuum.offset_m * ratio[:, None],
    )
