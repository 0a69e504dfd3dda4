"""The motion of all Gaussians: the body simulated with MPM, the Gaussians carried with it (Paper: Sec. 3.5)."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numba
import numpy as np
from numpy.typing import NDArray

from phys4dgen.animate import Animator, skin
from phys4dgen.body import Assembly, assemble_body
from phys4dgen.errors import SimulationError
from phys4dgen.interior import Interior, welded_share
from phys4dgen.motion import Held, choose_held, damping_per_s, gust, probe_gust
from phys4dgen.mpm import Acceleration, Settings, Simulator, stiff_parts
from phys4dgen.progress import Progress
from phys4dgen.scene import ALL_PARTS, Scene
from phys4dgen.stages.asset import Asset
from phys4dgen.stages.interior import settled_thickness
from phys4dgen.stages.motion_facts import MotionFacts
from phys4dgen.types import Continuum, MaterialBook, Parts

__all__ = ["Motion", "move"]

_WELDED_WARNING = 0.25


@dataclass(frozen=True, eq=False)
class Motion:
    """The motion of all Gaussians, frame by frame.

    Attributes:
        times_s: of the frames, [T].
        frames: yields (positions [N, 3], total deformation gradients [N, 3, 3]) per frame, input axes; may be asked
            again only where the store recalls it.
        facts: complete when all frames were taken.
    """

    times_s: NDArray[np.float64]
    frames: Callable[[], Iterator[tuple[NDArray[np.float32], NDArray[np.float32]]]]
    facts: MotionFacts


def move(
    scene: Scene, asset: Asset, parts: Parts, interior: Interior, book: MaterialBook, progress: Progress
) -> Motion:
    """Simulate the body with MPM and carry all Gaussians with it."""
    continuum = settled_thickness(scene, asset, parts, interior.continuum, book)
    preset = _preset(scene)
    held = _held(scene, asset, parts, continuum, automatic=preset == "sway" or bool(scene.forces))
    facts = MotionFacts(preset, held.reason, cell_m=asset.cell_m, cfl=scene.simulation.cfl)
    assembly = _assembled(scene, asset, parts, continuum, book, held)
    _tell_what_differs(scene, asset, parts, continuum, assembly, held, facts, progress)
    settings = _loaded(scene, asset, parts, assembly, _settings(scene, asset, held), facts, progress)
    simulator = Simulator(assembly.body, settings)
    progress.note(
        f"{int((~held.particles).sum())} moving particles, about {simulator.estimate().substeps_per_frame} substeps "
        f"per frame, {scene.frame_count} frames."
    )
    animator = _animator(asset, parts, continuum, held)
    times_s = np.arange(scene.frame_count, dtype=np.float64) * scene.frame_time_s

    def frames() -> Iterator[tuple[NDArray[np.float32], NDArray[np.float32]]]:
        for k in range(scene.frame_count):
            state = simulator.frame if k == 0 else simulator.advance()
            facts.record(state)
            if k == 0:  # the rest pose is the input, to the bit
                yield asset.gaussians.means, _identities(len(asset.gaussians))
            else:
                positions_m = assembly.true_positions_m(state.positions_m, state.deformation_gradients)
                gradients = asset.frame.tensor_to_input_axes(state.deformation_gradients)
                yield animator.carry(asset.frame.from_metres(positions_m), gradients)
            progress.update(k + 1, scene.frame_count, "frames simulated")

    return Motion(times_s, frames, facts)


def _preset(scene: Scene) -> str:
    if scene.motion.preset == "auto":
        return "rest" if scene.forces else "sway"
    return scene.motion.preset


def _held(scene: Scene, asset: Asset, parts: Parts, continuum: Continuum, *, automatic: bool) -> Held:
    holds = {name: options.hold for name, options in scene.parts.items() if options.hold != "auto"}
    held = choose_held(continuum, parts, frame=asset.frame, holds=holds, automatic=automatic)
    if held.particles.all():
        raise SimulationError(f"Every part is held ({held.reason}); free one with 'parts: {{NAME: {{hold: free}}}}'.")
    return held


def _assembled(
    scene: Scene, asset: Asset, parts: Parts, continuum: Continuum, book: MaterialBook, held: Held
) -> Assembly:
    """The body, its thin parts thickened until a frame needs no more than max_substeps."""
    slowest = asset.cell_m * scene.simulation.cfl * scene.simulation.max_substeps / scene.frame_time_s
    # A tenth of the speed is left to the motion itself.
    return assemble_body(
        continuum,
        parts,
        book,
        frame=asset.frame,
        held=held.particles,
        cell_m=asset.cell_m,
        max_wave_speed_ms=0.9 * slowest,
    )


def _tell_what_differs(
    scene: Scene,
    asset: Asset,
    parts: Parts,
    continuum: Continuum,
    assembly: Assembly,
    held: Held,
    facts: MotionFacts,
    progress: Progress,
) -> None:
    """Report where the simulated body is not the true one."""
    facts.thickening = list(assembly.thickening)
    facts.capped = list(assembly.capped)
    for cap in assembly.capped:
        progress.warn(
            f"Part '{cap.part}': its thickest regions are simulated with E = {cap.simulated_youngs_modulus_pa:.2g} Pa "
            f"instead of {cap.true_youngs_modulus_pa:.2g} Pa to save time steps; strains there stay below "
            f"{100 * cap.largest_strain:.1g} %, which is not seen."
        )
    facts.welded_share = welded_share(continuum, frame=asset.frame, free=~held.particles, cell_m=asset.cell_m)
    if facts.welded_share > _WELDED_WARNING:
        progress.warn(
            f"{facts.welded_share:.0%} of the thin surfaces lie closer than two grid cells to another one and move as "
            f"if glued to it; a finer grid (--grid {2 * scene.simulation.grid}) frees them."
        )
    facts.part_mass_g = _part_masses_g(parts, continuum, assembly)
    for warning in assembly.law_warnings:
        progress.warn(f"Law: {warning}.")


def _settings(scene: Scene, asset: Asset, held: Held) -> Settings:
    """The solver's settings without loads and damping."""
    return Settings(
        dx_m=asset.cell_m,
        frame_time_s=scene.frame_time_s,
        damping_relative_to_rigid=not held.particles.any(),
        cfl=scene.simulation.cfl,
        chunks=_chunks(scene),
        max_substeps_per_frame=scene.simulation.substep_limit,
    )


