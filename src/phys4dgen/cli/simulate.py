"""``simulate RUN``: again from the simulation, after an edit or an interruption."""

from __future__ import annotations

import argparse
from pathlib import Path

from phys4dgen.cli.arguments import Arguments, scene_with
from phys4dgen.cli.flags import add_simulate_flags

__all__ = ["SCENE_KEYS", "add_flags", "run"]

SCENE_KEYS = True


def add_flags(parser: argparse.ArgumentParser) -> None:
    """The run, and everything that a scene may say; it is written into RUN/scene.yaml."""
    parser.add_argument("folder", metavar="RUN", type=Path, help="a run folder; edit its scene.yaml or materials.yaml")
    parser.add_argument("--overwrite", action="store_true", help="simulate again although nothing has changed")
    add_simulate_flags(parser)


def run(arguments: Arguments) -> int:
    """Bring the run up to date."""
    options = arguments.options
    from phys4dgen.run.stages import stages_until

    stages_until(options.until)

    from phys4dgen.cli.working import work
    from phys4dgen.run.generate import continue_run, scene_of_run

    scene = scene_with(scene_of_run(options.folder), arguments.overrides)
    return work(
        arguments,
        options.folder,
        lambda progress: continue_run(
            options.folder, scene, since="simulate", until=options.until, again=options.overwrite, progress=progress
        ),
    )
