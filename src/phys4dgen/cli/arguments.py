"""Flags of the commands, and how they become a scene.

Everyday flags are one table; every key of scene.yaml is a flag too (``--simulation.grid 96``) and needs no entry: its
name is its path in the scene, and the scene itself validates it and suggests the right spelling. Precedence: flag,
then ``--preview``, then scene file, then default.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from phys4dgen.errors import SceneError, did_you_mean

if TYPE_CHECKING:
    from phys4dgen.scene import Scene

__all__ = [
    "COMMANDS",
    "FILM_FLAGS",
    "IDENTIFY_FLAGS",
    "IDENTIFY_SWITCHES",
    "SELECT_FLAGS",
    "Arguments",
    "add_flags_of",
    "add_generate_flags",
    "add_simulate_flags",
    "add_switches",
    "module_of",
    "parse",
    "scene_from",
    "scene_with",
    "top_help",
]

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


@dataclass(frozen=True)
class Flag:
    """An everyday flag that sets one key of the scene."""

    name: str
    key: str
    metavar: str
    help: str


_FORCES_HELP = "what acts, as in scene.yaml (docs/forces.md): '[{part: leaves, value_ms2: [3,0,0], to_s: 1}]'"
_BOUNDARIES_HELP = "ground, walls, plates, pins, as in scene.yaml: '[{kind: ground, friction: 0.3}]'"
_CHANGES_HELP = "materials that change, as in scene.yaml: '[{part: ice, from_s: 0.5, material: water}]'"
SELECT_FLAGS = (
    Flag("--select-box", "select.box", "X0,Y0,Z0,X1,Y1,Z1", "of a captured scene: what lies in this box is the object"),
    Flag("--select-sphere", "select.sphere", "X,Y,Z,R", "of a captured scene: what lies in this ball is the object"),
    Flag("--select-labels", "select.labels", "LIST", "of a captured scene: these numbers or names are the object"),
    Flag("--select-labels-file", "select.labels_file", "FILE", ".npy or .npz that has the labels"),
)
"""What of a captured scene is the object."""

SCENE_FLAGS = (
    *SELECT_FLAGS,
    Flag("--up", "up", "AXIS", "which way is up: auto, x, -x, y, -y, z, -z or 0,0,1"),
    Flag("--height-m", "height_m", "METRES", "the object's real height"),
    Flag("--longest-m", "longest_m", "METRES", "the real length of its longest side, instead of its height"),
    Flag("--mask", "reconstruct.mask", "FILE", "of a picture: white where the object is"),
    Flag("--matte-model", "reconstruct.matte_model", "FILE", "ONNX network that finds the object in a picture"),
    Flag("--parts", "grouping.parts", "N", "number of parts to find"),
    Flag("--motion", "motion.preset", "NAME", "what happens: auto, sway, drop, press, twist, melt or rest"),
    Flag("--wind", "motion.wind", "X,Y,Z", "direction of the gust in the input's axes"),
    Flag("--duration-s", "simulation.duration_s", "SECONDS", "length of the film"),
    Flag("--fps", "simulation.fps", "N", "frames per second"),
    Flag("--grid", "simulation.grid", "N", "grid cells along the longest side"),
    Flag("--threads", "simulation.threads", "N", "threads to use; the result does not depend on it"),
    Flag("--seed", "seed", "N", "of everything that is drawn at random"),
    Flag("--forces", "forces", "LIST", _FORCES_HELP),
    Flag("--boundaries", "boundaries", "LIST", _BOUNDARIES_HELP),
    Flag("--changes", "changes", "LIST", _CHANGES_HELP),
    Flag("--gravity", "gravity", "NAME", "rest: the shape given is at rest under gravity"),
)  # fmt: skip
"""Everyday flags of the commands that simulate."""

FILM_FLAGS = (
    Flag("--orbit-deg", "output.video.orbit_deg", "DEGREES", "how far the camera travels round the object"),
    Flag("--azimuth-deg", "output.video.azimuth_deg", "DEGREES", "where the middle of that path lies"),
    Flag("--elevation-deg", "output.video.elevation_deg", "DEGREES", "of the camera above the horizon"),
    Flag("--width", "output.video.width", "PIXELS", "of the film"),
    Flag("--height", "output.video.height", "PIXELS", "of the film; auto: from the object's shape"),
    Flag("--fps", "output.video.fps", "N", "frames per second of the film"),
    Flag("--background", "output.video.background", "NAME", "white, black or grey"),
)
"""Everyday flags of ``render``."""

IDENTIFY_FLAGS = (
    Flag("--backend", "materials.backend", "NAME", "who names them: mllm (default), rule, library or file"),
    Flag("--model", "materials.model", "ID", "id of the model (default: gpt-4o)"),
    Flag("--base-url", "materials.base_url", "URL", "an OpenAI-compatible endpoint (default: OpenAI's)"),
    Flag("--samples", "materials.samples", "N", "independent answers (default: 5)"),
    Flag("--temperature", "materials.temperature", "T", "how much the answers may differ (default: 0.8)"),
    Flag("--origin", "materials.origin", "WORD", "natural or artificial, where you know it (default: ask)"),
)
"""Everyday flags of ``identify``."""

ALLOW_UPLOAD = Flag("--allow-upload", "materials.allow_upload", "", "pictures may be sent to a model")
IDENTIFY_SWITCHES = (
    ALLOW_UPLOAD,
    Flag("--offline", "materials.offline", "", "use the answers in the run folder alone"),
    Flag("--trust", "materials.trust", "", "keep the model's values although the checks speak against them"),
)
"""Flags without a value."""

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


def add_flags_of(parser: argparse.ArgumentParser, flags: Sequence[Flag]) -> None:
    """Add a table of everyday flags."""
    for flag in flags:
        parser.add_argument(flag.name, dest=flag.key, metavar=flag.metavar, help=flag.help)


def add_switches(parser: argparse.ArgumentParser, flags: Sequence[Flag]) -> None:
    """Add flags that take no value."""
    for flag in flags:
        parser.add_argument(flag.name, dest=flag.key, action="store_true", help=flag.help)


def add_generate_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags that fill a run folder from a scene."""
    parser.add_argument("-o", "--output", metavar="RUN", type=Path, help="the run folder to fill (required)")
    parser.add_argument("--overwrite", action="store_true", help="replace a run with other settings in RUN")
    parser.add_argument("--preview", action="store_true", help="coarse and quick: a small film and no frame files")
    add_simulate_flags(parser)


def add_simulate_flags(parser: argparse.ArgumentParser) -> None:
    """Add the everyday flags of a scene, and how far to go."""
    parser.add_argument(
        "--until", metavar="STAGE", help="stop after reconstruct, views, grouping, interior, materials or simulate"
    )
    add_flags_of(parser, SCENE_FLAGS)
    add_switches(parser, (ALLOW_UPLOAD,))
    for name, metavar, text in (
        ("--hold", "PART", "this part does not move"),
        ("--material", "PART=NAME", "material of a part, from the library"),
        ("--part-name", "NUMBER=NAME", "name of a part (they are numbered from the ground up)"),
    ):
        parser.add_argument(name, metavar=metavar, action="append", default=[], help=f"{text}; may be repeated")


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
