"""The everyday flags of the commands, as tables; every other key of a scene is a flag without an entry here."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

__all__ = [
    "FILM_FLAGS",
    "IDENTIFY_FLAGS",
    "IDENTIFY_SWITCHES",
    "SCENE_FLAGS",
    "SELECT_FLAGS",
    "Flag",
    "add_flags_of",
    "add_generate_flags",
    "add_simulate_flags",
    "add_switches",
]


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
    Flag("--prestress", "prestress", "NAME", "off: the shape given sags where gravity is on"),
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
