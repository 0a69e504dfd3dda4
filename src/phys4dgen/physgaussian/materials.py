"""PhysGaussian's materials -> ours: the law of the same name, its numbers in our conventions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import SceneError
from phys4dgen.materials import find_entry
from phys4dgen.physgaussian.configuration import Configuration, Mode
from phys4dgen.physgaussian.material_point import stress_excess
from phys4dgen.physgaussian.placement import Placement
from phys4dgen.types import Gaussians, Material, MaterialBook, PartMaterials

__all__ = ["BASE_PART", "labels_of_regions", "material_book"]

BASE_PART = "object"
_LEAST_YIELD_PA = 1e-3
_LARGEST_NU = 0.4999
_DUST_PA = 1.0


def labels_of_regions(gaussians: Gaussians, config: Configuration, placement: Placement) -> NDArray[np.int32]:
    """0 for the base material, k + 1 for entry k of ``additional_material_params``; later entries win. Shape [N]."""
    places = placement.to_mpm(gaussians.means)
    labels = np.zeros(len(gaussians), np.int32)
    for number, region in enumerate(config.additional_material_params):
        labels[(np.abs(places - region.point) < region.size).all(1)] = number + 1
    return labels


def material_book(config: Configuration, parts: dict[int, str], *, mode: Mode, notes: list[str]) -> MaterialBook:
    """Materials of the parts.

    Args:
        config: the configuration.
        parts: name of each part by its label, see ``labels_of_regions``.
        mode: corrected or compat.
        notes: what differs is added to it.

    Raises:
        SceneError: PhysGaussian itself stops on these numbers.
    """
    law = _law(config, mode, notes)
    book = {}
    for label, name in parts.items():
        region = config.additional_material_params[label - 1] if label else None
        youngs_pa = config.E if region is None else region.E
        density = config.density if region is None or region.density is None else region.density
        book[name] = _material(
            law,
            name=name,
            youngs_pa=youngs_pa,
            nu=_poisson(config.nu if region is None else region.nu, name, mode, notes),
            density=density,
        )
        _note_time_step(config, book[name], notes)
    return MaterialBook({name: PartMaterials(material, material) for name, material in book.items()})


@dataclass(frozen=True)
class _Law:
    """One of our laws.

    Attributes:
        name: of the law.
        numbers: in our conventions.
        xi: hardening by 3 mu xi, mu of the part; 0: none.
        youngs_pa: instead of the file's.
    """

    name: str
    numbers: Mapping[str, float] = field(default_factory=dict)
    xi: float = 0.0
    youngs_pa: float | None = None


def _material(law: _Law, *, name: str, youngs_pa: float, nu: float, density: float) -> Material:
    """One of our materials."""
    hardening = {"hardening_modulus_pa": 3 * youngs_pa / (2 * (1 + nu)) * law.xi} if law.xi else {}
    try:
        return Material(
            name=f"{name} of PhysGaussian",
            law=law.name,
            density_kgm3=density,
            youngs_modulus_pa=youngs_pa if law.youngs_pa is None else law.youngs_pa,
            poisson_ratio=nu,
            source="user",
            extra={**law.numbers, **hardening},
        )
    except ValueError as error:
        raise SceneError(f"part '{name}' of the configuration: {error}") from error


def _poisson(nu: float, name: str, mode: Mode, notes: list[str]) -> float:
    if nu <= _LARGEST_NU:
        return nu
    if mode == "compat":
        raise SceneError(f"nu {nu:g} of '{name}': PhysGaussian divides by zero at 0.5; give less, or --mode corrected.")
    notes.append(f"nu: {nu:g} of '{name}' becomes {_LARGEST_NU}; PhysGaussian divides by zero at 0.5.")
    return _LARGEST_NU


def _law(config: Configuration, mode: Mode, notes: list[str]) -> _Law:
    """Our law in the place of PhysGaussian's."""
    match config.material:
        case "metal" | "foam":
            return _yielding(config, mode, notes)
        case "plasticine":
            return _plasticine(config, notes)
        case "sand":
            angle = min(max(config.friction_angle, 1.0), 60.0)
            if angle != config.friction_angle:
                notes.append(f"friction_angle: {config.friction_angle:g} becomes {angle:g}, the nearest that there is.")
            return _Law("drucker_prager", {"friction_angle_deg": angle})
        case "snow":
            return _snow(mode, notes)
        case _:
            return _Law("fixed_corotated")


def _yielding(config: Configuration, mode: Mode, notes: list[str]) -> _Law:
    """Metal and foam."""
    _note_stress(config, mode, notes)
    if config.yield_stress <= 0 and mode == "corrected":
        notes.append(
            f"yield_stress: not given, which makes PhysGaussian's {config.material} flow like dust; it is elastic here."
        )
        return _Law("stvk_hencky")
    stress = max(config.yield_stress, _LEAST_YIELD_PA)
    if config.material == "foam":
        # our viscosity is that of rheometers, which is half of the source's
        return _Law("viscoplastic", {"yield_stress_pa": stress, "viscosity_pas": config.plastic_viscosity / 2})
    notes.append("yield_stress: PhysGaussian compares it with |dev tau|; in a tensile test it is sqrt(3/2) as much.")
    xi = config.xi if config.hardening == 1 else 0.0
    return _Law("von_mises", {"yield_stress_pa": math.sqrt(1.5) * stress}, xi=xi)


def _plasticine(config: Configuration, notes: list[str]) -> _Law:
    if config.yield_stress <= 0:
        notes.append("yield_stress: not given; plasticine is then elastic, in PhysGaussian as here.")
        return _Law("fixed_corotated")
    notes.append(
        f"softening: {config.softening:g} Pa per unit of plastic strain, of a yield stress of {config.yield_stress:g} "
        "Pa; elasticity is that of Hencky strain and not fixed corotated, which differ at large stretches; what is "
        "broken keeps its bulk under pressure."
    )
    falling = {"hardening_modulus_pa": -1.5 * config.softening} if config.softening > 0 else {}
    return _Law("von_mises", {"yield_stress_pa": math.sqrt(1.5) * config.yield_stress, **falling})


def _snow(mode: Mode, notes: list[str]) -> _Law:
    if mode == "compat":
        notes.append(f"material: PhysGaussian gives snow no stress at all; E is {_DUST_PA:g} Pa, the least there is.")
        return _Law("neo_hookean", youngs_pa=_DUST_PA)
    notes.append("material: PhysGaussian gives snow no stress at all; it gets the snow of Stomakhin et al. 2013.")
    entry = find_entry("snow_packed")
    assert entry is not None  # a part of the library that is tested
    return _Law("snow", {key: quantity.value for key, quantity in entry.extra.items()})


def _note_stress(config: Configuration, mode: Mode, notes: list[str]) -> None:
    excess = 100 * stress_excess(config, 0.1)
    notes.append(
        f"material: PhysGaussian's stress of {config.material} has a factor too many ({excess:.0f} % off in a shear of "
        + (
            "10 % strain); the law is used without it."
            if mode == "corrected"
            else "10 % strain); our solver has it not."
        )
    )


def _note_time_step(config: Configuration, material: Material, notes: list[str]) -> None:
    nu = material.poisson_ratio
    modulus = material.youngs_modulus_pa * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    share = math.sqrt(modulus / material.density_kgm3) * config.substep_dt / config.cell
    if share > 1:
        notes.append(
            f"substep_dt: a wave in '{material.name}' crosses {share:.1f} cells in {config.substep_dt:g} s, so "
            "PhysGaussian blows up; the time step is ours."
        )
