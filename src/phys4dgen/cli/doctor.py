"""``doctor``: what is ready on this machine, what is missing, and the command that gets it."""

from __future__ import annotations

import argparse
import sys

from phys4dgen.cli.arguments import Arguments

__all__ = ["SCENE_KEYS", "add_flags", "run"]

SCENE_KEYS = False

_SIGNS = {"ready": "ok     ", "missing": "MISSING", "optional": "-      "}


def add_flags(parser: argparse.ArgumentParser) -> None:
    """How to say it."""
    parser.add_argument("--json", action="store_true", help="as JSON")


def run(arguments: Arguments) -> int:
    """Print the findings; exit code 1 where something that every run needs is missing."""
    from phys4dgen.run.doctor import examine
    from phys4dgen.run.json_text import json_text

    findings = examine()
    if arguments.options.json:
        sys.stdout.write(json_text({"findings": findings}, indent=2) + "\n")
    elif not arguments.options.quiet:
        width = max(len(finding.name) for finding in findings)
        for finding in findings:
            fix = f"\n{' ' * (width + 10)}{finding.fix}" if finding.fix else ""
            sys.stdout.write(f"{_SIGNS[finding.state]} {finding.name:<{width}}  {finding.detail}{fix}\n")
    return int(any(finding.state == "missing" for finding in findings))
