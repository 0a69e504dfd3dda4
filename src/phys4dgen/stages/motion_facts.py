"""What the simulation decided and found, for the report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from phys4dgen.body import CappedPart, PartThickening
from phys4dgen.mpm import Frame as SimulatedFrame

__all__ = ["MotionFacts", "Prestressing", "RigidPart"]


@dataclass(frozen=True)
class RigidPart:
    """A part that moves without deforming.

    Attributes:
        part: name.
        bodies: that its lumps belong to; lumps of one number move as one; empty where it touches what is held.
        reason: one sentence.
    """

    part: str
    bodies: tuple[int, ...]
    reason: str


@dataclass(frozen=True)
class Prestressing:
    """How the shape given carries its weight at t = 0 (``mpm.Prestress``).

    Attributes:
        largest_strain: of a principal stretch less 1.
        sag_m: by which the unstrained shape would sag, with the stiffness that it is simulated with.
        change_m: what is left to move.
        iterations: of the solver.
        converged: whether ``change_m`` is within the tolerance.
        yielding: parts that are strained beyond yield.
        stiffer_times: Young's modulus simulated over that of the materials; 1 where the shape stands with theirs.
        stiffer_parts: names of the parts that are so much stiffer.
        sag_as_given_m: by which the unstrained shape would sag with its materials' own stiffness.
    """

    largest_strain: float
    sag_m: float
    change_m: float
    iterations: int
    converged: bool
    yielding: tuple[str, ...]
    stiffer_times: float
    stiffer_parts: tuple[str, ...]
    sag_as_given_m: float


_PER_FRAME = (
    *("substeps", "dt_s", "max_speed_ms", "energy_kinetic_j", "energy_elastic_j", "momentum_kgms"),
    *("obstacle_shifts_m", "reactions_n"),
)
"""What ``MotionFacts.record`` adds to."""


@dataclass
class MotionFacts:
    """Filled while the motion is prepared and simulated.

    Attributes:
        preset: sway, drop, press, twist or rest.
        held: parts or region held, with the reason.
        why: how the preset came about, where it was left open.
        gravity: rest, on or off.
        prestress: of a shape that carries its weight from the start, None without.
        ground_below_m: from the lowest point at rest down to the ground, None without ground.
        ground_height_m: of the ground along up, metres in the input's origin, None without ground.
        obstacles: what the film draws of obstacles (``motion_obstacles.drawn_obstacles``).
        obstacle_shifts_m: how far each obstacle has moved, per frame, z up.
        reactions_n: mean force of the body on each obstacle, then on the ground, per frame, z up.
        rigid: parts that do not deform.
        touching_particles: free particles that are near held ones without having grown together with them.
        wind_up: direction of the gust, axes with z up.
        gust_ms2, gust_s: its strength and length.
        frequency_hz: of the swing that the probe saw.
        damping_per_s: mass-proportional damping.
        cell_m, cfl, substeps, dt_s: of the solver; substeps and dt per frame.
        close_share: share of thin surfaces that lie closer than two grid cells to another one.
        welded_share: the same, where both are in one velocity field: the grid cannot tell them from their neighbours.
        thickening: parts that were simulated thicker than they are.
        capped: parts whose thick regions were simulated softer than they are.
        part_mass_g: true mass of each part.
        energy_kinetic_j, energy_elastic_j, momentum_kgms, max_speed_ms: per frame.
    """

    preset: str
    held: str
    why: str = ""
    gravity: str = "rest"
    prestress: Prestressing | None = None
    ground_below_m: float | None = None
    ground_height_m: float | None = None
    obstacles: list[dict[str, Any]] = field(default_factory=list)
    obstacle_shifts_m: list[list[list[float]]] = field(default_factory=list)
    reactions_n: list[list[list[float]]] = field(default_factory=list)
    rigid: list[RigidPart] = field(default_factory=list)
    touching_particles: int = 0
    wind_up: list[float] | None = None
    gust_ms2: float = 0.0
    gust_s: float = 0.0
    frequency_hz: float | None = None
    damping_per_s: float = 0.0
    cell_m: float = 0.0
    cfl: float = 0.0
    close_share: float = 0.0
    welded_share: float = 0.0
    thickening: list[PartThickening] = field(default_factory=list)
    capped: list[CappedPart] = field(default_factory=list)
    part_mass_g: dict[str, float] = field(default_factory=dict)
    substeps: list[int] = field(default_factory=list)
    dt_s: list[float] = field(default_factory=list)
    max_speed_ms: list[float] = field(default_factory=list)
    energy_kinetic_j: list[float] = field(default_factory=list)
    energy_elastic_j: list[float] = field(default_factory=list)
    momentum_kgms: list[list[float]] = field(default_factory=list)

    def record(self, frame: SimulatedFrame) -> None:
        """Note what one more frame took."""
        self.substeps.append(frame.substeps)
        self.dt_s.append(frame.dt_s)
        self.max_speed_ms.append(frame.max_speed_ms)
        self.energy_kinetic_j.append(frame.kinetic_energy_j)
        self.energy_elastic_j.append(frame.elastic_energy_j)
        self.momentum_kgms.append(frame.momentum_kgms.tolist())
        self.obstacle_shifts_m.append(frame.obstacle_shifts_m.tolist())
        self.reactions_n.append(frame.reactions_n.tolist())

    def history(self) -> dict[str, list[Any]]:
        """What ``record`` noted, by name."""
        return {name: getattr(self, name) for name in _PER_FRAME}

    def take_history(self, history: Mapping[str, list[Any]]) -> None:
        """Stand where another process stood when it gave ``history``."""
        for name in _PER_FRAME:
            setattr(self, name, list(history[name]))
