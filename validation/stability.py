"""The limit of the time step (B18)."""

from __future__ import annotations

import re

import numpy as np

from phys4dgen.errors import SimulationError
from phys4dgen.mpm import Settings, Simulator
from validation.bodies import body
from validation.case import Check, Outcome, benchmark

__all__ = ["beyond_the_limit", "random_cube", "within_the_limit"]


def random_cube(cfl: float) -> Simulator:
    """A cube of 3.2 cells (E 1e6 Pa, nu 0.3) of 262 random particles with random velocities of 0.5 m/s."""
    x = np.random.default_rng(0).random((262, 3)) * 3.2 * 0.01
    v = np.random.default_rng(1).normal(0, 0.5, x.shape)
    b = body(x, 0.032**3 / 262, E=1e6, v=v, names=("jelly",))
    return Simulator(b, Settings(0.01, 0.02, cfl=cfl))


@benchmark(
    "B18",
    "Stable within the limit of the time step",
    source="Courant number C = c_p dt / dx; limit 0.9 to 1.0 at nu = 0.3 by a scan of a float64 prototype",
    variants={f"C = {cfl:g}": {"cfl": cfl} for cfl in (0.3, 0.4, 0.5)},
    in_tests=("C = 0.3", "C = 0.5"),
)
def within_the_limit(*, cfl: float) -> Outcome:
    """A cube of random particles with random velocities rings for 0.1 s.

    The grid takes most of the random motion, which it cannot carry, before the first frame.
    """
    simulator = random_cube(cfl)
    energy = [frame.kinetic_energy_j + frame.elastic_energy_j for frame in (simulator.advance() for _ in range(5))]
    return Outcome((Check.between("highest energy / energy of the first frame", max(energy) / energy[0], high=1.01),))


@benchmark(
    "B18b",
    "Beyond the limit the run ends with a cause",
    source="The engine's own promise",
    in_tests=("",),
)
def beyond_the_limit() -> Outcome:
    """The cube of B18 with C = 3: the error must name part, frame and cause, and the last frame must be sound."""
    simulator = random_cube(3.0)
    said = ""
    try:
        for _ in range(50):
            simulator.advance()
    except SimulationError as error:
        said = str(error)
    names_all = re.search(r"frame \d+ at .* s.*'jelly'.*cfl 3", said) is not None and "\n" not in said
    return Outcome(
        (
            Check.between("the error names part, frame and cause (1: yes)", float(names_all), low=1),
            Check.between(
                "the last frame is finite (1: yes)", float(np.isfinite(simulator.frame.positions_m).all()), low=1
            ),
        )
    )
