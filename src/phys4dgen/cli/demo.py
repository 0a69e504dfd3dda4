"""``demo -o RUN``: the main job on a bundled object."""

from __future__ import annotations

import argparse
from pathlib import Path

from phys4dgen.cli.arguments import Arguments, add_generate_flags, scene_from

__all__ = ["SCENE_KEYS", "add_flags", "run"]

SCENE_KEYS = True


def add_flags(parser: argparse.ArgumentParser) -> None:
    """The object, and everything that fills a run."""
    parser.add_argument("--scene", metavar="NAME", help="which bundled object (default: potted_flower)")
    add_generate_flags(parser)


def run(arguments: Arguments) -> int:
    """Write the object into the run folder, and fill it."""
    from phys4dgen.cli.generate import fill
    from phys4dgen.run.demo import DEFAULT_SCENE, prepare_demo
    from phys4dgen.scene import Scene

    scene_from(arguments, Scene(input=Path("demo")))  # a misspelt flag is told before anything is made
    name = arguments.options.scene or DEFAULT_SCENE
    return fill(arguments, lambda: scene_from(arguments, prepare_demo(arguments.options.output, name=name)))
