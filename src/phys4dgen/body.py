"""From particles and materials to the body that the solver moves, with thin parts thickened.

A sheet of thickness t may be simulated at ts > t with density rho t / ts and Young's modulus E (t / ts)^3, a rod of
diameter d at ds with rho (d / ds)^2 and E (d / ds)^4: mass per area or length and bending stiffness are kept, while
the wave speed, which limits the time step, falls with t / ts. In-plane stiffness falls too, with (t / ts)^2; it stays
far above the bending stiffness and is not seen. (PHYSICS.md 1.11, MOTION.md: measured.) Where the material yields,
sY becomes sY (t / ts)^2 in a sheet and sY (d / ds)^3 in a rod, which keeps the bending moment that it carries. What has
no shape of its own to bend back to (sand, snow, fluid) is not thickened.

Thin parts are thickened for two reasons: to save time steps, and because a sheet or rod much thinner than a cell bends
too stiffly in MLS-MPM (up to 2 times the frequency at t/dx = 0.2, by where it lies between nodes; one cell thick it is
within 6 % everywhere: ``validation/thin.py`` explains and measures it).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from phys4dgen.interior import cross_section_means
from phys4dgen.mpm import Body, LawId
from phys4dgen.types import (
    KNOWN_NUMBERS,
    ROD,
    SHEET,
    SOLID,
    Continuum,
    Frame,
    Material,
    MaterialBook,
    Parts,
    complete_numbers,
)

__all__ = [
    "ROD_FLOOR_CELLS",
    "ROD_LIMIT_CELLS",
    "SHEET_FLOOR_CELLS",
    "SHEET_LIMIT_CELLS",
    "Assembly",
    "CappedPart",
    "PartThickening",
    "assemble_body",
]

SHEET_FLOOR_CELLS = 1.0
ROD_FLOOR_CELLS = 1.0
"""Thickness or diameter from which bending is right, and to which thin parts are thickened where stretch allows."""

_LARGEST_STRETCH = 0.05
_LARGEST_ACCELERATION_MS2 = 30.0
"""A floor holds as long as this acceleration along the object's whole length stretches the part by no more."""

SHEET_LIMIT_CELLS = 1.0
"""Sheets are never thickened past one grid cell: their layers would part (0.58 of the thickness between them)."""

ROD_LIMIT_CELLS = 3.0
"""Rods: their 3 x 3 strands then stand 0.92 cells apart."""

_LARGEST_CAPPED_STRAIN = 0.01
_CAPPED_THIN_SHARE = 0.05
_UNSEEN_RATE = 2.0
"""A swing of this many periods per frame is not seen."""

_SHAPELESS = (LawId.DRUCKER_PRAGER, LawId.SNOW, LawId.FLUID)
"""Laws whose thin layers have no bending stiffness that thickening would keep."""

_YIELD_NUMBERS = ("yield_stress_pa", "residual_yield_stress_pa")
_MODULUS_NUMBERS = ("hardening_modulus_pa", "viscosity_pas", "consistency_pasn")
"""Numbers that scale as a yield stress or as a modulus where a part is thickened."""


@dataclass(frozen=True)
class PartThickening:
    """How a part's thin particles differ from the truth (medians), for the report.

    Attributes:
        part: name.
        true_mm: thickness of the sheet or diameter of the rod.
        simulated_mm: the same as simulated.
        true_youngs_modulus_pa: of the material.
        simulated_youngs_modulus_pa: as simulated.
        true_density_kgm3: of the material.
        simulated_density_kgm3: as simulated.
    """

    part: str
    true_mm: float
    simulated_mm: float
    true_youngs_modulus_pa: float
    simulated_youngs_modulus_pa: float
    true_density_kgm3: float
    simulated_density_kgm3: float


@dataclass(frozen=True)
class CappedPart:
    """A part whose thickest regions are simulated softer than they are, because it cannot be seen (PHYSICS.md 1.10).

    Attributes:
        part: name.
        true_youngs_modulus_pa: median there, as thickened.
        simulated_youngs_modulus_pa: what the time step allows.
        largest_strain: estimate rho (v^2 + g L) / E of the strain that the softer material takes.
    """

    part: str
    true_youngs_modulus_pa: float
    simulated_youngs_modulus_pa: float
    largest_strain: float


