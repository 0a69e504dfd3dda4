"""``group RUN``: the parts of a run merged, renamed, split, pointed at or found anew."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from phys4dgen.cli.arguments import Arguments
from phys4dgen.errors import SceneError

__all__ = ["SCENE_KEYS", "add_flags", "run"]

SCENE_KEYS = False


class _InOrder(argparse.Action):
    """Collects edits of all kinds in the order in which they are given."""

    def __call__(self, parser: Any, namespace: argparse.Namespace, values: Any, option_string: Any = None) -> None:
        namespace.edits = [*namespace.edits, (self.dest, values)]


def add_flags(parser: argparse.ArgumentParser) -> None:
    """The run, and the edits; they are kept in RUN/scene.yaml."""
    parser.set_defaults(edits=[])
    parser.add_argument(
        "folder", metavar="RUN", type=Path, help="a run folder whose parts are found; see its parts.png"
    )
    for name, metavar, text in (
        ("--merge", "A,B", "these parts become one, under the first name"),
        ("--rename", "OLD=NEW", "another name for a part"),
        (
            "--split",
            "NAME[=K]",
            "this part becomes K (2) by colour and shape, or those that --seed after it point at; NAME@X,Y[=PIECE], a "
            "pixel of the front view, or NAME@LEFT,TOP,RIGHT,BOTTOM, a box in it (or @VIEW,... of another): what is "
            "there becomes a part of its own, by SAM2 where its weights are on this machine",
        ),
    ):
        text += "; parts by name or number; may be repeated, in order"
        parser.add_argument(name, metavar=metavar, action=_InOrder, default=argparse.SUPPRESS, help=text)
    parser.add_argument(
        "--seed",
        metavar="NAME@VIEW,X,Y",
        action=_InOrder,
        default=argparse.SUPPRESS,
        help="a click: pixel X, Y (from the upper left) of RUN/views/VIEW_rgb.png, or of view number VIEW, shows the "
        "part NAME; without --split there are then these parts and no others; may be repeated, several times a part",
    )
    parser.add_argument("--undo", action="store_true", help="take the last edit back")
    parser.add_argument("--parts", metavar="N", help="find the parts anew, so many; earlier edits go")


def run(arguments: Arguments) -> int:
    """Edit the parts; later stages are redone by the next 'simulate RUN'."""
    options = arguments.options
    if sum((bool(options.edits), options.undo, options.parts is not None)) != 1:
        raise SceneError(
            "group: say what to do with --merge, --rename, --split and --seed, or with --undo, or with --parts "
            "(one kind at a time)."
        )

    from phys4dgen.cli.working import work
    from phys4dgen.run.regroup import regroup
    from phys4dgen.yaml12 import plain_value

    parts = None if options.parts is None else plain_value(options.parts)
    return work(
        arguments,
        options.folder,
        lambda progress: regroup(options.folder, options.edits, undo=options.undo, parts=parts, progress=progress),
    )
