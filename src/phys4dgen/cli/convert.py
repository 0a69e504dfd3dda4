"""``convert IN OUT``: a splat file into another format."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from phys4dgen.cli.arguments import Arguments
from phys4dgen.errors import FormatError

__all__ = ["SCENE_KEYS", "add_flags", "run"]

SCENE_KEYS = False


def add_flags(parser: argparse.ArgumentParser) -> None:
    """From where to where."""
    parser.add_argument("source", metavar="IN", type=Path, help="a .ply (also PlayCanvas compressed) or .splat file")
    parser.add_argument(
        "target",
        metavar="OUT",
        type=Path,
        help="a .ply, .compressed.ply or .splat file; the end of the name says which",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace OUT")


def run(arguments: Arguments) -> int:
    """Convert, and say what was lost."""
    options = arguments.options
    source, target = options.source, options.target
    if target.exists() and not options.overwrite:
        raise FormatError(f"{target}: the file exists already; add --overwrite to replace it, or choose another name.")
    from phys4dgen.formats import check_writable_suffix, is_compressed_name, read_splat_file, save_gaussians

    check_writable_suffix(target)  # before minutes are spent on reading
    splat = read_splat_file(source)
    save_gaussians(splat.gaussians, target)
    if not options.quiet:
        lost = [f"extra column '{name}' is left out" for name in splat.extra]
        if target.suffix.lower() == ".splat" and splat.gaussians.sh_degree:
            lost.append(f"SH degree {splat.gaussians.sh_degree} becomes 0")
        if is_compressed_name(target):
            lost.append("values are rounded within each 256 Gaussians, which come in another order")
        for note in (*splat.notes, *(f"{text}." for text in lost)):
            sys.stderr.write(f"  {note}\n")
        sys.stdout.write(f"{target}\n")
    return 0
