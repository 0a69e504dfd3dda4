"""Materials that change in time, as the solver gets them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from phys4dgen import scene as sections
from phys4dgen.errors import SceneError, did_you_mean
from phys4dgen.materials import material
from phys4dgen.mpm import LawId, MaterialChange
from phys4dgen.types import LAW_NUMBERS, Continuum, Frame, Material, MaterialBook, Parts
from phys4dgen.types.laws import wrong_number

__all__ = ["material_changes", "melting"]

_MELTING_SHARE = 0.5
_MELT_VISCOSITY_PAS = 3.0
_SOUND_OVER_FLOW = 12.0
_MELT_POISSON_RATIO = 0.49
_GRAVITY_MS2 = 9.81


def melting(scene: sections.Scene, part: str, density_kgm3: float, height_m: float) -> sections.MaterialChange:
    """What ``melt`` does to a part: it becomes a thick fluid of its own density during half of the film.

    The fluid is stiff enough for the speed at which it falls from ``height_m``: K = rho c0^2, c0 = 12 sqrt(2 g H).
    """
    bulk_pa = density_kgm3 * _SOUND_OVER_FLOW**2 * 2 * _GRAVITY_MS2 * height_m
    return sections.MaterialChange(
        part=part,
        over_s=_MELTING_SHARE * scene.simulation.duration_s,
        law="fluid",
        youngs_modulus_pa=3 * bulk_pa * (1 - 2 * _MELT_POISSON_RATIO),
        poisson_ratio=_MELT_POISSON_RATIO,
        numbers={"viscosity_pas": _MELT_VISCOSITY_PAS},
    )


def material_changes(
    changes: Iterable[sections.MaterialChange],
    *,
    continuum: Continuum,
    parts: Parts,
    book: MaterialBook,
    frame: Frame,
) -> tuple[MaterialChange, ...]:
    """Changes of a scene by particle and time; surface and interior of a part keep what the change does not say.

    Raises:
        SceneError: a law is unknown, or lacks a number.
        MaterialError: the library has no such material.
    """
    depth = _depth_m(continuum, frame)
    found = []
    for number, change in enumerate(changes):
        mine = continuum.part == parts.names.index(change.part)
        at_s = np.full(len(continuum), change.from_s)
        if change.over_s > 0:
            at_s[mine] += change.over_s * depth[mine] / max(float(depth[mine].max()), 1e-12)
        own = book.parts[change.part]
        for inside, now in ((False, own.surface), (True, own.interior)):
            chosen = mine & (continuum.is_interior == inside)
            if chosen.any():
                found.append(_becomes(change, now, place=f"changes.{number}", at_s=at_s, chosen=chosen))
    return tuple(found)


def _becomes(
    change: sections.MaterialChange,
    now: Material,
    *,
    place: str,
    at_s: NDArray[np.float64],
    chosen: NDArray[np.bool_],
) -> MaterialChange:
    base = now if change.material is None else material(change.material)
    law = base.law if change.law is None else change.law
    if law not in LAW_NUMBERS:
        raise SceneError(
            f"{place}.law: expected one of {', '.join(LAW_NUMBERS)}, got '{law}'.{did_you_mean(law, LAW_NUMBERS)}"
        )
    modulus = base.youngs_modulus_pa if change.youngs_modulus_pa is None else change.youngs_modulus_pa
    poisson = base.poisson_ratio if change.poisson_ratio is None else change.poisson_ratio
    known = {number.name for number in LAW_NUMBERS[law]}
    unknown = [name for name in change.numbers if name not in known]
    if unknown:
        raise SceneError(
            f"{place}.numbers: '{unknown[0]}' is no number of the law {law}, which has {', '.join(sorted(known))}."
            f"{did_you_mean(unknown[0], known)}"
        )
    numbers = {name: value for name, value in {**base.extra, **change.numbers}.items() if name in known}
    wrong = wrong_number(law, numbers, modulus, poisson)
    if wrong is not None:
        raise SceneError(f"{place}: {wrong}.")
    return MaterialChange(
        law=LawId[law.upper()],
        youngs_modulus_pa=modulus,
        poisson_ratio=poisson,
        numbers=numbers,
        at_s=at_s,
        chosen=chosen,
    )


def _depth_m(continuum: Continuum, frame: Frame) -> NDArray[np.float64]:
    """How far each particle lies below the object's surface, about, [P]."""
    points = frame.to_metres(continuum.positions)
    step = 1.5 * continuum.spacing_m
    cells = np.floor((points - points.min(0)) / step).astype(np.int64) + 1
    filled = np.zeros(cells.max(0) + 2, np.bool_)
    filled[tuple(cells.T)] = True
    return step * np.asarray(distance_transform_edt(filled))[tuple(cells.T)]
