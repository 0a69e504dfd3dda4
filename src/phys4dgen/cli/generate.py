"""``generate INPUT -o RUN``: the main job."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from phys4dgen.cli.arguments import Arguments, scene_from
from phys4dgen.cli.flags import add_generate_flags

if TYPE_CHECKING:
    from phys4dgen.scene import Scene

__all__ = ["SCENE_KEYS", "add_flags", "fill", "run"]

SCENE_KEYS = True


def add_flags(parser: argparse.ArgumentParser) -> None:
    """The input, and everything that fills a run."""
    parser.add_argument(
        "input",
        metavar="INPUT",
        nargs="?",
        help="a splat (.ply, .splat), picture, or mesh (.glb, .obj, .stl, .ply); may stand in --scene",
    )
    parser.add_argument("--scene", metavar="FILE", type=Path, help="scene.yaml with any of the settings")
    add_generate_flags(parser)


def run(arguments: Arguments) -> int:
    """Fill the run folder from the input or the scene file."""
    return fill(arguments, lambda: scene_from(arguments))


def fill(arguments: Arguments, scene_of: Callable[[], Scene]) -> int:
    """Fill the run folder from a scene, which is made once the command line is known to be right."""
    options = arguments.options
    from phys4dgen.run.stages import stages_until

    stages_until(options.until)
    scene = scene_of()
    from phys4dgen.cli.working import work
    from phys4dgen.run.generate import generate

    return work(
        arguments,
        options.output,
        lambda progress: generate(
            scene, options.output, until=options.until, overwrite=options.overwrite, progress=progress
        ),
    )