@dataclass(frozen=True, eq=False)
class Assembly:
    """A body and how to read the truth back from its motion.

    Attributes:
        body: what the solver moves, metres, z up.
        true_offset_m: from the simulated to the true rest position of each particle, metres, z up, [P, 3].
        mass_kg: true mass of each particle, [P].
        thickening: parts that are simulated thicker than they are.
        strain_ratio: true strain over simulated strain of each particle where it bends, [P].
        section_means: weights that give the K thickened particles the mean over their cross-section, [K, K].
        yield_strain: strain at which the material yields, infinite where it is not known, [P].
        capped: parts whose thick regions are simulated softer than they are.
    """

    body: Body
    true_offset_m: NDArray[np.float64]
    mass_kg: NDArray[np.float64]
    strain_ratio: NDArray[np.float64]
    section_means: sparse.csr_matrix
    yield_strain: NDArray[np.float64]
    thickening: tuple[PartThickening, ...]
    capped: tuple[CappedPart, ...]

    def true_motion(
        self, positions_m: NDArray[np.float64], deformation_gradients: NDArray[np.floating]
    ) -> tuple[NDArray[np.float64], NDArray[np.floating]]:
        """Positions [P, 3] and F [P, 3, 3] of the true (not thickened) body, given those of the simulated one.

        Where a thin part bends, F differs from its mean over the thickness in proportion to the distance from the
        middle. The simulated particles stand farther from it, so that part of F is theirs, not the true body's.
        """
        thickened = self.strain_ratio < 1
        simulated = deformation_gradients[thickened].astype(np.float64)
        mean = (self.section_means @ simulated.reshape(-1, 9)).reshape(-1, 3, 3)
        true = mean + self.strain_ratio[thickened, None, None] * (simulated - mean)
        # The way from the simulated to the true place is the integral of F, which is linear there.
        between = (simulated + true) / 2
        true_positions_m, true_gradients = positions_m.copy(), deformation_gradients.copy()
        true_positions_m[thickened] += np.einsum("pab,pb->pa", between, self.true_offset_m[thickened])
        true_gradients[thickened] = true
        return true_positions_m, true_gradients


def assemble_body(
    continuum: Continuum,
    parts: Parts,
    book: MaterialBook,
    *,
    frame: Frame,
    held: NDArray[np.bool_],
    rigid: NDArray[np.bool_],
    cell_m: float,
    max_wave_speed_ms: float,
    rigid_wave_speed_ms: float,
    fps: float,
) -> Assembly:
    """Give every particle its material, and thicken thin parts until waves are slow enough.

    Args:
        continuum: particles at the true thickness.
        parts: names.
        book: material of every part, surface and interior.
        frame: input coordinates -> metres.
        held: particles that do not move.
        rigid: particles that move and do not deform.
        cell_m: grid cell dx of the simulation, m.
        max_wave_speed_ms: thin parts are thickened until their P-wave is no faster, or to the limit; thick regions
            are capped at the speed that the thin ones leave, where nobody can see it.
        rigid_wave_speed_ms: mostly solid parts with a faster P-wave are not capped; they had better be rigid.
        fps: frames per second of the film, which says how fast a swing can be seen.
    """
    p = len(continuum)
    still = held | rigid
    density, modulus, poisson = np.zeros(p), np.zeros(p), np.zeros(p)
    yield_strain = np.full(p, math.inf)
    law = np.zeros(p, np.int32)
    numbers = {name: np.full(p, math.nan) for name in KNOWN_NUMBERS}
    for number, name in enumerate(parts.names):
        mine = continuum.part == number
        for inside, material in ((False, book.parts[name].surface), (True, book.parts[name].interior)):
            chosen = mine & (continuum.is_interior == inside)
            density[chosen] = material.density_kgm3
            modulus[chosen] = material.youngs_modulus_pa
            poisson[chosen] = material.poisson_ratio
            law[chosen] = LawId[material.law.upper()]
            for key, value in complete_numbers(material.law, material.extra).items():
                numbers[key][chosen] = value
            yield_strain[chosen] = _yield_strain(material)
    # A slender rod is free to contract across its axis and feels E alone; its strands, thinner than a cell, cannot
    # contract, and with nu they would bend and carry waves with the P-wave modulus instead.
    shapeless = np.isin(law, _SHAPELESS)
    poisson[(continuum.shape == ROD) & ~still & ~shapeless] = 0.0

    extent_m = float(np.ptp(frame.to_metres(continuum.positions), axis=0).max())
    ratio = _thickening(continuum, density, modulus, poisson, cell_m, max_wave_speed_ms, extent_m)
    ratio[still | shapeless] = 1.0
    offset_m = continuum.offset_m * (ratio - 1)[:, None]
    sheet, rod = continuum.shape == SHEET, continuum.shape == ROD
    thin_density = density / np.where(sheet, ratio, np.where(rod, ratio**2, 1))
    thin_modulus = modulus / np.where(sheet, ratio**3, np.where(rod, ratio**4, 1))
    for key in _YIELD_NUMBERS:
        numbers[key] /= np.where(sheet, ratio**2, np.where(rod, ratio**3, 1))
    for key in _MODULUS_NUMBERS:
        numbers[key] /= np.where(sheet, ratio**3, np.where(rod, ratio**4, 1))
    volume = continuum.volume_m3 * np.where(sheet, ratio, np.where(rod, ratio**2, 1))
    free_solid = (continuum.shape == SOLID) & ~still
    stoutness = _stoutness(continuum, frame, ~still, thin_density * volume)
    thin_modulus, capped = _cap(
        continuum.part, parts.names, free_solid, ~still, thin_density * volume, thin_density, thin_modulus, poisson,
        max_wave_speed_ms, rigid_wave_speed_ms, extent_m, stoutness / fps,
    )  # fmt: skip
    body = Body(
        positions_m=frame.to_metres(continuum.positions) + offset_m,
        volume_m3=volume,
        density_kgm3=thin_density,
        youngs_modulus_pa=thin_modulus,
        poisson_ratio=poisson,
        law=law,
        part=continuum.part,
        held=held,
        part_names=parts.names,
        law_numbers=numbers,
    )
    thickened = ratio > 1
    section_means = sparse.csr_matrix((0, 0))
    if thickened.any():
        section_means = cross_section_means(continuum.subset(thickened), frame=frame)
    thickening = _report(continuum, parts.names, ratio, density, modulus, thin_density, thin_modulus)
    return Assembly(
        body,
        true_offset_m=-offset_m,
        mass_kg=continuum.volume_m3 * density,
        strain_ratio=1 / ratio,
        section_means=section_means,
        yield_strain=yield_strain,
        thickening=thickening,
        capped=capped,
    )