def _loaded(
    scene: Scene,
    asset: Asset,
    parts: Parts,
    assembly: Assembly,
    settings: Settings,
    facts: MotionFacts,
    progress: Progress,
) -> Settings:
    """The settings with the forces asked for, the preset's own, and the damping of the swing that they excite."""
    stiff = stiff_parts(assembly.body, settings)
    if stiff:
        raise SimulationError(f"Too stiff for the budget: {stiff[0]} (--hold {stiff[0].name}).")
    forces = _forces(scene, asset, parts)
    if facts.preset != "sway" and not forces:
        return settings
    started = time.perf_counter()
    wind = _wind_up(scene, asset)
    probe = probe_gust(
        assembly.body,
        settings,
        direction_up=wind,
        duration_s=scene.motion.duration_s,
        aim_m=scene.motion.amplitude_rel * asset.height_m,
        damping_ratio=scene.simulation.damping_ratio,
        on_frame=lambda k, n: progress.update(k, n, "frames of the probe"),
    )
    facts.frequency_hz = probe.frequency_hz
    facts.damping_per_s = damping_per_s(scene.simulation.damping_ratio, probe.frequency_hz)
    if facts.preset == "sway":
        asked = scene.motion.acceleration_ms2
        strength = probe.acceleration_ms2 if isinstance(asked, str) else asked
        facts.wind_up, facts.gust_ms2, facts.gust_s = wind.tolist(), strength, scene.motion.duration_s
        forces = (*forces, gust(wind, strength, scene.motion.duration_s))
        progress.note(
            f"Gust of {strength:.3g} m/s2 for {scene.motion.duration_s:g} s; swings at {probe.frequency_hz:.2g} Hz; "
            f"held: {facts.held} (the probe took {time.perf_counter() - started:.0f} s)."
        )
    return replace(settings, accelerations=forces, damping_per_s=facts.damping_per_s)


def _animator(asset: Asset, parts: Parts, continuum: Continuum, held: Held) -> Animator:
    held_parts = [parts.names.index(name) for name in held.parts]
    skinning = skin(asset.gaussians, parts.labels, continuum, frame=asset.frame, held_parts=held_parts)
    return Animator(asset.gaussians, skinning, continuum.positions)


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


def _forces(scene: Scene, asset: Asset, parts: Parts) -> tuple[Acceleration, ...]:
    found = []
    for force in scene.forces:
        x, y, z = (float(v) for v in asset.frame.rotation @ np.array(force.value_ms2))
        part = None if force.part == ALL_PARTS else parts.names.index(force.part)
        found.append(Acceleration((x, y, z), force.from_s, force.to_s, part=part))
    return tuple(found)


def _part_masses_g(parts: Parts, continuum: Continuum, assembly: Assembly) -> dict[str, float]:
    totals = 1e3 * np.bincount(continuum.part, assembly.mass_kg, parts.count)
    return dict(zip(parts.names, totals.tolist(), strict=True))


def _identities(count: int) -> NDArray[np.float32]:
    return np.tile(np.eye(3, dtype=np.float32), (count, 1, 1))
