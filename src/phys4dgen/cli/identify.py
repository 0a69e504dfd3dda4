"""``identify RUN``: the materials again, by another model or with more samples."""

from __future__ import annotations

import argparse
from pathlib import Path

from phys4dgen.cli.arguments import Arguments, scene_with
from phys4dgen.cli.flags import IDENTIFY_FLAGS, IDENTIFY_SWITCHES, add_flags_of, add_switches
from phys4dgen.errors import SceneError
from phys4dgen.progress import Progress

__all__ = ["SCENE_KEYS", "add_flags", "run"]

SCENE_KEYS = True


def add_flags(parser: argparse.ArgumentParser) -> None:
    """The run, the model and how it is asked; they are written into RUN/scene.yaml."""
    parser.add_argument("folder", metavar="RUN", type=Path, help="a run folder; edited materials in it stay")
    add_flags_of(parser, IDENTIFY_FLAGS)
    add_switches(parser, IDENTIFY_SWITCHES)
    parser.add_argument("--stats", action="store_true", help="write RUN/reliability.md: how far the answers agree")
    parser.add_argument("--compare", metavar="M1,M2", help="only write RUN/comparison.md: models side by side")


def run(arguments: Arguments) -> int:
    """Identify."""
    options = arguments.options
    for key, (_, flag) in arguments.overrides.items():
        if not key.startswith("materials."):
            raise SceneError(
                f"{flag}: 'identify' changes materials alone; 'simulate {options.folder}' takes this flag."
            )

    from phys4dgen.cli.working import work
    from phys4dgen.run.generate import scene_of_run
    from phys4dgen.run.identification import compare_models, identify_again, write_reliability

    scene = scene_of_run(options.folder)
    usual: dict[str, tuple[object, str]] = {"materials.offline": (False, "identify")}  # holds for one call
    if scene.materials.backend == "auto":
        usual["materials.backend"] = ("mllm", "identify")
    scene = scene_with(scene, {**usual, **arguments.overrides})

    def job(progress: Progress) -> list[Path]:
        if options.compare is not None:
            models = [name.strip() for name in options.compare.split(",") if name.strip()]
            return [compare_models(options.folder, scene, models, progress=progress)]
        found = identify_again(options.folder, scene, progress=progress)
        paths = [found.root / "materials.yaml"]
        return [*paths, write_reliability(found.root)] if options.stats else paths

    return work(arguments, options.folder, job)