def _yield_strain(material: Material) -> float:
    """Strain beyond which the material does not come back, infinite where it is not known."""
    if material.law in ("drucker_prager", "fluid"):
        return 0.0
    if material.law == "snow":
        return min(material.extra["critical_compression"], material.extra["critical_stretch"])
    return material.extra.get("yield_stress_pa", math.inf) / material.youngs_modulus_pa


def _thickening(
    continuum: Continuum,
    density: NDArray[np.float64],
    modulus: NDArray[np.float64],
    poisson: NDArray[np.float64],
    cell_m: float,
    max_wave_speed_ms: float,
    extent_m: float,
) -> NDArray[np.float64]:
    """Simulated over true thickness of each particle, at least 1."""
    thin, rod = continuum.shape != SOLID, continuum.shape == ROD
    cells = np.where(thin, cell_m / np.where(thin, continuum.thickness_m, math.inf), 0.0)
    for_speed = np.sqrt(_p_wave_modulus(modulus, poisson) / density) / max_wave_speed_ms
    stretch = density * _LARGEST_ACCELERATION_MS2 * extent_m / modulus  # grows with the square of the thickening
    for_bending = np.minimum(
        cells * np.where(rod, ROD_FLOOR_CELLS, SHEET_FLOOR_CELLS), np.sqrt(_LARGEST_STRETCH / stretch)
    )
    limit = cells * np.where(rod, ROD_LIMIT_CELLS, SHEET_LIMIT_CELLS)
    return np.maximum(np.minimum(np.maximum(for_speed, for_bending), limit), 1.0)


def _p_wave_modulus(modulus: NDArray[np.float64] | float, poisson: NDArray[np.float64]) -> NDArray[np.float64]:
    """P-wave modulus lam + 2 mu = E (1 - nu) / ((1 + nu) (1 - 2 nu))."""
    return modulus * (1 - poisson) / ((1 + poisson) * (1 - 2 * poisson))


