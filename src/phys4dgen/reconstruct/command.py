"""Any other program as the generator: it gets a picture and leaves a splat.

The program is named as a list of words and started without a shell, in an empty folder of its own and a process group
of its own, with a time limit. What it leaves is treated like any file from outside.
"""

from __future__ import annotations

import os
import signal
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from phys4dgen.errors import FormatError, StageError
from phys4dgen.formats import load_gaussians
from phys4dgen.reconstruct.foreground import Cutout
from phys4dgen.reconstruct.reconstruction import Reconstruction

__all__ = ["reconstruct_by_command"]

_LAST_WORDS = 300
"""Characters of what a failed program said that the error repeats."""
_GRACE_S = 5.0


def reconstruct_by_command(cutout: Cutout, argv: Sequence[str], *, timeout_s: float) -> Reconstruction:
    """Run a program that makes a splat of a picture.

    Args:
        cutout: the object, handed over as an RGBA PNG.
        argv: the program and its arguments; ``{image}`` stands for the picture, ``{out}`` for the ``.ply`` to write.
        timeout_s: it is ended after this time.

    Raises:
        StageError: it cannot start, fails, takes too long, or leaves no splat inside its folder.
    """
    name = argv[0]
    with tempfile.TemporaryDirectory(prefix="phys4dgen-", ignore_cleanup_errors=True) as folder_name:
        folder = Path(folder_name).resolve()
        image, out, log = folder / "image.png", folder / "out.ply", folder / "log.txt"
        Image.fromarray(np.rint(cutout.rgba * 255).astype(np.uint8)).save(image)
        words = [word.replace("{image}", str(image)).replace("{out}", str(out)) for word in argv]
        _run(words, folder, log, timeout_s)
        if not out.is_file():
            raise StageError(f"The command '{name}' ended without writing {{out}}; it must leave a .ply splat there.")
        if out.is_symlink() or out.resolve().parent != folder:
            raise StageError(f"The command '{name}' left a link to a file outside its folder; expected a .ply splat.")
        try:
            gaussians = load_gaussians(out)
        except FormatError as error:
            reason = str(error).removeprefix(f"{out}: ")
            raise StageError(f"The command '{name}' did not leave a splat in {{out}}: {reason}") from error
    return Reconstruction(gaussians, None, None, f"command {Path(name).name}", warnings=cutout.warnings)


def _run(words: Sequence[str], folder: Path, log: Path, timeout_s: float) -> None:
    """Run to the end or to the time limit; ends the whole process group then."""
    name = words[0]
    with log.open("wb") as said:
        try:
            process = subprocess.Popen(
                words, cwd=folder, stdin=subprocess.DEVNULL, stdout=said, stderr=said, start_new_session=True
            )
        except OSError as error:
            raise StageError(
                f"The command '{name}' cannot be started ({error.strerror or error}); give its full path."
            ) from error
        try:
            code = process.wait(timeout_s)
        except subprocess.TimeoutExpired as error:
            raise StageError(
                f"The command '{name}' was ended after {timeout_s:g} s; allow more with reconstruct.timeout_s."
            ) from error
        finally:
            _end_group(process)
    if code != 0:
        raise StageError(f"The command '{name}' failed with exit code {code}; it said: {_last_words(log)}")


def _end_group(process: subprocess.Popen[bytes]) -> None:
    """End what the program has left running."""
    for sign in (signal.SIGTERM, signal.SIGKILL):
        try:
            os.killpg(process.pid, sign)
        except (ProcessLookupError, PermissionError):
            break
        try:
            process.wait(_GRACE_S)
        except subprocess.TimeoutExpired:
            continue


def _last_words(log: Path) -> str:
    with log.open("rb") as stream:
        stream.seek(max(0, log.stat().st_size - 4 * _LAST_WORDS))
        text = " ".join(stream.read().decode("utf-8", "replace").split())
    return text[-_LAST_WORDS:] or "nothing"
