"""How many substeps a frame needs.

Courant-Friedrichs-Lewy condition of the stiffest soft particle (rigid ones carry no waves): dt = C dx / (c_p + |v|),
c_p = sqrt((lam + 2 mu) / rho); substeps = ceil(frame time / dt). Quadratic-spline MLS-MPM was measured to be stable
up to C of about 0.8 (nu 0.45) to 1.1 (nu 0); the default 0.4 leaves room for stiffening in compression. Laws that
stiffen much (snow, fluid) say so, and c_p follows at every sort. Explicit viscosity adds dt <= rho dx^2 / (6 eta).
Paper: Sec. C.3 uses a fixed dt.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from phys4dgen.mpm.body import Body
from phys4dgen.mpm.forces import planned_speed_gain_ms
from phys4dgen.mpm.settings import Settings

__all__ = [
    "Estimate",
    "StiffPart",
    "affordable_modulus_pa",
    "sort_interval",
    "stiff_parts",
    "substeps_for",
]

_LONGEST_RIGID_CONTACT_DT_S = 1e-3  # rocking and rolling on the ground die too soon with longer substeps
_LONGEST_SORT_INTERVAL = 50
_VISCOUS_LIMIT = 6.0  # dt <= dx^2 rho / (6 eta): explicit diffusion in three dimensions
_CELLS_BETWEEN_SORTS = 0.3


@dataclass(frozen=True)
class Estimate:
    """Predicted work of one frame at rest.

    Attributes:
        substeps_per_frame: from the CFL condition.
        particle_substeps_per_frame: times the particles that move.
        dt_s: substep, seconds.
    """

    substeps_per_frame: int
    particle_substeps_per_frame: int
    dt_s: float


@dataclass(frozen=True)
class StiffPart:
    """A part that needs more substeps than the budget allows.

    Attributes:
        part, name: which part.
        needed_substeps: per frame.
        allowed_substeps: the budget.
        youngs_modulus_pa: the part's largest Young's modulus.
        affordable_modulus_pa: the largest one that the budget allows at the same density and Poisson's ratio.
    """

    part: int
    name: str
    needed_substeps: int
    allowed_substeps: int
    youngs_modulus_pa: float
    affordable_modulus_pa: float

    def __str__(self) -> str:
        return (
            f"part '{self.name}' (E = {self.youngs_modulus_pa:.3g} Pa) needs {self.needed_substeps} substeps per "
            f"frame, {self.allowed_substeps} are allowed; hold it, raise max_substeps_per_frame, or lower E to "
            f"{self.affordable_modulus_pa:.3g} Pa"
        )


def substeps_for(
    wave_speed_ms: float,
    speed_ms: float,
    settings: Settings,
    *,
    viscosity_m2s: float = 0.0,
    rigid_contact: bool = False,
    time_s: float | None = None,
) -> int:
    """Substeps per frame for the fastest pressure wave, the fastest particle, and for rigid parts on the ground.

    Args:
        wave_speed_ms: c_p.
        speed_ms: of the fastest particle.
        settings: cell, frame time, C.
        viscosity_m2s: largest kinematic viscosity.
        rigid_contact: rigid parts meet the ground.
        time_s: what is to be divided, by default the frame.
    """
    dt_s = settings.cfl * settings.dx_m / max(wave_speed_ms + speed_ms, 1e-30)
    dt_s = min(dt_s, settings.dx_m**2 / max(_VISCOUS_LIMIT * viscosity_m2s, 1e-30))
    if rigid_contact:
        dt_s = min(dt_s, _LONGEST_RIGID_CONTACT_DT_S)
    time_s = settings.frame_time_s if time_s is None else time_s
    fewest = round(settings.fewest_substeps_per_frame * time_s / settings.frame_time_s)
    return max(2, fewest, math.ceil(min(time_s / dt_s, 2.0**52)))


def sort_interval(substeps: int, dt_s: float, speed_ms: float, dx_m: float) -> int:
    """Substeps between two sorts: particles must stay in the cells next to the one that they were sorted into."""
    by_motion = _CELLS_BETWEEN_SORTS * dx_m / max(speed_ms * dt_s, 1e-30)
    return max(1, int(min(_LONGEST_SORT_INTERVAL, substeps // 2, by_motion)))


def affordable_modulus_pa(
    density_kgm3: float, poisson_ratio: float, settings: Settings, speed_ms: float = 0.0
) -> float:
    """Largest Young's modulus that ``max_substeps_per_frame`` allows."""
    wave_speed = settings.max_substeps_per_frame * settings.cfl * settings.dx_m / settings.frame_time_s - speed_ms
    p_wave_modulus = density_kgm3 * max(wave_speed, 0.0) ** 2
    return p_wave_modulus * (1 + poisson_ratio) * (1 - 2 * poisson_ratio) / (1 - poisson_ratio)


def expected_speed_ms(body: Body, settings: Settings) -> float:
    """Speed to plan with: of the particles that move at t = 0, and what loads add during the first frame."""
    moving = ~body.held
    assert body.velocities_ms is not None
    initial = float(np.linalg.norm(body.velocities_ms[moving], axis=1).max(initial=0.0))
    return initial + planned_speed_gain_ms(body, settings)


def stiff_parts(body: Body, settings: Settings) -> list[StiffPart]:
    """The parts that need more than ``max_substeps_per_frame``, stiffest first."""
    speed = expected_speed_ms(body, settings)
    wave_speed, viscosity = body.wave_speed_ms, body.kinematic_viscosity_m2s
    found = []
    for part in np.unique(body.part[body.is_soft]):
        members = np.flatnonzero((body.part == part) & body.is_soft)
        fastest = members[np.argmax(wave_speed[members])]
        needed = substeps_for(
            float(wave_speed[fastest]), speed, settings, viscosity_m2s=float(viscosity[members].max())
        )
        if needed > settings.max_substeps_per_frame:
            affordable = affordable_modulus_pa(
                float(body.density_kgm3[fastest]), float(body.poisson_ratio[fastest]), settings, speed
            )
            modulus = float(body.youngs_modulus_pa[fastest])
            found.append(
                StiffPart(
                    int(part), body.part_names[part], needed, settings.max_substeps_per_frame, modulus, affordable
                )
            )
    return sorted(found, key=lambda stiff: -stiff.needed_substeps)