def _cap(
    part: NDArray[np.int32],
    names: tuple[str, ...],
    solid: NDArray[np.bool_],
    free: NDArray[np.bool_],
    mass: NDArray[np.float64],
    thin_density: NDArray[np.float64],
    thin_modulus: NDArray[np.float64],
    poisson: NDArray[np.float64],
    max_wave_speed_ms: float,
    rigid_wave_speed_ms: float,
    extent_m: float,
    stoutness_s_per_m: NDArray[np.float64],
) -> tuple[NDArray[np.float64], tuple[CappedPart, ...]]:
    """Young's moduli with the stiffest regions softened to the wave speed that the rest of the body needs anyway.

    A thick lump among thin leaves stays far stiffer than what it hangs on, and 5 % of the thin mass, its thickest
    spots, may not set the time step of all. The strain rho (v^2 + g L) / E that the softer material takes, with
    v = 1 m/s and L the object's size, must stay below 1 %, and a part that is mostly solid must still swing faster
    than a film can show (twice the frame rate); else the modulus stays as it is. (PHYSICS.md 1.10.)
    """
    thin = free & ~solid
    speeds = np.sqrt(_p_wave_modulus(thin_modulus, poisson) / thin_density)
    speed = max(max_wave_speed_ms, _mass_quantile(speeds[thin], mass[thin], 1 - _CAPPED_THIN_SHARE))
    allowed = thin_density * speed**2 / _p_wave_modulus(1.0, poisson)
    strain = thin_density * (1.0 + 9.81 * extent_m) / allowed
    invisible = (strain < _LARGEST_CAPPED_STRAIN) & (stoutness_s_per_m * np.sqrt(allowed / thin_density) > _UNSEEN_RATE)
    within_reach = thin_density * rigid_wave_speed_ms**2 >= thin_modulus * _p_wave_modulus(1.0, poisson)
    chosen = free & (thin_modulus > 1.001 * allowed) & invisible & (within_reach | np.isinf(stoutness_s_per_m))
    capped = []
    for number in np.unique(part[chosen]):
        mine = chosen & (part == number)
        capped.append(
            CappedPart(
                names[int(number)],
                float(np.median(thin_modulus[mine])),
                float(np.median(allowed[mine])),
                float(strain[mine].max()),
            )
        )
    return np.where(chosen, allowed, thin_modulus), tuple(capped)


def _stoutness(
    continuum: Continuum, frame: Frame, free: NDArray[np.bool_], mass: NDArray[np.float64]
) -> NDArray[np.float64]:
    """0.16 t / L^2 of each particle's part, [P], 1/m: times the wave speed it is the part's lowest frequency.

    t and L are the shortest and the longest side of the part's box along its principal axes. Parts that are mostly
    sheets and rods bend in those, whatever their thick spots do: infinite.
    """
    found = np.full(len(continuum), math.inf)
    for number in np.unique(continuum.part[free]):
        mine = free & (continuum.part == number)
        if mass[mine & (continuum.shape == SOLID)].sum() > 0.5 * mass[mine].sum():
            points = frame.to_metres(continuum.positions[mine])
            points -= points.mean(0)
            sides = np.ptp(points @ np.linalg.svd(points.T @ points)[0], axis=0) + continuum.spacing_m
            found[continuum.part == number] = 0.16 * sides.min() / sides.max() ** 2
    return found


def _mass_quantile(values: NDArray[np.float64], mass: NDArray[np.float64], share: float) -> float:
    """The value that ``share`` of the mass does not exceed; 0 where there is none."""
    if len(values) == 0:
        return 0.0
    order = np.argsort(values)
    reached = np.cumsum(mass[order]) >= share * mass.sum()
    return float(values[order][np.argmax(reached)])


def _report(
    continuum: Continuum,
    names: tuple[str, ...],
    ratio: NDArray[np.float64],
    density: NDArray[np.float64],
    modulus: NDArray[np.float64],
    thin_density: NDArray[np.float64],
    thin_modulus: NDArray[np.float64],
) -> tuple[PartThickening, ...]:
    entries = []
    for number, name in enumerate(names):
        mine = (continuum.part == number) & (ratio > 1.001)
        if mine.any():
            t = 1e3 * continuum.thickness_m[mine]
            middle = [np.median(v[mine]) for v in (modulus, thin_modulus, density, thin_density)]
            entries.append(
                PartThickening(name, float(np.median(t)), float(np.median(t * ratio[mine])), *map(float, middle))
            )
    return tuple(entries)
