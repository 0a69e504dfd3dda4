"""From the scene to what the solver gets: which preset, what pushes it (probed first), how it is damped."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from phys4dgen.body import Assembly
from phys4dgen.errors import SimulationError
from phys4dgen.motion import (
    Held,
    ProbeResult,
    damped_drop_per_s,
    damping_per_s,
    gust,
    probe_gust,
)
from phys4dgen.mpm import Drive, Settings
from phys4dgen.mpm.loads import Load
from phys4dgen.progress import Progress
from phys4dgen.scene import Scene
from phys4dgen.stages.asset import Asset
from phys4dgen.stages.motion_body import Given, Prepared, ground_below_m, prepare, solids_of
from phys4dgen.stages.motion_facts import MotionFacts
from phys4dgen.stages.motion_loads import LoadMaker
from phys4dgen.stages.motion_obstacles import drawn_obstacles
from phys4dgen.stages.motion_presets import acts_by_itself, twist
from phys4dgen.types import Continuum, MaterialBook, Parts

__all__ = ["Plan", "plan_motion"]

_GRAVITY_MS2 = 9.81
_STRONGEST_SWAY_MS2 = 3 * _GRAVITY_MS2
_VISIBLE_SAG = 0.03
_YIELDING_SHARE = 0.01
"""A part is taken beyond yield where this share of its mass is; single particles at a notch say little."""


@dataclass(frozen=True, eq=False)
class Plan:
    """What is simulated, and how.

    Attributes:
        held: what does not move.
        assembly: the body, with rigid bodies and bonds.
        settings: loads, ground and damping.
        facts: what was decided, for the report.
    """

    held: Held
    assembly: Assembly
    settings: Settings
    facts: MotionFacts


def plan_motion(
    scene: Scene, asset: Asset, parts: Parts, continuum: Continuum, book: MaterialBook, progress: Progress
) -> Plan:
    """Decide what happens to the object.

    Raises:
        SceneError: a part that the scene names does not exist.
        SimulationError: nothing could move.
    """
    given = Given(scene, asset, parts, continuum, book, progress)
    asked = scene.motion.preset
    why = ""
    if asked == "auto" and scene.objects:
        asked, why = ("rest", "") if scene.gravity in ("rest", "off") else ("drop", "drop, as with several objects")
    elif asked == "auto" and not acts_by_itself(scene):
        return _sway_or_drop(given)
    prepared = prepare(given, "rest" if asked == "auto" else asked)
    if prepared.held.particles.all():
        raise SimulationError(
            f"Every part is held ({prepared.held.reason}); free one with 'parts: {{NAME: {{hold: free}}}}'."
        )
    swings = asked == "sway" or (prepared.around.preset == "rest" and acts_by_itself(scene) and not scene.objects)
    probe = _probe(given, prepared) if swings and prepared.held.particles.any() else None
    return _finish(given, prepared, probe, why=why)


def _sway_or_drop(given: Given) -> Plan:
    """``sway`` if a gust can do it and breaks nothing, else ``drop``."""
    prepared = prepare(given, "sway")
    if not prepared.assembly.body.is_soft.any():
        return _finish(given, prepare(given, "drop"), None, why="drop, since nothing that is not held would bend")
    probe = _probe(given, prepared)
    strength = probe.acceleration_ms2
    if strength > _STRONGEST_SWAY_MS2:
        why = f"drop, since a sway would take a gust of {strength / _GRAVITY_MS2:.2g} g"
        return _finish(given, prepare(given, "drop"), None, why=why)
    yielding = _first_to_yield(given, prepared.assembly, probe, strength)
    if yielding is not None:
        why = f"drop, since a sway would take part '{yielding}' beyond its yield stress"
        return _finish(given, prepare(given, "drop"), None, why=why)
    return _finish(given, prepared, probe, why=f"sway, since a gust of {strength / _GRAVITY_MS2:.2g} g is enough")


def _first_to_yield(given: Given, assembly: Assembly, probe: ProbeResult, strength_ms2: float) -> str | None:
    strain = probe.strain_per_ms2 * strength_ms2 * assembly.strain_ratio
    beyond = (strain > assembly.yield_strain) & assembly.body.is_soft
    for number, name in enumerate(given.parts.names):
        mine = assembly.body.part == number
        if assembly.mass_kg[mine & beyond].sum() > _YIELDING_SHARE * assembly.mass_kg[mine].sum():
            return name
    return None


# ------------------------------------------------------------------------------------------------ the body


def _probe(given: Given, prepared: Prepared) -> ProbeResult:
    scene, asset, progress = given.scene, given.asset, given.progress
    started = time.perf_counter()
    probe = probe_gust(
        prepared.assembly.body,
        replace(prepared.settings, ground=None, obstacles=(), changes=()),
        direction_up=_wind_up(scene, asset),
        duration_s=scene.motion.duration_s,
        aim_m=scene.motion.amplitude_rel * asset.height_m,
        damping_ratio=scene.simulation.damping_ratio,
        on_frame=lambda k, n: progress.update(k, n, "frames of the probe"),
    )
    progress.note(
        f"Probe: {1e3 * probe.displacement_per_ms2_m:.3g} mm per m/s2 of gust, swings at {probe.frequency_hz:.2g} Hz "
        f"({time.perf_counter() - started:.0f} s)."
    )
    return probe


def _finish(given: Given, prepared: Prepared, probe: ProbeResult | None, *, why: str) -> Plan:
    """The plan with its loads and its damping."""
    scene, asset, progress = given.scene, given.asset, given.progress
    around, held, settings = prepared.around, prepared.held, prepared.settings
    preset = around.preset
    facts = MotionFacts(
        preset, held.reason, why=why, gravity=around.gravity, cell_m=asset.cell_m, cfl=scene.simulation.cfl
    )
    facts.rigid = list(prepared.rigid)
    bonded = prepared.assembly.body.bonded_to_held
    assert bonded is not None
    facts.touching_particles = int((~bonded).sum())
    if around.ground is not None:
        moving_m = prepared.assembly.body.positions_m[~held.particles, 2]
        lowest_m = float(moving_m.min()) - 0.5 * given.continuum.spacing_m
        facts.ground_below_m = ground_below_m(scene, asset, preset, around.ground, lowest_m=lowest_m)
    if settings.ground is not None:
        facts.ground_height_m = settings.ground.height_m
    facts.obstacles = drawn_obstacles(solids_of(given, around), asset.frame)
    if why:
        progress.note(f"Motion: {why}.")
    loads, drives = _loads(given, prepared)
    if probe is not None:
        facts.frequency_hz = probe.frequency_hz
        facts.damping_per_s = damping_per_s(scene.simulation.damping_ratio, probe.frequency_hz)
        if scene.prestress == "off":
            _warn_of_sag(facts, probe, asset, progress)
    elif not prepared.several and (preset != "rest" or acts_by_itself(scene)):  # several move against each other
        facts.damping_per_s = damped_drop_per_s(scene.simulation.damping_ratio)
    if preset == "sway" and probe is not None:
        wind, asked = _wind_up(scene, asset), scene.motion.acceleration_ms2
        strength = probe.acceleration_ms2 if isinstance(asked, str) else asked
        facts.wind_up, facts.gust_ms2, facts.gust_s = wind.tolist(), strength, scene.motion.duration_s
        loads = (*loads, gust(wind, strength, scene.motion.duration_s))
        progress.note(f"Gust of {strength:.3g} m/s2 for {scene.motion.duration_s:g} s; held: {facts.held}.")
    if preset in ("press", "twist"):
        progress.note(f"{preset.capitalize()}: {facts.held}.")
    for change in around.changes:
        becomes, until_s = change.material or change.law or "another material", change.from_s + change.over_s
        progress.note(f"Part '{change.part}' becomes {becomes} from {change.from_s:g} to {until_s:g} s.")
    if preset == "drop":
        progress.note(f"Falls {1e3 * (facts.ground_below_m or 0):.0f} mm to the ground; {facts.held}.")
    for part in prepared.rigid:
        progress.warn(f"Part '{part.part}' does not deform: {part.reason}.")
    settings = replace(settings, loads=loads, drives=drives, damping_per_s=facts.damping_per_s)
    return Plan(held, prepared.assembly, settings, facts)


def _warn_of_sag(facts: MotionFacts, probe: ProbeResult, asset: Asset, progress: Progress) -> None:
    sag_m = probe.displacement_per_ms2_m * _GRAVITY_MS2
    if facts.gravity == "on" and sag_m > _VISIBLE_SAG * asset.height_m:
        progress.warn(
            f"Gravity acts on an unloaded shape, which sags by about {sag_m / asset.height_m:.0%} of the height; a "
            "captured shape hangs already: use prestress: auto, or gravity: rest."
        )


def _wind_up(scene: Scene, asset: Asset) -> NDArray[np.float64]:
    """Unit direction of the gust in upright axes; by default to the right in the film."""
    wind = scene.motion.wind
    if isinstance(wind, str):
        return np.array([1.0, 0.0, 0.0])
    direction = asset.frame.rotation @ np.array(wind)
    return direction / np.linalg.norm(direction)


def _loads(given: Given, prepared: Prepared) -> tuple[tuple[Load, ...], tuple[Drive, ...]]:
    """Forces of the scene, and what sets velocities, of the scene and of ``twist``."""
    scene, asset, continuum, held = given.scene, given.asset, given.continuum, prepared.held.particles
    mass_kg = prepared.assembly.mass_kg
    longest_m = float((asset.upper - asset.lower).max()) * asset.frame.metres_per_unit
    maker = LoadMaker(asset.frame, given.parts, continuum, mass_kg, longest_m)
    drives = maker.drives(scene.forces, prepared.around.boundaries, held=held)
    if prepared.around.preset == "twist":
        points_m = asset.frame.to_metres(continuum.positions)
        drives += twist(
            scene, points_m=points_m, part=continuum.part, part_names=given.parts.names, mass_kg=mass_kg, held=held
        )
    return maker.loads(scene.forces), drives
