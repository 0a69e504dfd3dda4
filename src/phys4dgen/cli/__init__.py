"""The command line: errors as one sentence, exit code 0 only when what was asked for is on disk.

Exit codes: 0 done, 1 the work failed, 2 the command line or the scene is wrong, 130 interrupted. Heavy imports happen
inside the commands, so that ``--help`` and misspelt flags answer at once.
"""

from __future__ import annotations

import errno
import logging
import os
import sys
import traceback
from collections.abc import Sequence
from importlib import import_module

from phys4dgen.errors import Phys4DGenError, SceneError

__all__ = ["main"]


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command line and return its exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    verbosity = _verbosity(words)
    logging.getLogger("phys4dgen").setLevel(logging.DEBUG)
    logging.getLogger("phys4dgen").addHandler(logging.NullHandler())
    try:
        return _run(words)
    except SceneError as error:
        return _fail(str(error), code=2, verbosity=verbosity)
    except Phys4DGenError as error:
        return _fail(str(error), code=1, verbosity=verbosity)
    except KeyboardInterrupt as interrupt:
        said = str(interrupt) or "Interrupted; nothing was written."
        return _fail(said, code=130, verbosity=verbosity)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or Python complains again while it ends
        return 1
    except MemoryError:
        return _fail(
            "not enough memory for this scene; lower --grid, or give a splat with fewer Gaussians.",
            code=1,
            verbosity=verbosity,
        )
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            where = f" at {error.filename}" if error.filename else ""
            return _fail(
                f"the disk is full{where}; make room and give the same command again, which continues from the last "
                "finished stage.",
                code=1,
                verbosity=verbosity,
            )
        return _fail(f"{error.filename or 'file system'}: {error.strerror or error}.", code=1, verbosity=verbosity)
    except Exception as error:  # noqa: BLE001  the last resort: users get a sentence, developers -vv
        said = f"internal error, please report it: {type(error).__name__}: {error} (-vv shows where)"
        return _fail(said, code=1, verbosity=verbosity)


def _run(words: list[str]) -> int:
    from phys4dgen.cli.arguments import module_of, parse, top_help

    if not words or words[0] in ("-h", "--help", "help"):
        sys.stdout.write(top_help() + "\n")
        return 0 if words else 2
    if words[0] == "--version":
        from importlib.metadata import version

        sys.stdout.write(f"phys4dgen {version('phys4dgen')}\n")
        return 0
    try:
        arguments = parse(words)
    except SystemExit as help_was_printed:
        return int(help_was_printed.code or 0)
    return import_module(f"phys4dgen.cli.{module_of(arguments.command)}").run(arguments)


def _verbosity(words: Sequence[str]) -> int:
    """Known before parsing, because parsing may fail."""
    return sum(word.count("v") for word in words if word in ("-v", "-vv", "-vvv")) + words.count("--verbose")


def _fail(sentence: str, *, code: int, verbosity: int) -> int:
    if verbosity >= 2:
        traceback.print_exc()
    sys.stderr.write(f"phys4dgen: {sentence}\n")
    return code
