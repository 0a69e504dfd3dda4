"""``video.mp4``: H.264 through the ffmpeg that imageio-ffmpeg brings, as a separate process; else an animated WebP."""

from __future__ import annotations

import itertools
import subprocess
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from phys4dgen.errors import RunError
from phys4dgen.formats import atomic_path

__all__ = ["write_video"]


def write_video(
    frames: Iterable[NDArray[np.uint8]], path: Path | str, *, fps: float, crf: int = 17
) -> tuple[Path, tuple[str, ...]]:
    """Encode frames as they come, so that only one is in memory.

    Args:
        frames: at least one picture, each of shape [H, W, 3], uint8, sRGB; an odd side is extended by one pixel.
        path: ``.mp4`` file to make or replace, atomically.
        fps: frames per second.
        crf: H.264 constant rate factor; 17 is visually lossless, smaller is better and larger.

    Returns:
        The file written (``.webp`` where there is no ffmpeg) and warnings for the report.

    Raises:
        RunError: ffmpeg failed, or the file cannot be written.
    """
    if not 0 < fps <= 1000:
        raise ValueError(f"fps: expected a number in (0, 1000], got {fps}.")
    path = Path(path)
    stream = iter(frames)
    first = next(stream, None)
    if first is None:
        raise ValueError("frames: expected at least one picture, got none.")
    pictures = checked_frames(first, stream)
    ffmpeg = ffmpeg_executable()
    try:
        if ffmpeg is None:
            target = path.with_suffix(".webp")
            write_webp(pictures, target, fps=fps)
            return target, ("There is no ffmpeg, so the video is an animated WebP: pip install imageio-ffmpeg.",)
        height, width = (side + side % 2 for side in first.shape[:2])
        with atomic_path(path) as temporary:
            run_ffmpeg(ffmpeg_command(ffmpeg, width, height, fps=fps, crf=crf, target=temporary), pictures, path)
    except OSError as error:
        raise RunError(f"{path}: the video cannot be written ({error}); check disk space and rights.") from error
    return path, ()


def ffmpeg_executable() -> str | None:
    """Path of an ffmpeg program, or None."""
    try:
        import imageio_ffmpeg

        return imageio_ffmpeg.get_ffmpeg_exe()
    except (ImportError, RuntimeError):  # RuntimeError: the package is there, its program is not
        return None


def checked_frames(first: NDArray[np.uint8], others: Iterator[NDArray[np.uint8]]) -> Iterator[NDArray[np.uint8]]:
    """All frames, checked to be alike, with even sides as 4:2:0 chroma needs."""
    for index, frame in enumerate(itertools.chain([first], others)):
        if frame.dtype != np.uint8 or frame.ndim != 3 or frame.shape[2] != 3 or frame.shape != first.shape:
            raise ValueError(
                f"frames: expected uint8 of shape {first.shape}, got {frame.dtype} {frame.shape} at {index}."
            )
        height, width = frame.shape[:2]
        yield np.pad(frame, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")


def ffmpeg_command(ffmpeg: str, width: int, height: int, *, fps: float, crf: int, target: Path) -> list[str]:
    """Raw RGB on standard input -> H.264, 4:2:0, BT.709 (converted and tagged), index in front for the web."""
    rate = Fraction(fps).limit_denominator(1001)
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", str(rate), "-i", "pipe:0"]
    colour = ["-vf", "scale=out_color_matrix=bt709:out_range=tv:flags=accurate_rnd+full_chroma_int,format=yuv420p"]
    tags = ["-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709", "-color_range", "tv"]
    codec = ["-c:v", "libx264", "-preset", "medium", "-crf", str(crf), "-movflags", "+faststart"]
    return [ffmpeg, "-y", "-loglevel", "error", *source, "-an", *colour, *codec, *tags, str(target.absolute())]


def run_ffmpeg(command: list[str], pictures: Iterable[NDArray[np.uint8]], path: Path) -> None:
    """Feed the pictures to ffmpeg and wait for it; its complaints become the error."""
    with tempfile.TemporaryFile() as complaints:
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=complaints)
        assert process.stdin is not None
        try:
            with suppress(BrokenPipeError):  # ffmpeg gave up; its exit code and text say why
                for picture in pictures:
                    process.stdin.write(picture.data)
        except BaseException:
            process.kill()
            raise
        finally:
            with suppress(BrokenPipeError):
                process.stdin.close()
            code = process.wait()
        if code:
            complaints.seek(0)
            text = complaints.read(2000).decode("utf-8", "replace").strip().replace("\n", "; ")
            raise RunError(
                f"{path}: ffmpeg ended with code {code} ({text or 'no message'}); check disk space and rights."
            )


def write_webp(pictures: Iterable[NDArray[np.uint8]], path: Path, *, fps: float) -> None:
    """Animated WebP of all pictures, looped."""
    images = [Image.fromarray(picture) for picture in pictures]
    options: dict[str, Any] = {"duration": round(1000 / fps), "loop": 0, "quality": 85, "method": 2}
    with atomic_path(path) as temporary:
        images[0].save(temporary, save_all=True, append_images=images[1:], **options)
