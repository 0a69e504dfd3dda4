"""``render RUN``: the film of a run again, or an overlay of it; never simulates."""

from __future__ import annotations

import argparse
from pathlib import Path

from phys4dgen.cli.arguments import Arguments, scene_with
from phys4dgen.cli.flags import FILM_FLAGS, add_flags_of
from phys4dgen.errors import SceneError

__all__ = ["SCENE_KEYS", "add_flags", "run"]

SCENE_KEYS = True


def add_flags(parser: argparse.ArgumentParser) -> None:
    """The run, and everything about its film; without --overlay it is written into RUN/scene.yaml."""
    parser.add_argument("folder", metavar="RUN", type=Path, help="a run folder that has been simulated")
    parser.add_argument(
        "--overlay", metavar="NAME", help="parts, material, strain or forces, as a film of its own in RUN/overlays/"
    )
    parser.add_argument("--overwrite", action="store_true", help="render again although nothing has changed")
    add_flags_of(parser, FILM_FLAGS)


def run(arguments: Arguments) -> int:
    """Render."""
    options = arguments.options
    for key, (_, flag) in arguments.overrides.items():
        if not key.startswith("output."):
            raise SceneError(f"{flag}: 'render' changes the film alone; 'simulate {options.folder}' takes this flag.")

    from phys4dgen.cli.working import work
    from phys4dgen.run.generate import continue_run, scene_of_run
    from phys4dgen.run.overlays import check_overlay, render_overlay

    overlay = options.overlay
    if overlay is not None:
        check_overlay(overlay)
    scene = scene_with(scene_of_run(options.folder), arguments.overrides)
    if overlay is not None:
        return work(
            arguments,
            options.folder,
            lambda progress: render_overlay(options.folder, scene, overlay, progress=progress),
        )
    return work(
        arguments,
        options.folder,
        lambda progress: continue_run(
            options.folder, scene, since="render", again=options.overwrite, progress=progress
        ),
    )
