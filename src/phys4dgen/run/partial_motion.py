"""``trajectory.partial/``: the frames of a simulation that is still running, and from where it goes on.

Each frame is one file, and after it ``checkpoint.npz`` is replaced; both appear whole or not at all. So a run that is
killed, interrupted or out of disk loses the frame that it was at, and the same command goes on to the same arrays.
"""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import SimulationError
from phys4dgen.formats.npz import save_npz
from phys4dgen.progress import Progress
from phys4dgen.stages.motion import Motion

__all__ = ["PartialMotion"]

_UNREADABLE = (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, SimulationError)
_Frame = tuple[NDArray[np.float32], NDArray[np.float32]]


class PartialMotion:
    """The frames that are there already, and those that follow, which are kept as they come."""

    def __init__(self, folder: Path, *, made_from: str, gaussian_count: int, progress: Progress) -> None:
        """Nothing is touched yet.

        Args:
            folder: where the frames lie, or will.
            made_from: digest of all that the motion follows from; frames made from anything else are not taken.
            gaussian_count: N.
            progress: told where the simulation goes on.
        """
        self._folder = folder
        self._checkpoint = folder / "checkpoint.npz"
        self._made_from = made_from
        self._count = gaussian_count
        self._progress = progress

    def frames_of(self, motion: Motion) -> Iterator[_Frame]:
        """All frames of a motion, those before an interruption read back."""
        for k in range(self._resume(motion)):
            yield self._read(k)
        simulation = motion.simulation
        for positions, gradients in motion.frames():
            if simulation is not None:
                k = simulation.frames_done - 1
                save_npz(self._frame(k), {"positions": positions, "deformation_gradients": gradients})
                save_npz(self._checkpoint, {"made_from": np.array(self._made_from), **simulation.checkpoint()})
            yield positions, gradients

    def remove(self) -> None:
        """The motion is kept elsewhere, whole."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def _resume(self, motion: Motion) -> int:
        """Frames that need not be simulated again."""
        if motion.simulation is None or not self._checkpoint.is_file():
            return 0
        try:
            with np.load(self._checkpoint, allow_pickle=False) as arrays:
                saved = dict(arrays)
            if str(saved.pop("made_from")) != self._made_from:
                self.remove()
                return 0
            for k in range(int(saved["frames_done"])):
                self._read(k)
            motion.simulation.resume(saved)
        except _UNREADABLE as error:
            self._progress.warn(f"{self._folder.name} cannot be continued and is simulated anew: {error}")
            self.remove()
            return 0
        self._progress.note(
            f"simulate: goes on after frame {motion.simulation.frames_done - 1} of {len(motion.times_s) - 1}."
        )
        return motion.simulation.frames_done

    def _frame(self, k: int) -> Path:
        return self._folder / f"frame_{k:04d}.npz"

    def _read(self, k: int) -> _Frame:
        with np.load(self._frame(k), allow_pickle=False) as arrays:
            positions, gradients = arrays["positions"], arrays["deformation_gradients"]
        expected = (self._count, 3), (self._count, 3, 3)
        if (positions.shape, gradients.shape) != expected or {positions.dtype, gradients.dtype} != {np.dtype("f4")}:
            raise ValueError(f"{self._frame(k).name} has other sizes")
        return positions, gradients
