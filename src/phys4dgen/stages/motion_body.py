"""The body that a preset moves: what is held, what is rigid, what it strikes; before its loads are known."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numba
import numpy as np
from numpy.typing import NDArray

from phys4dgen.body import Assembly, assemble_body
from phys4dgen.errors import SimulationError
from phys4dgen.joints import joining_masses
from phys4dgen.motion import (
    Held,
)
from phys4dgen.mpm import Body, Ground, LawId, Settings, stiff_parts
from phys4dgen.progress import Progress
from phys4dgen.scene import Ground as GroundOptions
from phys4dgen.scene import Scene, options_by_part
from phys4dgen.stages.apart import (
    body_numbers,
    bonded_by_body,
    held_by_body,
    rigid_by_body,
    starting_velocities,
)
from phys4dgen.stages.asset import Asset
from phys4dgen.stages.motion_changes import material_changes
from phys4dgen.stages.motion_facts import RigidPart
from phys4dgen.stages.motion_loads import pinned, told_parts
from phys4dgen.stages.motion_obstacles import ObstacleMaker, Solid
from phys4dgen.stages.motion_presets import Circumstances, circumstances
from phys4dgen.types import Continuum, MaterialBook, Parts

__all__ = ["Given", "Prepared", "ground_below_m", "prepare", "solids_of"]


@dataclass(frozen=True, eq=False)
class Given:
    """What every step here needs."""

    scene: Scene
    asset: Asset
    parts: Parts
    continuum: Continuum
    book: MaterialBook
    progress: Progress


@dataclass(frozen=True, eq=False)
class Prepared:
    """The body for one preset, before its loads are known; ``several`` where it is more bodies than one."""

    around: Circumstances
    held: Held
    rigid: tuple[RigidPart, ...]
    assembly: Assembly
    settings: Settings

    @property
    def several(self) -> bool:
        """Whether there are bodies that do not hang together."""
        body_id = self.assembly.body.body_id
        return body_id is not None and bool(body_id.any())


def prepare(given: Given, preset: str) -> Prepared:
    """Decide what is held and what is rigid; parts too stiff for the budget become rigid one after the other."""
    scene, asset, parts, continuum = given.scene, given.asset, given.parts, given.continuum
    options = {name: choice.hold for name, choice in options_by_part(scene, parts.names).items()}
    around = circumstances(scene, asset, parts, given.book, preset)
    named = {name: "free" for name in told_parts(scene.forces, parts)}
    named |= {name: hold for name, hold in options.items() if hold != "auto"}
    held = held_by_body(
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
        body_of, stuck = rigid_by_body(scene, asset, parts, continuum, rigid_parts=list(reasons), held=held.particles)
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
    return Prepared(around, clamped, tuple(rigid), assembly, settings)


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


def _assembled(given: Given, held: Held, body_of: NDArray[np.int32]) -> Assembly:
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
    numbers = body_numbers(scene, given.parts, continuum)
    masses_kg = joining_masses(
        assembly.body.positions_m,
        assembly.body.mass_kg,
        rigid_body=body_of,
        apart=numbers,
        hangs=~held.particles & (assembly.body.law != LawId.FLUID),
        cell_m=asset.cell_m,
    )
    body = replace(
        assembly.body,
        density_kgm3=masses_kg / assembly.body.volume_m3,
        rigid_group=body_of,
        body_id=numbers,
        bonded_to_held=bonded_by_body(scene, asset, given.parts, continuum, held=held.particles),
        velocities_ms=starting_velocities(scene, asset, given.parts, continuum, mass_kg=assembly.mass_kg)
        * ~held.particles[:, None],
    )
    return replace(assembly, body=body)


# ------------------------------------------------------------------------------------------------ loads


def _settings(given: Given, around: Circumstances, held: Held, body: Body) -> Settings:
    """The solver's settings without gust, forces and damping."""
    scene, asset, continuum = given.scene, given.asset, given.continuum
    plane, ground, friction = None, around.ground, scene.simulation.friction
    margin_m = 0.5 * continuum.spacing_m
    if ground is not None:
        lowest_m = float(body.positions_m[~held.particles, 2].min(initial=math.inf))
        below_m = ground_below_m(scene, asset, around.preset, ground, lowest_m=lowest_m - margin_m)
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
        obstacles=tuple(solid.obstacle for solid in solids_of(given, around)),
        damping_relative_to_rigid=not held.particles.any(),
        held_friction=Settings.held_friction if isinstance(friction, str) else friction,
        body_friction=Settings.body_friction if isinstance(friction, str) else friction,
        cfl=scene.simulation.cfl,
        chunks=_chunks(scene),
        max_substeps_per_frame=scene.simulation.substep_limit,
        fewest_substeps_per_frame=2 if scene.paper_scale is None else scene.paper_scale.substeps,
    )


def solids_of(given: Given, around: Circumstances) -> tuple[Solid, ...]:
    """The obstacles of a scene around the object."""
    asset, continuum = given.asset, given.continuum
    points_m = asset.frame.to_metres(continuum.positions)
    maker = ObstacleMaker(asset.frame, points_m, margin_m=0.5 * continuum.spacing_m, cell_m=asset.cell_m)
    return maker.solids(around.boundaries)


def ground_below_m(scene: Scene, asset: Asset, preset: str, ground: GroundOptions, *, lowest_m: float) -> float:
    """From the lowest point that may move down to the ground."""
    if not isinstance(ground.below_m, str):
        return ground.below_m
    if scene.objects:  # their positions are heights above the ground
        return max(lowest_m, 0.0) if math.isfinite(lowest_m) else 0.0
    return scene.motion.drop_height_rel * asset.height_m if preset == "drop" else 0.0


def _chunks(scene: Scene) -> int:
    """Chunks of the solver: as many as threads, unless the scene fixes them."""
    chosen = scene.simulation.chunks
    return numba.get_num_threads() if isinstance(chosen, str) else chosen
