"""What the commands that work in a run folder share: the log, the result's paths, and what Ctrl-C leaves."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from phys4dgen.cli.arguments import Arguments
from phys4dgen.cli.console import console_progress
from phys4dgen.progress import Progress

if TYPE_CHECKING:
    from phys4dgen.run.generate import Run

__all__ = ["work"]


def work(arguments: Arguments, folder: Path, job: Callable[[Progress], Run | list[Path]]) -> int:
    """Run a job on a run folder; returns the exit code.

    Args:
        arguments: of the command.
        folder: the run folder.
        job: does it, and returns the run or the files that people look at first.
    """
    options = arguments.options
    try:
        with _shown_log(options.verbose), console_progress(quiet=options.quiet) as progress:
            made = job(progress)
    except BaseException as error:
        if not _was_interrupted(error):
            raise
        sys.stderr.write(f"phys4dgen: {_after_interrupt(folder)}\n")
        return 130
    results = made if isinstance(made, list) else made.results
    if not options.quiet:
        sys.stdout.write("\n".join(str(path) for path in results) + "\n")
    return 0


def _was_interrupted(error: BaseException | None) -> bool:
    """Whether Ctrl-C began it: a library may fail while it cleans up, as zipfile does with a file half written."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__context__
    return error is not None


def _after_interrupt(folder: Path) -> str:
    """What is usable after Ctrl-C, and how to go on."""
    from phys4dgen.run.state import finished_stages

    finished = finished_stages(folder)
    if not finished:
        return f"interrupted; {folder} is not usable yet; run the same command again to start over."
    return (
        f"interrupted; the stages {', '.join(finished)} are complete in {folder}; "
        f"run the same command again, or 'phys4dgen simulate {folder}', to continue."
    )


@contextmanager
def _shown_log(verbose: int) -> Iterator[None]:
    """Let the library's log reach stderr as far as asked for, as long as the command runs."""
    handler = logging.StreamHandler() if verbose else logging.NullHandler()
    handler.setLevel(logging.INFO if verbose == 1 else logging.DEBUG)
    handler.setFormatter(logging.Formatter("%(name)s: %(message)s"))
    logger = logging.getLogger("phys4dgen")
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)
