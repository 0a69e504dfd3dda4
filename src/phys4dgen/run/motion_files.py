"""``trajectory.npz`` and ``motion.json``: the motion of a run, written as it is simulated and read back."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import RunError
from phys4dgen.export.trajectory import read_trajectory, trajectory_writer
from phys4dgen.progress import Progress
from phys4dgen.run.digests import MotionDigest
from phys4dgen.run.folder import RunFolder
from phys4dgen.run.partial_motion import PartialMotion
from phys4dgen.stages.asset import Asset
from phys4dgen.stages.motion import Motion
from phys4dgen.stages.motion_facts import MotionFacts

__all__ = ["products_of_motion", "recalled_facts", "recalled_motion", "write_motion"]


def write_motion(
    run: RunFolder, asset: Asset, motion: Motion, *, made_from: str, progress: Progress
) -> Mapping[str, str]:
    """Simulate and write frame by frame, from where an earlier command was interrupted; returns the motion's digests.

    Args:
        run: the folder.
        asset: the object that moves.
        motion: of it.
        made_from: digest of all that the motion follows from; frames made from anything else are not taken.
        progress: told where the simulation goes on.
    """
    digest = MotionDigest(motion.times_s)
    count = len(asset.gaussians)
    partial = PartialMotion(run.trajectory_partial, made_from=made_from, gaussian_count=count, progress=progress)
    around = asset.surroundings
    path, whole = run.trajectory_npz, len(asset.whole)
    with trajectory_writer(path, times_s=motion.times_s, gaussian_count=whole) as append:
        for positions, gradients in partial.frames_of(motion):
            append(*((positions, gradients) if around is None else around.moved(positions, gradients)))
            digest.add(positions, gradients)
    run.write_json(run.motion_json, motion.facts)
    partial.remove()
    return digest.products()


def products_of_motion(motion: Motion) -> Mapping[str, str]:
    """Digests of a motion, whose frames are all read."""
    digest = MotionDigest(motion.times_s)
    for positions, gradients in motion.frames():
        digest.add(positions, gradients)
    return digest.products()


def recalled_facts(run: RunFolder) -> MotionFacts:
    """What motion.json says, as far as this version knows it."""
    written = json.loads(run.motion_json.read_text("utf-8"))
    known = [entry.name for entry in fields(MotionFacts)]
    return MotionFacts(**{name: value for name, value in written.items() if name in known})


def recalled_motion(run: RunFolder, asset: Asset) -> Motion:
    """The motion of the object that lies in a run folder.

    Raises:
        RunError: it is the motion of something else.
    """
    trajectory = read_trajectory(run.trajectory_npz)
    if trajectory.positions.shape[1] != len(asset.whole):
        raise RunError(
            f"{run.trajectory_npz}: expected the motion of {len(asset.whole)} Gaussians, got that of "
            f"{trajectory.positions.shape[1]}; 'phys4dgen simulate {run.root}' makes it again."
        )
    rows = slice(None) if asset.surroundings is None else asset.surroundings.object_rows

    def frames() -> Iterator[tuple[NDArray[np.float32], NDArray[np.float32]]]:
        for positions, gradients in zip(trajectory.positions, trajectory.deformation_gradients, strict=True):
            yield positions[rows], gradients[rows]

    return Motion(trajectory.times_s, frames, recalled_facts(run))
