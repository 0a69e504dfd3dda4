"""From the scene to what the solver gets: what is held, what is rigid, what pushes, what it falls on."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numba
import numpy as np
from numpy.typing import NDArray

from phys4dgen.body import Assembly, assemble_body
from phys4dgen.errors import SimulationError
from phys4dgen.motion import (
    Held,
    ProbeResult,
    damped_drop_per_s,
    damping_per_s,
    gust,
    probe_gust,
)
from phys4dgen.mpm import Body, Drive, Ground, Settings, stiff_parts
from phys4dgen.mpm.loads import Load
from phys4dgen.progress import Progress
from phys4dgen.scene import Ground as GroundOptions
from phys4dgen.scene import Scene, options_by_part
from phys4dgen.stages.apart import bonded_by_object, held_by_object, rigid_by_object, starting_velocities
from phys4dgen.stages.asset import Asset
from phys4dgen.stages.motion_changes import material_changes
from phys4dgen.stages.motion_facts import MotionFacts, RigidPart
from phys4dgen.stages.motion_loads import LoadMaker, pinned, told_parts
from phys4dgen.stages.motion_obstacles import ObstacleMaker, Solid, drawn_obstacles
from phys4dgen.stages.motion_presets import Circumstances, acts_by_itself, circumstances, twist
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


@dataclass(frozen=True, eq=False)
class _Given:
    """What every step here needs."""

    scene: Scene
    asset: Asset
    parts: Parts
    continuum: Continuum
    book: MaterialBook
    progress: Progress


@dataclass(frozen=True, eq=False)
class _Prepared:
    """The body for one preset, before its loads are known."""

    around: Circumstances
    held: Held
    rigid: tuple[RigidPart, ...]
    assembly: Assembly
    settings: Settings


def plan_motion(
    scene: Scene, asset: Asset, parts: Parts, continuum: Continuum, book: MaterialBook, progress: Progress
) -> Plan:
    """Decide what happens to the object.

    Raises:
        SceneError: a part that the scene names does not exist.
        SimulationError: nothing could move.
    """
    given = _Given(scene, asset, parts, continuum, book, progress)
    asked = scene.motion.preset
    why = ""
    if asked == "auto" and scene.objects:
        asked, why = ("rest", "") if scene.gravity in ("rest", "off") else ("drop", "drop, as with several objects")
    elif asked == "auto" and not acts_by_itself(scene):
        return _sway_or_drop(given)
    prepared = _prepare(given, "rest" if asked == "auto" else asked)
    if prepared.held.particles.all():
        raise SimulationError(
            f"Every part is held ({prepared.held.reason}); free one with 'parts: {{NAME: {{hold: free}}}}'."
        )
    swings = asked == "sway" or (prepared.around.preset == "rest" and acts_by_itself(scene) and not scene.objects)
    probe = _probe(given, prepared) if swings and prepared.held.particles.any() else None
    return _finish(given, prepared, probe, why=why)


def _sway_or_drop(given: _Given) -> Plan:
    """``sway`` if a gust can do it and breaks nothing, else ``drop``."""
    prepared = _prepare(given, "sway")
    if not prepared.assembly.body.is_soft.any():
        return _finish(given, _prepare(given, "drop"), None, why="drop, since nothing that is not held would bend")
    probe = _probe(given, prepared)
    strength = probe.acceleration_ms2
    if strength > _STRONGEST_SWAY_MS2:
        why = f"drop, since a sway would take a gust of {strength / _GRAVITY_MS2:.2g} g"
        return _finish(given, _prepare(given, "drop"), None, why=why)
    yielding = _first_to_yield(given, prepared.assembly, probe, strength)
    if yielding is not None:
        why = f"drop, since a sway would take part '{yielding}' beyond its yield stress"
        return _finish(given, _prepare(given, "drop"), None, why=why)
    return _finish(given, prepared, probe, why=f"sway, since a gust of {strength / _GRAVITY_MS2:.2g} g is enough")


def _first_to_yield(given: _Given, assembly: Assembly, probe: ProbeResult, strength_ms2: float) -> str | None:
    strain = probe.strain_per_ms2 * strength_ms2 * assembly.strain_ratio
    beyond = (strain > assembly.yield_strain) & assembly.body.is_soft
    for number, name in enumerate(given.parts.names):
        mine = assembly.body.part == number
        if assembly.mass_kg[mine & beyond].sum() > _YIELDING_SHARE * assembly.mass_kg[mine].sum():
            return name
    return None


# ------------------------------------------------------------------------------------------------ the body


def _prepare(given: _Given, preset: str) -> _Prepared:
    """Decide what is held and what is rigid; parts too stiff for the budget become rigid one after the other."""
    scene, asset, parts, continuum = given.scene, given.asset, given.parts, given.continuum
    options = {name: choice.hold for name, choice in options_by_part(scene, parts.names).items()}
    around = circumstances(scene, asset, parts, given.book, preset)
    named = {name: "free" for name in told_parts(scene.forces, parts)}
    named |= {name: hold for name, hold in options.items() if hold != "auto"}
    held = held_by_object(
        scene,
        asset,
        parts,
        continuum,
        holds=named,
        automatic=around.holds_what_stands,
        lowest_share=around.lowest_share,
    )
    held = _with_pinned(held, parts, continuum, pinned(around.boundaries, continuum, parts))
    reasons = {parts.names.index(name): "as asked for" for name, hold in options.items() if hold == "rigid"}
    while True:
        body_of, stuck = rigid_by_object(scene, asset, parts, continuum, rigid_parts=list(reasons), held=held.particles)
        clamped = _with_stuck(held, continuum, parts, stuck)
        assembly = _assembled(given, clamped, body_of)
        settings = _settings(given, around, clamped, assembly.body)
        stiff = [part for part in stiff_parts(assembly.body, settings) if part.part not in reasons]
        if not stiff:
            break
        reasons[stiff[0].part] = (
            f"E = {stiff[0].youngs_modulus_pa:.3g} Pa would need {stiff[0].needed_substeps} substeps per frame, "
            f"{stiff[0].allowed_substeps} are allowed"
        )
    rigid = []
    for number, reason in sorted(reasons.items()):
        own = body_of[continuum.part == number]
        moving = own[own >= 0]
        rigid.append(RigidPart(parts.names[number], tuple(np.unique(moving).tolist()), reason))
    if preset in ("press", "twist") and not assembly.body.is_soft.any():
        raise SimulationError(
            f"{preset}: nothing of the object would deform: {'; '.join(f'{r.part}: {r.reason}' for r in rigid)}; give "
            "it softer materials, or use --motion drop."
        )
    return _Prepared(around, clamped, tuple(rigid), assembly, settings)


def _with_pinned(held: Held, parts: Parts, continuum: Continuum, pins: NDArray[np.bool_]) -> Held:
    """What is held, and what is pinned for the whole film."""
    if not pins.any():
        return held
    particles = held.particles | pins
    whole = tuple(name for number, name in enumerate(parts.names) if particles[continuum.part == number].all())
    return Held(particles, whole, f"{held.reason}; {int(pins.sum())} particles are pinned")


def _with_stuck(held: Held, continuum: Continuum, parts: Parts, stuck: NDArray[np.bool_]) -> Held:
    """What is held, and the rigid lumps that touch it."""
    if not stuck.any():
        return held
    particles = held.particles | stuck
    touched = [parts.names[number] for number in np.unique(continuum.part[stuck])]
    whole = [name for number, name in enumerate(parts.names) if particles[continuum.part == number].all()]
    return Held(
        particles,
        tuple(name for name in parts.names if name in held.parts or (name in touched and name in whole)),
        f"{held.reason}; {', '.join(touched)}: does not deform and touches what is held",
    )


def _assembled(given: _Given, held: Held, body_of: NDArray[np.int32]) -> Assembly:
    """The body, its thin parts thickened until a frame needs no more than max_substeps."""
    scene, asset, continuum = given.scene, given.asset, given.continuum
    speed_per_substep = asset.cell_m * scene.simulation.cfl / scene.frame_time_s
    assembly = assemble_body(
        continuum,
        given.parts,
        given.book,
        frame=asset.frame,
        held=held.particles,
        rigid=body_of >= 0,
        cell_m=asset.cell_m,
        max_wave_speed_ms=0.9 * speed_per_substep * scene.simulation.max_substeps,  # the rest is for the motion itself
        rigid_wave_speed_ms=speed_per_substep * scene.simulation.substep_limit,
        fps=scene.fps,
    )
    body = replace(
        assembly.body,
        rigid_group=body_of,
        bonded_to_held=bonded_by_object(scene, asset, given.parts, continuum, held=held.particles),
        velocities_ms=starting_velocities(scene, asset, given.parts, continuum, mass_kg=assembly.mass_kg)
        * ~held.particles[:, None],
    )
    return replace(assembly, body=body)


# ------------------------------------------------------------------------------------------------ loads


def _settings(given: _Given, around: Circumstances, held: Held, body: Body) -> Settings:
    """The solver's settings without gust, forces and damping."""
    scene, asset, continuum = given.scene, given.asset, given.continuum
    plane, ground = None, around.ground
    margin_m = 0.5 * continuum.spacing_m
    if ground is not None:
        lowest_m = float(body.positions_m[~held.particles, 2].min(initial=math.inf))
        below_m = _ground_below_m(scene, asset, around.preset, ground, lowest_m=lowest_m - margin_m)
        plane = Ground(
            height_m=lowest_m - margin_m - below_m,
            contact=ground.contact,
            friction=ground.friction,
            restitution=ground.restitution,
        )
    return Settings(
        dx_m=asset.cell_m,
        frame_time_s=scene.frame_time_s,
        gravity_ms2=around.gravity_ms2,
        ground=plane,
        changes=material_changes(
            around.changes, continuum=continuum, parts=given.parts, book=given.book, frame=asset.frame
        ),
        obstacles=tuple(solid.obstacle for solid in _solids(given, around)),
        damping_relative_to_rigid=not held.particles.any(),
        cfl=scene.simulation.cfl,
        chunks=_chunks(scene),
        max_substeps_per_frame=scene.simulation.substep_limit,
        fewest_substeps_per_frame=2 if scene.paper_scale is None else scene.paper_scale.substeps,
    )


