"""How a body is simulated: grid, frames, loads, obstacles and damping."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from phys4dgen.mpm.changes import MaterialChange
from phys4dgen.mpm.drives import Drive
from phys4dgen.mpm.loads import Load
from phys4dgen.mpm.obstacles import Obstacle

__all__ = ["Ground", "Settings"]


@dataclass(frozen=True)
class Ground:
    """A horizontal plane that carries the body.

    Attributes:
        height_m: its z.
        contact: "separate": nothing moves into it, and everything may leave it; what slides is slowed by Coulomb
            friction. "slip": no motion through it in either direction, no friction. "sticky": what touches it stays.
        friction: Coulomb's coefficient for "separate".
        restitution: share of its normal velocity with which a rigid part leaves the ground again, 0 to 1, for
            "separate"; soft parts bounce by their own elasticity.
    """

    height_m: float
    contact: Literal["separate", "slip", "sticky"] = "separate"
    friction: float = 0.5
    restitution: float = 0.2

    def __post_init__(self) -> None:
        if not math.isfinite(self.height_m):
            raise ValueError(f"height_m: expected a finite number, got {self.height_m}.")
        if self.contact not in ("separate", "slip", "sticky"):
            raise ValueError(f"contact: expected 'separate', 'slip' or 'sticky', got '{self.contact}'.")
        if not (math.isfinite(self.friction) and self.friction >= 0):
            raise ValueError(f"friction: expected zero or more, got {self.friction}.")
        if not 0 <= self.restitution <= 1:
            raise ValueError(f"restitution: expected 0 to 1, got {self.restitution}.")


@dataclass(frozen=True)
class Settings:
    """Everything about a simulation that is not the body.

    Attributes:
        dx_m: side of a grid cell, metres.
        frame_time_s: simulated time between two frames, seconds.
        gravity_ms2: uniform acceleration of everything that is not held, m/s2.
        ground: plane that carries the body, or None.
        held_friction: Coulomb's coefficient on held parts for what is not bonded to them.
        body_friction: Coulomb's coefficient between bodies (``Body.body_id``).
        loads: forces over time windows (``loads``, ``fields``).
        drives: what moves as it is told (``drives``); of two on one node the later one counts.
        obstacles: solids besides the ground.
        changes: materials that particles get in time.
        damping_per_s: mass-proportional damping alpha: velocities decay as exp(-alpha t); alpha = 4 pi zeta f1.
        damping_relative_to_rigid: damp only what differs from the body's rigid motion (momentum and angular momentum
            are kept); for bodies that are not held.
        cfl: C in dt = C dx / (c_p + |v|); stable up to about 0.8.
        chunks: particle ranges with a grid of their own; at most this many threads work on particles. Results depend
            on this number, and not on the number of threads.
        fewest_substeps_per_frame: taken even where fewer would be stable.
        max_substeps_per_frame: a body that needs more is refused.
        padding_cells: empty cells kept around the body when the grid is laid.
        max_grid_nodes: a grid that would need more is refused.
    """

    dx_m: float
    frame_time_s: float
    gravity_ms2: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ground: Ground | None = None
    held_friction: float = 0.3
    body_friction: float = 0.5
    loads: tuple[Load, ...] = ()
    drives: tuple[Drive, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()
    changes: tuple[MaterialChange, ...] = ()
    damping_per_s: float = 0.0
    damping_relative_to_rigid: bool = False
    cfl: float = 0.4
    chunks: int = 2
    fewest_substeps_per_frame: int = 2
    max_substeps_per_frame: int = 20_000
    padding_cells: int = 3
    max_grid_nodes: int = 20_000_000

    def __post_init__(self) -> None:
        for name in ("dx_m", "frame_time_s", "cfl"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name}: expected a positive number, got {value}.")
        if not (math.isfinite(self.damping_per_s) and self.damping_per_s >= 0):
            raise ValueError(f"damping_per_s: expected zero or more, got {self.damping_per_s}.")
        for name in ("held_friction", "body_friction"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) >= 0):
                raise ValueError(f"{name}: expected zero or more, got {getattr(self, name)}.")
        if len(self.gravity_ms2) != 3 or not all(math.isfinite(value) for value in self.gravity_ms2):
            raise ValueError(f"gravity_ms2: expected three finite numbers, got {self.gravity_ms2}.")
        for name, least in (
            ("chunks", 1),
            ("fewest_substeps_per_frame", 2),
            ("max_substeps_per_frame", self.fewest_substeps_per_frame),
            ("padding_cells", 0),
            ("max_grid_nodes", 512),
        ):
            if getattr(self, name) < least:
                raise ValueError(f"{name}: expected at least {least}, got {getattr(self, name)}.")
