"""The motion of all Gaussians: the body simulated with MPM, the Gaussians carried with it (Paper: Sec. 3.5)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phys4dgen.animate import Animator
from phys4dgen.body import Assembly
from phys4dgen.interior import Interior, narrow_gaps
from phys4dgen.motion import Held
from phys4dgen.mpm import Simulator, changed_body, since_start
from phys4dgen.progress import Progress
from phys4dgen.scene import Scene
from phys4dgen.stages.apart import skin_by_body
from phys4dgen.stages.asset import Asset
from phys4dgen.stages.courant import tell_courant_numbers
from phys4dgen.stages.interior import settled_thickness
from phys4dgen.stages.motion_facts import MotionFacts
from phys4dgen.stages.motion_plan import Plan, plan_motion
from phys4dgen.stages.prestress import with_prestress
from phys4dgen.stages.simulation import Simulation
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
        simulation: what makes the frames, to be stopped and gone on with; None where they are recalled.
    """

    times_s: NDArray[np.float64]
    frames: Callable[[], Iterator[tuple[NDArray[np.float32], NDArray[np.float32]]]]
    facts: MotionFacts
    simulation: Simulation | None = None


def move(
    scene: Scene, asset: Asset, parts: Parts, interior: Interior, book: MaterialBook, progress: Progress
) -> Motion:
    """Simulate the body with MPM and carry all Gaussians with it."""
    continuum = settled_thickness(scene, asset, parts, interior.continuum, book)
    plan = plan_motion(scene, asset, parts, continuum, book, progress)
    _tell_what_differs(scene, asset, parts, continuum, plan, progress)
    plan = with_prestress(scene, asset, parts, book, plan, progress)
    held, assembly, facts = plan.held, plan.assembly, plan.facts
    if scene.paper_scale is not None:
        tell_courant_numbers(asset, book, progress)
    simulator = Simulator(assembly.body, plan.settings)
    simulation = Simulation(simulator, facts)
    progress.note(
        f"{int((~held.particles).sum())} moving particles, about {simulator.estimate().substeps_per_frame} substeps "
        f"per frame, {scene.frame_count} frames."
    )
    at_last = changed_body(assembly.body, plan.settings.changes, math.inf)  # what melts on the way parts as well
    animator = _animator(scene, asset, parts, continuum, held, assembly.body.flows | at_last.flows)
    times_s = np.arange(scene.frame_count, dtype=np.float64) * scene.frame_time_s

    def frames() -> Iterator[tuple[NDArray[np.float32], NDArray[np.float32]]]:
        for k in range(simulation.frames_done, scene.frame_count):
            state = simulation.next_frame()
            if k == 0:  # the rest pose is the input, to the bit
                yield asset.gaussians.means, _identities(len(asset.gaussians))
            else:
                deformation = since_start(state.deformation_gradients, assembly.body)
                positions_m, gradients = assembly.true_motion(state.positions_m, deformation)
                yield animator.carry(asset.frame.from_metres(positions_m), asset.frame.tensor_to_input_axes(gradients))
            progress.update(k + 1, scene.frame_count, "frames simulated")

    return Motion(times_s, frames, facts, simulation)


def _tell_what_differs(
    scene: Scene, asset: Asset, parts: Parts, continuum: Continuum, plan: Plan, progress: Progress
) -> None:
    """Report where the simulated body is not the true one."""
    assembly, facts = plan.assembly, plan.facts
    facts.thickening = list(assembly.thickening)
    facts.capped = list(assembly.capped)
    for cap in assembly.capped:
        progress.warn(
            f"Part '{cap.part}': its thickest regions are simulated with E = {cap.simulated_youngs_modulus_pa:.2g} Pa "
            f"instead of {cap.true_youngs_modulus_pa:.2g} Pa to save time steps; strains there stay below "
            f"{100 * cap.largest_strain:.1g} %, which is not seen."
        )
    body = assembly.body
    assert body.body_id is not None
    gaps = narrow_gaps(continuum, frame=asset.frame, free=body.is_soft, body_id=body.body_id, cell_m=asset.cell_m)
    facts.close_share, facts.welded_share = gaps.close, gaps.welded
    if gaps.welded > _WELDED_WARNING:
        finer = f"--simulation.cell-m {asset.cell_m / 2:.2g}" if scene.objects else f"--grid {2 * asset.grid}"
        parted = f", and 'parts: {{NAME: {{separate: true}}}}' the {gaps.welded_parts:.0%} that lie at another part"
        progress.warn(
            f"{gaps.welded:.0%} of the thin surfaces lie closer than two grid cells to another one and move as if "
            f"glued to it; a finer grid ({finer}) frees them{parted if gaps.welded_parts > 0 else ''}."
        )
    facts.part_mass_g = _part_masses_g(parts, continuum, assembly)


def _animator(
    scene: Scene, asset: Asset, parts: Parts, continuum: Continuum, held: Held, loose: NDArray[np.bool_]
) -> Animator:
    held_parts = [parts.names.index(name) for name in held.parts]
    skinning = skin_by_body(scene, asset, parts, continuum, held_parts=held_parts)
    return Animator(asset.gaussians, skinning, continuum.positions, loose=loose)


def _part_masses_g(parts: Parts, continuum: Continuum, assembly: Assembly) -> dict[str, float]:
    totals = 1e3 * np.bincount(continuum.part, assembly.mass_kg, parts.count)
    return dict(zip(parts.names, totals.tolist(), strict=True))


def _identities(count: int) -> NDArray[np.float32]:
    return np.tile(np.eye(3, dtype=np.float32), (count, 1, 1))
