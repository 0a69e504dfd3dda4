"""Whether the shape given carries its weight from the start, and the strain with which it does."""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np

from phys4dgen.errors import SceneError
from phys4dgen.mpm import Prestress, prestress
from phys4dgen.progress import Progress
from phys4dgen.scene import Scene
from phys4dgen.stages.asset import Asset
from phys4dgen.stages.motion_facts import Prestressing
from phys4dgen.stages.motion_plan import Plan
from phys4dgen.types import Parts

__all__ = ["with_prestress"]

_CAPTURED_UNDER_MS2 = (0.0, 0.0, -9.81)
_TOLERANCE = 2e-4  # of the height
_LARGEST_SAG = 0.03
"""Of the height, that is taken on unasked. What would sag by more can mostly not stand in the shape given: the balance
is not stable, and a captured plant with 9 % collapsed within a second, from errors of 0.05 %."""
_LARGE_STRAIN = 0.3
_YIELDING_SHARE = 0.01
_HANGING_SHARE = 0.01
"""Shares of the mass that are worth a warning."""


def with_prestress(scene: Scene, asset: Asset, parts: Parts, plan: Plan, progress: Progress) -> Plan:
    """The plan with a body in equilibrium with its weight, where weight acts and something holds the body.

    Raises:
        SceneError: the scene asks for it where there is no equilibrium to begin with.
    """
    if scene.prestress == "off":
        return plan
    facts, body, settings = plan.facts, plan.assembly.body, plan.settings
    if facts.gravity != "on":
        if scene.prestress == "on":
            raise SceneError(
                f"prestress: on balances a weight, but gravity is '{facts.gravity}'; add gravity: on (--gravity on)."
            )
        return plan
    glued = settings.ground is not None and settings.ground.contact == "sticky"
    found, started = None, time.perf_counter()
    if body.held.any() or settings.drives or glued:
        found = prestress(
            body,
            settings,
            gravity_ms2=_CAPTURED_UNDER_MS2,
            tolerance_m=_TOLERANCE * asset.height_m,
            largest_sag_m=math.inf if scene.prestress == "on" else _LARGEST_SAG * asset.height_m,
            on_progress=lambda done, most: progress.update(done, most, "iterations of the prestress"),
        )
    if found is None:
        if scene.prestress == "on":
            raise SceneError(
                "prestress: on needs something elastic that hangs on something held, but here "
                f"{facts.held}; hold what carries the object (--hold PART), or leave prestress out."
            )
        return plan
    if scene.prestress == "auto" and found.sag_m > _LARGEST_SAG * asset.height_m:
        progress.warn(
            f"Gravity acts on an unloaded shape, which sags by {found.sag_m / asset.height_m:.0%} of the height or "
            "more and may fall over; a captured shape hangs already: use gravity: rest, or stiffer materials. "
            "(prestress: on balances the weight all the same, but so soft a body seldom stays in balance.)"
        )
        return plan
    yielding = _yielding(plan, found, parts)
    facts.prestress = Prestressing(
        found.largest_strain, found.sag_m, found.change_m, found.iterations, found.converged, yielding
    )
    _tell(found, yielding, asset, time.perf_counter() - started, progress)
    body = replace(body, initial_gradients=found.deformation_gradients)
    return replace(plan, assembly=replace(plan.assembly, body=body))


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


def _tell(found: Prestress, yielding: tuple[str, ...], asset: Asset, seconds: float, progress: Progress) -> None:
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
    if found.largest_strain > _LARGE_STRAIN or yielding:
        what = f"strains of up to {found.largest_strain:.0%}" if found.largest_strain > _LARGE_STRAIN else "yield"
        of = f" of part {', '.join(yielding)}" if yielding else ""
        progress.warn(
            f"With these materials the object could hardly carry itself: its weight takes {what}{of}; give it stiffer "
            "ones, or use gravity: rest."
        )
    if found.hanging_share > _HANGING_SHARE:
        progress.warn(f"{found.hanging_share:.0%} of the mass hangs on nothing that is held, and falls.")
