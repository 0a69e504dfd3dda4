"""The film as files: video, pictures of it, and one PLY per frame."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from phys4dgen.export.frames import FrameWriter, remove_frames_from
from phys4dgen.export.pictures import contact_sheet, evenly_spaced, write_png
from phys4dgen.export.video import write_video
from phys4dgen.progress import Progress
from phys4dgen.run.folder import RunFolder
from phys4dgen.stages.asset import Asset
from phys4dgen.stages.film import Film

__all__ = ["Frames", "write_film", "write_video_and_sheet"]

Frames = Literal["new", "kept", "none"]
"""What happens to frames/: written anew, left as they are, or removed."""


def write_film(film: Film, run: RunFolder, asset: Asset, *, frames: Frames, progress: Progress) -> str:
    """Render the film into a run folder; returns what encoded it, for the report.

    Args:
        film: what is rendered.
        run: the folder, claimed.
        asset: the static object.
        frames: see ``Frames``.
        progress: told what went otherwise than asked for.

    Raises:
        RunError: a file cannot be written.
    """
    writer = _frame_writer(asset, run.frames) if frames == "new" else None
    if frames != "kept":
        remove_frames_from(run.frames, 0)  # or an interrupted film would leave two motions side by side

    def images() -> Iterator[NDArray[np.uint8]]:
        for frame in film.frames():
            if writer is not None:
                quats_wxyz, scales = frame.axes()
                writer.write(
                    frame.index,
                    means=frame.means,
                    quats_wxyz=quats_wxyz,
                    scales=scales,
                    rotations=frame.rotations if frame.index else None,
                )
            yield frame.image

    path, stills = write_video_and_sheet(
        images(), film, video=run.video_mp4, sheet=run.contact_sheet_png, progress=progress
    )
    write_png(stills[min(1, len(stills) - 1)], run.preview_png)
    return f"CPU rasteriser, {'H.264' if path.suffix == '.mp4' else 'WebP'}"


def _frame_writer(asset: Asset, folder: Path) -> FrameWriter:
    if asset.surroundings is None:
        return FrameWriter(asset.gaussians, folder)
    return FrameWriter(asset.surroundings.shown(), folder, moving=asset.surroundings.object_rows)


def write_video_and_sheet(
    images: Iterable[NDArray[np.uint8]], film: Film, *, video: Path, sheet: Path, progress: Progress
) -> tuple[Path, list[NDArray[np.uint8]]]:
    """Encode pictures as they come; returns the video's path and the pictures on the sheet.

    Args:
        images: one per frame of ``film``.
        film: whose times and rate they have.
        video: ``.mp4`` file to make or replace.
        sheet: contact sheet to make or replace.
        progress: told what went otherwise than asked for.

    Raises:
        RunError: a file cannot be written.
    """
    on_sheet = evenly_spaced(len(film.times_s))
    stills: dict[int, NDArray[np.uint8]] = {}

    def noted() -> Iterator[NDArray[np.uint8]]:
        for index, image in enumerate(images):
            if index in on_sheet:
                stills[index] = image
            yield image

    path, warnings = write_video(noted(), video, fps=film.fps)
    for warning in warnings:
        progress.warn(warning)
    shown = [stills[index] for index in on_sheet]
    write_png(contact_sheet(shown, [float(film.times_s[index]) for index in on_sheet]), sheet)
    return path, shown
