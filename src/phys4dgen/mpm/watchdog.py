"""Why a simulation ends early, said so that the next one can be put right."""

from __future__ import annotations

from phys4dgen.errors import SimulationError

__all__ = ["too_fast", "too_wide", "unstable"]

_SAFE_CFL = 0.6  # stable in every run of the benchmarks


def unstable(where: str, part: str, *, is_finite: bool, cfl: float) -> SimulationError:
    """A particle of a part is not finite any more, or left its cell's neighbourhood between two sorts."""
    what = "moved by more than one cell between two sorts" if is_finite else "has no finite position or velocity"
    cause = "forces or impacts too strong for the material"
    if cfl > _SAFE_CFL:
        cause = f"cfl {cfl:g} above {_SAFE_CFL:g}, or {cause}"
    return SimulationError(
        f"The simulation became unstable in {where}: a particle of part '{part}' {what}; likely causes: {cause}."
    )


def too_wide(where: str, part: str, *, nodes: int, allowed: int) -> SimulationError:
    """The grid would get too large; ``part`` is farthest from where the body was."""
    return SimulationError(
        f"The body spreads too far in {where}: the grid would need {nodes} nodes, {allowed} are allowed, and part "
        f"'{part}' is farthest from where the body was; use a larger dx_m, weaker forces, or raise max_grid_nodes."
    )


def too_fast(where: str, *, speed_ms: float, needed: int, allowed: int) -> SimulationError:
    """A frame needs more substeps than the settings allow."""
    return SimulationError(
        f"{where} needs {needed} substeps for a speed of {speed_ms:.3g} m/s, {allowed} are allowed; use weaker forces "
        f"or raise max_substeps_per_frame."
    )
