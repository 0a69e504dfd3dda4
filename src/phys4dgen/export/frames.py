"""The 4D content: one complete 3DGS PLY per frame, named so that sequence players find them (frame_0000.ply ...)."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import RunError
from phys4dgen.formats import PlyFrameWriter
from phys4dgen.render.sh_rotation import rotate_sh
from phys4dgen.types import Gaussians

__all__ = ["FrameWriter", "frame_path", "remove_frames_from"]


def frame_path(folder: Path | str, index: int) -> Path:
    """Path of frame ``index`` in ``folder``."""
    return Path(folder) / f"frame_{index:04d}.ply"


def remove_frames_from(folder: Path | str, first: int) -> int:
    """Delete the frames numbered ``first`` and above, left over from a longer run; returns how many there were."""
    stale = [
        path
        for path in Path(folder).glob("frame_*.ply")
        if (match := re.fullmatch(r"frame_(\d{4,})\.ply", path.name)) and int(match[1]) >= first
    ]
    for path in stale:
        path.unlink()
    return len(stale)


class FrameWriter:
    """Writes the frames of one object: number, order, opacities and axes are those of the static Gaussians."""

    def __init__(self, gaussians: Gaussians, folder: Path | str, *, moving: NDArray[np.int64] | None = None) -> None:
        """Prepare.

        Args:
            gaussians: all of them, at rest, N.
            folder: of the files.
            moving: rows of those that ``write`` is told of, [M]; the others are the same bytes in every file. None:
                all.
        """
        self._gaussians = gaussians
        self._moving = slice(None) if moving is None else moving
        self._sh = np.array(gaussians.sh)
        self._means, self._quats_wxyz = np.array(gaussians.means), np.array(gaussians.quats_wxyz)
        self._scales = np.array(gaussians.scales)
        self._folder = Path(folder)
        self._ply = PlyFrameWriter(gaussians)

    def write(
        self,
        index: int,
        *,
        means: NDArray[Any],
        quats_wxyz: NDArray[Any],
        scales: NDArray[Any],
        rotations: NDArray[Any] | None = None,
    ) -> Path:
        """Write frame ``index`` atomically.

        Args:
            index: frame number from 0 (the rest pose).
            means: centres of those that move, shape [M, 3], input coordinates.
            quats_wxyz: unit quaternions, shape [M, 4].
            scales: positive linear standard deviations, shape [M, 3], input units.
            rotations: how far each Gaussian has turned since the rest pose (the polar rotation of F), shape [M, 3, 3],
                input axes; needed above SH degree 0, where the colours turn along. None at the rest pose.

        Returns:
            The path of the file.

        Raises:
            RunError: the file cannot be written.
        """
        sh_rest = None
        if self._gaussians.sh_degree:
            sh = self._gaussians.sh[self._moving]
            self._sh[self._moving] = sh if rotations is None else rotate_sh(sh, np.asarray(rotations))
            sh_rest = self._sh[:, 1:]
        self._means[self._moving] = means
        self._quats_wxyz[self._moving] = quats_wxyz
        self._scales[self._moving] = scales
        path = frame_path(self._folder, index)
        try:
            self._ply.write(path, means=self._means, quats_wxyz=self._quats_wxyz, scales=self._scales, sh_rest=sh_rest)
        except OSError as error:
            raise RunError(f"{path}: the frame cannot be written ({error}); check disk space and rights.") from error
        return path
