"""``import-physgaussian CONFIG MODEL -o SCENE``: a scene of PhysGaussian as one of ours."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from phys4dgen.cli.arguments import Arguments
from phys4dgen.errors import SceneError

__all__ = ["SCENE_KEYS", "add_flags", "run"]

SCENE_KEYS = False


def add_flags(parser: argparse.ArgumentParser) -> None:
    """From where to where, and how faithfully."""
    parser.add_argument("config", metavar="CONFIG", type=Path, help="configuration of PhysGaussian (.json)")
    parser.add_argument("model", metavar="MODEL", type=Path, help="its folder with point_cloud/iteration_N, or a splat")
    parser.add_argument("-o", "--output", metavar="SCENE", type=Path, help="the scene to write, .yaml (required)")
    parser.add_argument(
        "--mode",
        choices=("corrected", "compat"),
        default="corrected",
        help="corrected: what the file means (default); compat: with PhysGaussian's defects, where our solver can",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace SCENE")


def run(arguments: Arguments) -> int:
    """Import, and list where the scene does something else."""
    options = arguments.options
    out = options.output
    if out is None or out.suffix.lower() not in (".yaml", ".yml"):
        raise SceneError(f"import-physgaussian: say where the scene goes with -o SCENE.yaml, got {out}.")
    if out.exists() and not options.overwrite:
        raise SceneError(f"{out}: the file exists already; add --overwrite to replace it, or choose another name.")
    from phys4dgen.physgaussian.importing import import_physgaussian

    imported = import_physgaussian(options.config, options.model, out, mode=options.mode)
    if not options.quiet:
        for difference in imported.differences:
            sys.stderr.write(f"  {difference}\n")
        sys.stdout.write("\n".join(str(path) for path in imported.files) + "\n")
    return 0
