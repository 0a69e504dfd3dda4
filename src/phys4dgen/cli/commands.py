"""What each command does once its line is parsed."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from phys4dgen.cli.arguments import Arguments, scene_from
from phys4dgen.cli.console import console_progress
from phys4dgen.scene import Scene

__all__ = ["COMMAND_FUNCTIONS"]


def generate(arguments: Arguments) -> int:
    """``generate INPUT -o RUN``."""
    return _generate(arguments, scene_from(arguments))


def demo(arguments: Arguments) -> int:
    """``demo -o RUN``."""
    from phys4dgen.run.demo import prepare_demo

    scene_from(arguments, Scene(input=Path("demo")))  # a misspelt flag is told before anything is made
    return _generate(arguments, scene_from(arguments, prepare_demo(arguments.options.output)))


def inspect(arguments: Arguments) -> int:
    """``inspect FILE``."""
    from phys4dgen.run.inspection import inspect_path
    from phys4dgen.run.json_text import json_text

    facts = inspect_path(arguments.options.file)
    text = json_text(facts, indent=2) if arguments.options.json else "\n".join(_fact_lines(facts))
    sys.stdout.write(text + "\n")
    return 0


COMMAND_FUNCTIONS: Mapping[str, Callable[[Arguments], int]] = {"generate": generate, "demo": demo, "inspect": inspect}


def _generate(arguments: Arguments, scene: Scene) -> int:
    from phys4dgen.run.stages import stages_until

    options = arguments.options
    stages_until(options.until)  # a misspelt stage is told before anything is made

    from phys4dgen.run.generate import generate as generate_run

    _show_log(options.verbose)
    try:
        with console_progress(quiet=options.quiet) as progress:
            run = generate_run(
                scene, options.output, until=options.until, overwrite=options.overwrite, progress=progress
            )
    except KeyboardInterrupt:
        sys.stderr.write(f"phys4dgen: {_after_interrupt(options.output)}\n")
        return 130
    if not options.quiet:
        sys.stdout.write("\n".join(str(path) for path in run.results) + "\n")
    return 0


def _after_interrupt(folder: Path) -> str:
    """What is usable after Ctrl-C, and how to go on."""
    from phys4dgen.run.folder import finished_stages

    finished = finished_stages(folder)
    usable = f"the stages {', '.join(finished)} are complete in {folder}" if finished else f"{folder} is not usable yet"
    return f"interrupted; {usable}; run the same command again to continue."


def _show_log(verbose: int) -> None:
    """Let the library's log reach stderr as far as asked for."""
    if verbose:
        handler = logging.StreamHandler()
        handler.setLevel(logging.INFO if verbose == 1 else logging.DEBUG)
        handler.setFormatter(logging.Formatter("%(name)s: %(message)s"))
        logging.getLogger("phys4dgen").addHandler(handler)


def _fact_lines(facts: Mapping[str, Any], indent: str = "") -> list[str]:
    lines = []
    for name, value in facts.items():
        label = f"{indent}{name.replace('_', ' ')}:"
        if isinstance(value, Mapping) and value:
            lines += [label, *_fact_lines(value, indent + "  ")]
        elif isinstance(value, list) and value and not isinstance(value[0], float):
            lines += [label, *(f"{indent}  - {item}" for item in value)]
        else:
            lines.append(f"{label} {_fact(value)}")
    return lines


def _fact(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: "none"}[value]
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, (list, Mapping)):
        return ", ".join(map(_fact, value)) or "none"
    return f"{value:,}" if isinstance(value, int) else str(value)
