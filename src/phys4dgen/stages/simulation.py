"""A simulation that keeps count of its frames, and that can be stopped and gone on with in another process."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm import Frame, Simulator
from phys4dgen.stages.motion_facts import MotionFacts

__all__ = ["Simulation"]


class Simulation:
    """A simulator and what is recorded of it.

    Attributes:
        frames_done: how many ``next_frame`` has given, those before ``resume`` included.
    """

    def __init__(self, simulator: Simulator, facts: MotionFacts) -> None:
        self._simulator = simulator
        self._facts = facts
        self.frames_done = 0

    def next_frame(self) -> Frame:
        """The rest pose, then one simulated frame after the other; each is recorded in the facts."""
        state = self._simulator.frame if self.frames_done == 0 else self._simulator.advance()
        self._facts.record(state)
        self.frames_done += 1
        return state

    def checkpoint(self) -> dict[str, NDArray[Any]]:
        """Arrays from which ``resume`` goes on after the last frame."""
        history = np.array(json.dumps(self._facts.history()))
        return {"frames_done": np.array(self.frames_done), "history": history, **self._simulator.checkpoint()}

    def resume(self, saved: Mapping[str, NDArray[Any]]) -> None:
        """Go on from a checkpoint of the same simulation.

        Raises:
            SimulationError: it is one of another.
        """
        self._simulator.restore({name: saved[name] for name in saved if name not in ("frames_done", "history")})
        self._facts.take_history(json.loads(str(saved["history"])))
        self.frames_done = int(saved["frames_done"])