def _solids(given: _Given, around: Circumstances) -> tuple[Solid, ...]:
    asset, continuum = given.asset, given.continuum
    points_m = asset.frame.to_metres(continuum.positions)
    maker = ObstacleMaker(asset.frame, points_m, margin_m=0.5 * continuum.spacing_m, cell_m=asset.cell_m)
    return maker.solids(around.boundaries)


def _ground_below_m(scene: Scene, asset: Asset, preset: str, ground: GroundOptions, *, lowest_m: float) -> float:
    """From the lowest point that may move down to the ground."""
    if not isinstance(ground.below_m, str):
        return ground.below_m
    if scene.objects:  # their positions are heights above the ground
        return max(lowest_m, 0.0) if math.isfinite(lowest_m) else 0.0
    return scene.motion.drop_height_rel * asset.height_m if preset == "drop" else 0.0


def _probe(given: _Given, prepared: _Prepared) -> ProbeResult:
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


def _finish(given: _Given, prepared: _Prepared, probe: ProbeResult | None, *, why: str) -> Plan:
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
        facts.ground_below_m = _ground_below_m(scene, asset, preset, around.ground, lowest_m=lowest_m)
    if settings.ground is not None:
        facts.ground_height_m = settings.ground.height_m
    facts.obstacles = drawn_obstacles(_solids(given, around), asset.frame)
    if why:
        progress.note(f"Motion: {why}.")
    loads, drives = _loads(given, prepared)
    if probe is not None:
        facts.frequency_hz = probe.frequency_hz
        facts.damping_per_s = damping_per_s(scene.simulation.damping_ratio, probe.frequency_hz)
        _warn_of_sag(facts, probe, asset, progress)
    elif not scene.objects and (preset != "rest" or acts_by_itself(scene)):  # several move by and against each other
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
            "captured shape hangs already: use gravity: rest."
        )


def _chunks(scene: Scene) -> int:
    """Chunks of the solver: as many as threads, unless the scene fixes them."""
    chosen = scene.simulation.chunks
    return numba.get_num_threads() if isinstance(chosen, str) else chosen


def _wind_up(scene: Scene, asset: Asset) -> NDArray[np.float64]:
    """Unit direction of the gust in upright axes; by default to the right in the film."""
    wind = scene.motion.wind
    if isinstance(wind, str):
        return np.array([1.0, 0.0, 0.0])
    direction = asset.frame.rotation @ np.array(wind)
    return direction / np.linalg.norm(direction)


def _loads(given: _Given, prepared: _Prepared) -> tuple[tuple[Load, ...], tuple[Drive, ...]]:
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
