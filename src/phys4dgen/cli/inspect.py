"""``inspect FILE``: what a splat file or a run folder holds."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from phys4dgen.cli.arguments import Arguments
from phys4dgen.cli.flags import SELECT_FLAGS, add_flags_of

__all__ = ["SCENE_KEYS", "add_flags", "fact_lines", "run"]

SCENE_KEYS = False


def add_flags(parser: argparse.ArgumentParser) -> None:
    """What to look at."""
    parser.add_argument("file", metavar="FILE", type=Path, help="a .ply or .splat file, or a run folder")
    parser.add_argument("--json", action="store_true", help="as JSON")
    parser.add_argument(
        "--picture", metavar="FILE", type=Path, help="PNG of four views of a splat, what is selected in its colours"
    )
    add_flags_of(parser, SELECT_FLAGS)


def run(arguments: Arguments) -> int:
    """Print the facts."""
    from phys4dgen.run.inspection import inspect_path
    from phys4dgen.run.json_text import json_text

    facts = inspect_path(arguments.options.file, select=arguments.overrides, picture=arguments.options.picture)
    text = json_text(facts, indent=2) if arguments.options.json else "\n".join(fact_lines(facts))
    sys.stdout.write(text + "\n")
    return 0


def fact_lines(facts: Mapping[str, Any], indent: str = "") -> list[str]:
    """Facts as indented lines for people."""
    lines = []
    for name, value in facts.items():
        label = f"{indent}{name.replace('_', ' ')}:"
        if isinstance(value, Mapping) and value:
            lines += [label, *fact_lines(value, indent + "  ")]
        elif isinstance(value, list) and value and not isinstance(value[0], float):
            lines += [label, *(f"{indent}  - {_fact(item)}" for item in value)]
        else:
            lines.append(f"{label} {_fact(value)}")
    return lines


def _fact(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: "none"}[value]
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{key.replace('_', ' ')} {_fact(item)}" for key, item in value.items()) or "none"
    if isinstance(value, list):
        return ", ".join(map(_fact, value)) or "none"
    return f"{value:,}" if isinstance(value, int) else str(value)
