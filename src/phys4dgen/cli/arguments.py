"""Command lines, and how they become a scene.

Everyday flags are tables (``flags.py``). Every key of scene.yaml is a flag too (``--simulation.grid 96``) and needs no
entry: its name is its path in the scene, and the scene itself validates it and suggests the right spelling. Precedence:
flag, then ``--preview``, then scene file, then default.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from phys4dgen.cli.flags import FILM_FLAGS, IDENTIFY_FLAGS, IDENTIFY_SWITCHES, SCENE_FLAGS
from phys4dgen.errors import SceneError, did_you_mean

if TYPE_CHECKING:
    from phys4dgen.scene import Scene

__all__ = ["COMMANDS", "Arguments", "module_of", "parse", "scene_from", "scene_with", "top_help"]

COMMANDS = {
    "generate": "one picture, 3D Gaussian splat or mesh in, physically simulated 4D content out",
    "demo": "the same on a bundled object",
    "simulate": "again from the simulation, after an edit of a run's scene.yaml or materials.yaml",
    "render": "the film of a run again, from elsewhere, or with parts, materials, strain or forces laid over it",
    "group": "parts of a run merged, renamed, or found anew",
    "identify": "name the materials of a run again, by another model or with more samples",
    "inspect": "say what a splat file or a run folder holds",
    "convert": "a splat file into another format",
    "import-physgaussian": "a configuration of PhysGaussian into a scene of ours",
    "doctor": "say what is ready on this machine, what is missing, and how to get it",
}
"""Summaries of the commands; each lives in the module of its name beside this one, which has ``SCENE_KEYS`` (whether
every key of the scene is a flag), ``add_flags(parser)`` and ``run(arguments)``."""


_PREVIEW: dict[str, Any] = {
    "simulation.grid": 32,
    "simulation.cell_m": None,
    "simulation.max_substeps": 300,
    "simulation.duration_s": 1.0,
    "views.size_px": 256,
    "output.frames": "none",
    "output.video.width": 400,
}
"""What ``--preview`` sets."""

_DOTTED = re.compile(r"--(?P<key>[A-Za-z_]\w*(?:-\w+)*\.[^=]+)(?:=(?P<value>.*))?", re.DOTALL)


@dataclass(frozen=True)
class Arguments:
    """A parsed command line.

    Attributes:
        command: one of COMMANDS.
        options: the command's own options by name.
        overrides: dotted key of the scene -> (value, the flag that gave it).
    """

    command: str
    options: argparse.Namespace
    overrides: dict[str, tuple[Any, str]] = field(default_factory=dict)


class _Parser(argparse.ArgumentParser):
    """Raises one sentence instead of printing usage."""

    def error(self, message: str) -> NoReturn:
        raise SceneError(f"{message[0].upper()}{message[1:]}; '{self.prog} --help' lists what there is.")


def top_help() -> str:
    """The text of ``phys4dgen --help``; needs no heavy import."""
    lines = ["usage: phys4dgen COMMAND [flags]", "", "3D Gaussian splats that obey physics, on a CPU.", "", "commands:"]
    lines += [f"  {name:<20} {text}" for name, text in COMMANDS.items()]
    lines += ["", "  phys4dgen COMMAND --help   lists the flags of a command", "  phys4dgen --version"]
    lines += ["", "example: phys4dgen generate plant.splat -o plant_run --up -y --height-m 0.35"]
    return "\n".join(lines)


def module_of(command: str) -> str:
    """Name of the module beside this one in which a command lives."""
    return command.replace("-", "_")


def parse(argv: Sequence[str]) -> Arguments:
    """Parse a command line that starts with a command.

    Raises:
        SceneError: an unknown command or flag (with a suggestion), or a flag without its value.
    """
    command, *rest = argv
    if command not in COMMANDS:
        raise SceneError(
            f"'{command}' is not a command; expected one of {', '.join(COMMANDS)}.{did_you_mean(command, COMMANDS)}"
        )
    module = import_module(f"phys4dgen.cli.{module_of(command)}")
    parser = _parser(command)
    module.add_flags(parser)
    if module.SCENE_KEYS and any(word in ("-h", "--help") for word in rest):
        parser.epilog = "every key of scene.yaml is a flag as well:\n" + "\n".join(_scene_key_lines())
    flags = [word for action in parser._actions for word in action.option_strings]
    takes_value = {word for action in parser._actions if action.nargs != 0 for word in action.option_strings}
    rest, overrides = _take_dotted(_joined(rest, flags, takes_value), accepted=module.SCENE_KEYS)
    options, unknown = parser.parse_known_args(rest)
    if unknown:
        word = unknown[0].split("=")[0]
        kind = "a flag" if word.startswith("-") else "an argument"
        hint = did_you_mean(word, flags) or " Its --help lists what there is."
        raise SceneError(f"'{word}' is not {kind} of 'phys4dgen {command}'.{hint}")
    return Arguments(command, options, {**_everyday_overrides(options), **overrides})


def scene_from(arguments: Arguments, base: Scene | None = None) -> Scene:
    """The scene that a command line asks for, with absolute paths.

    Args:
        arguments: of ``generate`` or ``demo``.
        base: the scene to start from, instead of ``--scene`` and INPUT.

    Raises:
        SceneError: no input, an unknown key, or a value that does not fit; names the flag or the file.
    """
    from phys4dgen.scene import Scene, load_scene

    options = arguments.options
    if options.output is None:
        raise SceneError(f"{arguments.command}: say where the result goes with -o RUN.")
    scene, given = base, None
    if base is None:
        given = options.input
        scene = None if options.scene is None else load_scene(options.scene)
    if scene is None:
        if given is None:
            raise SceneError(
                "generate: name the splat to animate, for example 'phys4dgen generate plant.splat -o run'."
            )
        scene = Scene(input=Path(given))
    elif given is not None:
        scene = scene.with_overrides({"input": given})
    preview = {key: (value, "--preview") for key, value in _PREVIEW.items()} if options.preview else {}
    return scene_with(scene, {**preview, **arguments.overrides})


def scene_with(scene: Scene, overrides: Mapping[str, tuple[Any, str]]) -> Scene:
    """A scene with what a command line says, ``Arguments.overrides``; paths become absolute.

    Raises:
        SceneError: an unknown key, or a value that does not fit; names the flag.
    """
    values = {key: value for key, (value, _) in overrides.items()}
    sources = {key: flag for key, (_, flag) in overrides.items()}
    return scene.with_overrides(values, sources=sources).with_paths_from(Path.cwd())


def _parser(command: str) -> _Parser:
    """A parser with what all commands have."""
    parser = _Parser(
        prog=f"phys4dgen {command}",
        description=COMMANDS[command][0].upper() + COMMANDS[command][1:] + ".",
        allow_abbrev=False,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("-v", "--verbose", action="count", default=0, help="say more; -vv adds tracebacks to errors")
    parser.add_argument("-q", "--quiet", action="store_true", help="say nothing but errors")
    return parser


def _scene_key_lines() -> Iterator[str]:
    from phys4dgen.scene import Scene, scene_keys

    for path, default, text in scene_keys(Scene):
        if len(path) > 1:
            flag = f"--{'.'.join(path).replace('_', '-')}"
            yield f"  {flag:<38} {text} (default: {default})"
    yield f"  {'--parts.NAME.KEY':<38} hold, material, interior-material or thickness-m of a part"
    yield f"  {'--objects.NAME.KEY':<38} position-m, rotation-deg, velocity-ms ... of one of several objects"


def _joined(words: Sequence[str], flags: Sequence[str], takes_value: set[str]) -> list[str]:
    """Turn ``--up -y`` into ``--up=-y``: argparse would take -y for a flag."""
    joined: list[str] = []
    for word in words:
        before = joined[-1] if joined else ""
        wants_value = before in takes_value or (_DOTTED.fullmatch(before) is not None and "=" not in before)
        is_value = word.startswith("-") and word.split("=")[0] not in flags and not word.startswith("--")
        if wants_value and is_value:
            joined[-1] = f"{before}={word}"
        else:
            joined.append(word)
    return joined


def _take_dotted(words: Sequence[str], *, accepted: bool) -> tuple[list[str], dict[str, tuple[Any, str]]]:
    """Split the flags that name a key of the scene (``--simulation.grid 96``) from the others."""
    others: list[str] = []
    overrides: dict[str, tuple[Any, str]] = {}
    queue = list(words)
    while queue:
        word = queue.pop(0)
        match = _DOTTED.fullmatch(word) if accepted else None
        if match is None:
            others.append(word)
            continue
        flag, value = f"--{match['key']}", match["value"]
        if value is None:
            if not queue or queue[0].startswith("--"):
                raise SceneError(f"{flag}: expected a value after it; a switch takes true or false.")
            value = queue.pop(0)
        overrides[_scene_key(match["key"])] = (_value(value, flag), flag)
    return others, overrides


def _scene_key(dotted: str) -> str:
    """``simulation.max-substeps`` -> ``simulation.max_substeps``; the name of a part or an object stays as it is."""
    path = dotted.split(".")
    is_name = path[0] in ("parts", "objects")
    return ".".join(key if is_name and place == 1 else key.replace("-", "_") for place, key in enumerate(path))


def _value(text: str, flag: str) -> Any:
    """The value of a flag, read as YAML would."""
    from phys4dgen.yaml12 import parse_yaml, plain_value

    return parse_yaml(text, source=flag).value if text[:1] in ("[", "{") else plain_value(text)


def _everyday_overrides(options: argparse.Namespace) -> dict[str, tuple[Any, str]]:
    """What the everyday flags say, of those that the command has."""
    overrides: dict[str, tuple[Any, str]] = {}
    for flag in (*SCENE_FLAGS, *FILM_FLAGS, *IDENTIFY_FLAGS):
        text = getattr(options, flag.key, None)
        if text is not None:
            overrides[flag.key] = (_value(text, flag.name), flag.name)
    overrides |= {flag.key: (True, flag.name) for flag in IDENTIFY_SWITCHES if getattr(options, flag.key, False)}
    if not hasattr(options, "part_name"):
        return overrides
    for part in options.hold:
        overrides[f"parts.{part}.hold"] = ("fixed", "--hold")
    for text in options.material:
        part, name = _pair(text, "--material", "pot=ceramic")
        overrides[f"parts.{part}.material"] = (name, "--material")
    for text in options.part_name:
        number, name = _pair(text, "--part-name", "0=pot")
        if not number.isdecimal():
            raise SceneError(f"--part-name: expected the number of a part before '=', as in 0=pot, got '{text}'.")
        overrides[f"grouping.names.{number}"] = (name, "--part-name")
    return overrides


def _pair(text: str, flag: str, example: str) -> tuple[str, str]:
    left, equals, right = (word.strip() for word in text.partition("="))
    if not (left and equals and right):
        raise SceneError(f"{flag}: expected two words joined by '=', as in {example}, got '{text}'.")
    return left, right
