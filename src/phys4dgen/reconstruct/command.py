"""Any other program as the generator: it gets a picture and leaves a splat or a mesh.

The program is named as a list of words and started without a shell, in an empty folder of its own and a process group
of its own, with a time limit. What it leaves is treated like any file from outside.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from phys4dgen.errors import FormatError, StageError
from phys4dgen.formats import load_gaussians
from phys4dgen.programs import run_program
from phys4dgen.reconstruct.foreground import Cutout
from phys4dgen.reconstruct.mesh.files import MESH_SUFFIXES, is_mesh
from phys4dgen.reconstruct.mesh.gaussians import gaussians_from_mesh
from phys4dgen.reconstruct.reconstruction import Reconstruction

__all__ = ["reconstruct_by_command"]


OUTPUTS = {"{out}": "out.ply", **{f"{{out{suffix}}}": f"out{suffix}" for suffix in (".splat", *MESH_SUFFIXES)}}
"""Words for the file to write, and its name: a .ply is a splat or a mesh."""


def reconstruct_by_command(
    cutout: Cutout, argv: Sequence[str], *, timeout_s: float, mesh_gaussians: int = 100_000
) -> Reconstruction:
    """Run a program that makes a splat or a mesh of a picture.

    Args:
        cutout: the object, handed over as an RGBA PNG.
        argv: the program and its arguments; ``{image}`` stands for the picture, ``{out}`` for the ``.ply`` to write
            (``{out.glb}`` and so on where it writes another format).
        timeout_s: it is ended after this time.
        mesh_gaussians: of a mesh: about so many lie in its surface.

    Raises:
        StageError: it cannot start, fails, takes too long, or leaves neither splat nor mesh inside its folder.
    """
    name = argv[0]
    with tempfile.TemporaryDirectory(prefix="phys4dgen-", ignore_cleanup_errors=True) as folder_name:
        folder = Path(folder_name).resolve()
        image = folder / "image.png"
        mark = next((mark for mark in OUTPUTS if any(mark in word for word in argv)), "{out}")
        out = folder / OUTPUTS[mark]
        Image.fromarray(np.rint(cutout.rgba * 255).astype(np.uint8)).save(image)
        words = [word.replace("{image}", str(image)).replace(mark, str(out)) for word in argv]
        run_program(words, folder, timeout_s=timeout_s, timeout_key="reconstruct.timeout_s")
        if not out.is_file():
            raise StageError(f"The command '{name}' ended without writing {mark}; it must leave a splat or mesh there.")
        if out.is_symlink() or out.resolve().parent != folder:
            raise StageError(
                f"The command '{name}' left a link to a file outside its folder; expected a splat or mesh."
            )
        try:
            gaussians = gaussians_from_mesh(out, count=mesh_gaussians) if is_mesh(out) else load_gaussians(out)
        except FormatError as error:
            reason = str(error).removeprefix(f"{out}: ")
            raise StageError(f"The command '{name}' did not leave a splat or mesh in {mark}: {reason}") from error
    return Reconstruction(gaussians, None, None, f"command {Path(name).name}", warnings=cutout.warnings)
