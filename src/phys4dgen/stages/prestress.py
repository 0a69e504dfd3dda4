"""Whether the shape given carries its weight from the start, with which stiffness, and the strain with which it does.

A captured shape is evidence. It stood under its weight, so it is at least as stiff as standing takes, and the typical
modulus of a class of materials, which may be wrong by ten times, gives way to that.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from phys4dgen.body import CappedPart, PartThickening
from phys4dgen.errors import SceneError
from phys4dgen.materials import find_entry
from phys4dgen.motion import gust
from phys4dgen.mpm import Body, Prestress, prestress, stiff_parts, stiffened
from phys4dgen.progress import Progress
from phys4dgen.scene import Scene
from phys4dgen.stages.asset import Asset
from phys4dgen.stages.motion_facts import Prestressing
from phys4dgen.stages.motion_plan import Plan
from phys4dgen.types import Material, MaterialBook, Parts

__all__ = ["with_prestress"]

_Entry = TypeVar("_Entry", PartThickening, CappedPart)

_CAPTURED_UNDER_MS2 = (0.0, 0.0, -9.81)
_TOLERANCE = 2e-4  # of the height
_STANDING_SAG = 0.03
"""Of the height. What would sag by more under its weight is made stiffer until it does not, for the shape stood."""
_MOST_TIMES = 10.0
"""A library's modulus is not trusted less than this."""
_LARGEST_SAG = 0.1
"""Of the height, that is taken on unasked where nothing may be made stiffer, or not enough."""
_LARGE_STRAIN = 0.3
_YIELDING_SHARE = 0.01
_HANGING_SHARE = 0.01
"""Shares of the mass that are worth a warning."""


def with_prestress(
    scene: Scene, asset: Asset, parts: Parts, book: MaterialBook, plan: Plan, progress: Progress
) -> Plan:
    """The plan with a body in equilibrium with its weight, where weight acts and something holds the body.

    Raises:
        SceneError: the scene asks for it where there is no equilibrium to begin with.
    """
    if scene.prestress == "off":
        return plan
    settings = plan.settings
    if plan.facts.gravity != "on":
        if scene.prestress == "on":
            raise SceneError(
                f"prestress: on balances a weight, but gravity is '{plan.facts.gravity}'; add gravity: on "
                "(--gravity on)."
            )
        return plan
    glued = settings.ground is not None and settings.ground.contact == "sticky"
    found, started = None, time.perf_counter()
    may_be_stiffer = _may_be_stiffer(plan.assembly.body, parts, book)
    most = _MOST_TIMES if may_be_stiffer.any() else 1.0
    if plan.assembly.body.held.any() or settings.drives or glued:
        found = _found(scene, asset, plan, progress, most_times=most)
    if found is None:
        if scene.prestress == "on":
            raise SceneError(
                "prestress: on needs something elastic that hangs on something held, but here "
                f"{plan.facts.held}; hold what carries the object (--hold PART), or leave prestress out."
            )
        return plan
    sag_m, times = found.sag_m, 1.0
    if found.sag_m > _STANDING_SAG * asset.height_m and may_be_stiffer.any():
        times = min(found.sag_m / (_STANDING_SAG * asset.height_m), most)
        times = _affordable(plan, may_be_stiffer, times)
        stiffer = _with_stiffer(scene, plan, may_be_stiffer, times)
        if may_be_stiffer[found.carried].all():
            found = stiffened(found, times)
        else:
            found = _found(scene, asset, stiffer, progress, most_times=1.0)
            assert found is not None
        plan = stiffer if _stands(scene, found, asset) else plan
    if not _stands(scene, found, asset):
        even = f", even {times:.2g} times as stiff as their materials usually are" if times > 1 else ""
        progress.warn(
            f"Gravity acts on an unloaded shape, which sags by {found.sag_m / asset.height_m:.0%} of the height or "
            f"more{even}, and may fall over; a captured shape hangs already: use gravity: rest, or stiffer materials. "
            "(prestress: on balances the weight all the same, but so soft a body seldom stays in balance.)"
        )
        return plan
    yielding = _yielding(plan, found, parts)
    stiffer_parts = tuple(
        name for number, name in enumerate(parts.names) if times > 1 and _of_part(found, number, may_be_stiffer).any()
    )
    facts = plan.facts.prestress = Prestressing(
        largest_strain=found.largest_strain,
        sag_m=found.sag_m,
        change_m=found.change_m,
        iterations=found.iterations,
        converged=found.converged,
        yielding=yielding,
        stiffer_times=times,
        stiffer_parts=stiffer_parts,
        sag_as_given_m=sag_m,
    )
    _tell(facts, found, asset, time.perf_counter() - started, progress)
    body = replace(plan.assembly.body, initial_gradients=found.deformation_gradients)
    return replace(plan, assembly=replace(plan.assembly, body=body))


def _found(scene: Scene, asset: Asset, plan: Plan, progress: Progress, *, most_times: float) -> Prestress | None:
    """The prestress of the plan's body, which may still be made so many times stiffer."""
    return prestress(
        plan.assembly.body,
        plan.settings,
        gravity_ms2=_CAPTURED_UNDER_MS2,
        tolerance_m=_TOLERANCE * asset.height_m,
        standing_sag_m=_STANDING_SAG * asset.height_m if most_times > 1 else math.inf,
        largest_sag_m=math.inf if scene.prestress == "on" else most_times * _LARGEST_SAG * asset.height_m,
        on_progress=lambda done, most: progress.update(done, most, "iterations of the prestress"),
    )


def _stands(scene: Scene, found: Prestress, asset: Asset) -> bool:
    return scene.prestress == "on" or found.sag_m <= _LARGEST_SAG * asset.height_m


