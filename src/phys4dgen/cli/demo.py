"""``demo -o RUN``: the main job on a bundled object."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from phys4dgen.cli.arguments import Arguments, scene_from
from phys4dgen.cli.flags import add_generate_flags

__all__ = ["SCENE_KEYS", "add_flags", "run"]

SCENE_KEYS = True


def add_flags(parser: argparse.ArgumentParser) -> None:
    """The object, and everything that fills a run."""
    parser.add_argument(
        "--scene",
        metavar="NAME",
        help="which bundled object (default: potted_flower), or a scene file about one, as in examples/",
    )
    add_generate_flags(parser)


def run(arguments: Arguments) -> int:
    """Write the object into the run folder, and fill it."""
    from phys4dgen.cli.generate import fill
    from phys4dgen.run.demo import DEFAULT_SCENE, prepare_demo, prepare_example
    from phys4dgen.scene import Scene

    told = {key: value for key, value in arguments.overrides.items() if not key.startswith("objects.")}
    scene_from(replace(arguments, overrides=told), Scene(input=Path("demo")))  # misspelt flags, before anything is made
    name, out = arguments.options.scene or DEFAULT_SCENE, arguments.options.output
    is_file = Path(name).suffix in (".yaml", ".yml")
    return fill(
        arguments,
        lambda: scene_from(arguments, prepare_example(out, Path(name)) if is_file else prepare_demo(out, name=name)),
    )