def _of_part(found: Prestress, number: int, chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return found.carried & chosen & (found.simulated.part == number)


# ------------------------------------------------------------------------------------------------ stiffer materials


def _may_be_stiffer(body: Body, parts: Parts, book: MaterialBook) -> NDArray[np.bool_]:
    """Particles that move and whose modulus is a guess or a library's, and not a number that the user wrote."""
    guessed = [not any(map(_is_written, (book.parts[name].surface, book.parts[name].interior))) for name in parts.names]
    return ~body.held & np.array(guessed)[body.part]


def _is_written(material: Material) -> bool:
    entry = find_entry(material.name)
    of_library = entry is not None and math.isclose(entry.youngs_modulus_pa.value, material.youngs_modulus_pa)
    return material.source == "user" and not of_library


def _affordable(plan: Plan, chosen: NDArray[np.bool_], times: float) -> float:
    """As many times as stiff, as far as the limit of substeps goes."""
    body = plan.assembly.body
    stiff = stiff_parts(_stiffer_body(body, chosen, times), plan.settings)
    return max(1.0, min([times, *(times * part.affordable_modulus_pa / part.youngs_modulus_pa for part in stiff)]))


def _stiffer_body(body: Body, chosen: NDArray[np.bool_], times: float) -> Body:
    return replace(body, youngs_modulus_pa=np.where(chosen, times, 1.0) * body.youngs_modulus_pa)


def _with_stiffer(scene: Scene, plan: Plan, chosen: NDArray[np.bool_], times: float) -> Plan:
    """The plan with chosen particles so many times as stiff, swinging and pushed accordingly."""
    assembly, facts, settings = plan.assembly, plan.facts, plan.settings
    names = [assembly.body.part_names[number] for number in np.unique(assembly.body.part[chosen])]
    assembly = replace(
        assembly,
        body=_stiffer_body(assembly.body, chosen, times),
        yield_strain=np.where(chosen, 1 / times, 1.0) * assembly.yield_strain,
        thickening=tuple(
            _stiffer_entry(entry, times) if entry.part in names else entry for entry in assembly.thickening
        ),
        capped=tuple(_stiffer_entry(entry, times) if entry.part in names else entry for entry in assembly.capped),
    )
    facts = replace(facts, thickening=list(assembly.thickening), capped=list(assembly.capped))
    if facts.frequency_hz is not None:
        facts.frequency_hz *= math.sqrt(times)
        facts.damping_per_s *= math.sqrt(times)
        settings = replace(settings, damping_per_s=facts.damping_per_s)
    if facts.wind_up is not None and isinstance(scene.motion.acceleration_ms2, str):
        facts.gust_ms2 *= times
        stronger = gust(np.array(facts.wind_up), facts.gust_ms2, facts.gust_s)
        settings = replace(settings, loads=(*settings.loads[:-1], stronger))
    return replace(plan, assembly=assembly, facts=facts, settings=settings)


def _stiffer_entry(entry: _Entry, times: float) -> _Entry:
    return replace(
        entry,
        true_youngs_modulus_pa=times * entry.true_youngs_modulus_pa,
        simulated_youngs_modulus_pa=times * entry.simulated_youngs_modulus_pa,
    )


# ------------------------------------------------------------------------------------------------ what is said


def _yielding(plan: Plan, found: Prestress, parts: Parts) -> tuple[str, ...]:
    """Parts of which a visible share is strained beyond yield."""
    assembly = plan.assembly
    strain = np.linalg.norm(found.strains, axis=(1, 2)) * assembly.strain_ratio
    beyond = found.carried & (strain > assembly.yield_strain)
    mass_kg = [assembly.mass_kg * (assembly.body.part == number) for number in range(parts.count)]
    return tuple(
        name
        for name, own in zip(parts.names, mass_kg, strict=True)
        if own[beyond].sum() > _YIELDING_SHARE * max(own.sum(), 1e-300)
    )


def _tell(facts: Prestressing, found: Prestress, asset: Asset, seconds: float, progress: Progress) -> None:
    if facts.stiffer_parts:
        given, now = facts.sag_as_given_m / asset.height_m, found.sag_m / asset.height_m
        progress.warn(
            f"With the usual stiffness of its materials the object would sag by {given:.0%} of its height, but it was "
            f"captured standing: {', '.join(facts.stiffer_parts)} now with {facts.stiffer_times:.2g} times the Young's "
            f"modulus, which makes it {now:.0%}. A part keeps the youngs_modulus_pa that you write for it in "
            "materials.yaml; prestress: off and gravity: rest leave all as they are."
        )
    progress.note(
        f"Prestress: the shape given carries its weight, with strains up to {found.largest_strain:.2%}; unstrained it "
        f"would sag by {1e3 * found.sag_m:.3g} mm, of which {1e3 * found.change_m:.2g} mm are not balanced "
        f"({found.iterations} iterations, {seconds:.0f} s)."
    )
    if not found.converged:
        progress.warn(
            f"The prestress was not balanced to {_TOLERANCE:.2%} of the height within {found.iterations} iterations: "
            f"the object may still move by about {found.change_m / asset.height_m:.2%}."
        )
    if found.largest_strain > _LARGE_STRAIN or facts.yielding:
        what = f"strains of up to {found.largest_strain:.0%}" if found.largest_strain > _LARGE_STRAIN else "yield"
        of = f" of part {', '.join(facts.yielding)}" if facts.yielding else ""
        progress.warn(
            f"With these materials the object could hardly carry itself: its weight takes {what}{of}; give it stiffer "
            "ones, or use gravity: rest."
        )
    if found.hanging_share > _HANGING_SHARE:
        progress.warn(f"{found.hanging_share:.0%} of the mass hangs on nothing that is held, and falls.")
