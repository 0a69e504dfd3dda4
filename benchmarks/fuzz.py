"""Mutated files into every reader: ``python -m benchmarks fuzz [--reader NAME] [--minutes N] [--keep FOLDER]``.

A reader may refuse (an error of phys4dgen, one printable sentence) or return; any other exception, a read that takes
more than 5 s, or one that asks for more than 500 MB, is a finding. Findings are kept as files; exit code 1 if there are
any. The same seed tries the same files.
"""

from __future__ import annotations

import argparse
import io
import json
import logging
import random
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from phys4dgen.errors import Phys4DGenError
from phys4dgen.export.trajectory import read_trajectory
from phys4dgen.formats import load_gaussians
from phys4dgen.grouping.from_file import parts_from_file
from phys4dgen.grouping.label_maps import read_label_maps
from phys4dgen.materials.materials_yaml import read_materials
from phys4dgen.materials.mllm.reading import UnreadableAnswerError, read_answer
from phys4dgen.reconstruct.picture import read_picture
from phys4dgen.scene import Scene, dump_scene, load_scene
from phys4dgen.types import Camera, Gaussians
from ply_bytes import inria_columns, ply_bytes  # pyright: ignore[reportMissingImports]
from test_formats_compressed import compressed  # pyright: ignore[reportMissingImports]

SECONDS = 5.0
MEMORY_BYTES = 500_000_000
NUMBERS = (b"-1", b"0", b"1e999", b"nan", b"4294967295", b"99999999999999999999", b"1" * 400, b"")
WORDS = (
    b"\0",
    b"\xff" * 4,
    b"\x00\x00\x00\x80",
    b"\x00\x00\xc0\x7f",
    b"[",
    b"{",
    b"&a ",
    b"*a",
    b"!!",
    b"\n",
    b": ",
    b"'",
)


class Target(NamedTuple):
    """A reader and files that it takes."""

    suffix: str
    seeds: Sequence[bytes]
    read: Callable[[Path], Any]


def main(reader: str | None, *, minutes: float, keep: Path, seed: int) -> int:
    """Fuzz one reader, or all one after the other."""
    known = targets()
    logging.getLogger("phys4dgen").setLevel(logging.CRITICAL)
    if reader is not None and reader not in known:
        sys.stderr.write(f"there is no reader '{reader}'; there are {', '.join(known)}.\n")
        return 2
    found = 0
    for name in known if reader is None else [reader]:
        found += fuzz(name, known[name], seconds=60 * minutes, keep=keep, seed=seed)
    return 1 if found else 0


def fuzz(name: str, target: Target, *, seconds: float, keep: Path, seed: int) -> int:
    """Try mutations for so long; returns the number of findings."""
    rng = random.Random(f"{name} {seed}")
    ends, tried, refused, kinds = time.monotonic() + seconds, 0, 0, set[str]()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"a{target.suffix}"
        for content in target.seeds:
            path.write_bytes(content)
            target.read(path)  # warm, and proof that the seeds are good
        while time.monotonic() < ends:
            content = mutated(rng, target.seeds)
            path.write_bytes(content)
            problem, was_refused = attempt(target, path)
            tried, refused = tried + 1, refused + was_refused
            if problem and problem not in kinds:
                kinds.add(problem)
                keep.mkdir(parents=True, exist_ok=True)
                kept = keep / f"{name}_{len(kinds)}{target.suffix}"
                kept.write_bytes(content)
                print(f"  {name}: {problem} ({kept})", flush=True)
    print(f"{name:12} {tried:7} files, {refused / max(tried, 1):4.0%} refused, {len(kinds)} findings", flush=True)
    return len(kinds)


def attempt(target: Target, path: Path) -> tuple[str, bool]:
    """What is wrong with how a reader takes a file, and whether it refused it."""
    start = time.monotonic()
    in_use = int(Path("/proc/self/statm").read_text("ascii").split()[0]) * resource.getpagesize()
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (in_use + MEMORY_BYTES, before[1]))
    problem, refused = "", False
    try:
        target.read(path)
    except (Phys4DGenError, UnreadableAnswerError) as error:
        refused = True
        if not str(error).isprintable():
            problem = f"unprintable sentence {str(error)[:200]!r}"
    except Exception as error:  # noqa: BLE001  that is what is looked for
        problem = f"{type(error).__name__}: {str(error)[:160]}"
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
    if time.monotonic() - start > SECONDS:
        problem = problem or "took more than 5 s"
    return problem, refused


def mutated(rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """One of the seeds with one to six random faults."""
    content = bytearray(rng.choice(seeds))
    for _ in range(rng.choice((1, 1, 2, 3, 6))):
        at = rng.randrange(len(content) + 1)
        length = min(rng.choice((1, 1, 2, 4, 8, 64, 500)), len(content) - at)
        kind = rng.randrange(8)
        if kind == 0:
            for place in range(at, at + length):
                content[place] = rng.randrange(256)
        elif kind == 1 and length:
            content[at] ^= 1 << rng.randrange(8)
        elif kind == 2:
            del content[at : at + length]
        elif kind == 3:
            content[at:at] = content[at : at + length] * rng.choice((1, 2, 30))
        elif kind == 4:
            content[at:at] = rng.choice(WORDS)
        elif kind == 5:
            other = rng.choice(seeds)
            content[at : at + length] = other[rng.randrange(len(other)) :][:length]
        elif kind == 6:
            digits = [i for i, byte in enumerate(content) if 48 <= byte <= 57]
            if digits:
                place = rng.choice(digits)
                content[place : place + 1] = rng.choice(NUMBERS)
        else:
            del content[rng.randrange(len(content) + 1) :]
    return bytes(content)


def targets() -> dict[str, Target]:
    """Every reader of files of unknown origin."""
    labels = np.arange(12, dtype=np.int32) % 3
    names = np.array(["a", "b", "c"])
    camera = Camera(viewmat=np.eye(4), K=np.diag([8.0, 8.0, 1.0]), width=8, height=6)
    maps = np.tile(np.arange(8, dtype=np.int32) % 3 - 1, (2, 6, 1))
    plain = [ply_bytes(inria_columns(5, degree=1)), ply_bytes(inria_columns(3), encoding="ascii")]
    packed = [compressed(gaussians(300)), compressed(gaussians(5, degree=1), degree=1)]
    motion = {"times_s": np.zeros(2), "positions": np.zeros((2, 5, 3), np.float32)}
    motion["deformation_gradients"] = np.zeros((2, 5, 3, 3), np.float32)
    answers = [json.dumps(ANSWER).encode(), ANSWER_IN_PROSE]
    return {
        "ply": Target(".ply", plain, load_gaussians),
        "compressed": Target(".ply", packed, load_gaussians),
        "splat": Target(".splat", [splat_bytes()], load_gaussians),
        "labels": Target(
            ".npz",
            [archive(labels=labels, names=names), archive(np.savez_compressed, labels=labels.astype(np.uint8))],
            lambda path: parts_from_file(path, 12),
        ),
        "labels_npy": Target(".npy", [npy(labels)], lambda path: parts_from_file(path, 12)),
        "maps": Target(
            ".npz",
            [archive(masks=maps), archive(np.savez_compressed, masks=maps)],
            lambda path: read_label_maps(path, cameras=[camera] * 2),
        ),
        "trajectory": Target(
            ".npz",
            [archive(**motion)],
            read_trajectory,
        ),
        "scene": Target(".yaml", [dump_scene(Scene(input=Path("a.splat"))).encode(), SCENE], load_scene),
        "materials": Target(".yaml", [MATERIALS], read_materials),
        "answer": Target(".txt", answers, lambda path: read_answer(path.read_text("utf-8", "replace"), "AB")),
        "png": Target(".png", [image("PNG", "RGBA"), image("PNG", "P"), image("PNG", "I;16")], read_picture),
        "jpeg": Target(".jpg", [image("JPEG", "RGB"), image("JPEG", "CMYK")], read_picture),
        "webp": Target(".webp", [image("WEBP", "RGBA")], read_picture),
    }


def gaussians(count: int, *, degree: int = 0) -> Gaussians:
    """Some Gaussians."""
    rng = np.random.default_rng(0)
    quats = rng.normal(size=(count, 4))
    return Gaussians(
        means=rng.normal(size=(count, 3)).astype(np.float32),
        quats_wxyz=(quats / np.linalg.norm(quats, axis=1, keepdims=True)).astype(np.float32),
        scales=np.exp(rng.normal(-4, 1, (count, 3))).astype(np.float32),
        opacities=rng.uniform(0.1, 0.9, count).astype(np.float32),
        sh=rng.normal(0, 0.5, (count, (degree + 1) ** 2, 3)).astype(np.float32),
    )


def splat_bytes() -> bytes:
    """A .splat of five Gaussians."""
    rng = np.random.default_rng(1)
    row = np.zeros(5, [("f", "<f4", 6), ("u", "u1", 8)])
    row["f"], row["u"] = rng.uniform(0.1, 1, (5, 6)), rng.integers(1, 255, (5, 8))
    return row.tobytes()


def npy(array: np.ndarray[Any, Any]) -> bytes:
    """A .npy file."""
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def archive(save: Callable[..., None] = np.savez, **arrays: np.ndarray[Any, Any]) -> bytes:
    """A .npz file."""
    stream = io.BytesIO()
    save(stream, **arrays)
    return stream.getvalue()


def image(kind: str, mode: str) -> bytes:
    """A small picture."""
    stream = io.BytesIO()
    ramp = Image.linear_gradient("L").resize((24, 16))
    ramp.convert("I;16" if mode == "I;16" else mode).save(stream, kind)
    return stream.getvalue()


SCENE = b"""input: a.splat
up: [0, 1, 0]
parts:
  pot: {hold: fixed, thickness_m: 1e-3}
forces:
  - {kind: acceleration, part: leaves, value_ms2: [3, 0, 0], from_s: 0.0, to_s: 0.3}
simulation: {grid: 64, duration_s: 2.0}
grouping: {names: {0: pot}, edits: [{merge: [a, b]}]}
"""
MATERIALS = b"""parts:
  pot:
    surface: {name: ceramic, law: neo_hookean, density_kgm3: 2000, youngs_modulus_pa: 1e9, poisson_ratio: 0.2}
    interior: {name: soil, density_kgm3: 1.2e+3, youngs_modulus_pa: 1.0e6, poisson_ratio: 0.3, source: user}
  leaves:
    surface: {name: leaf, thickness_m: 0.0008}
"""
ANSWER = {
    "object": "a plant",
    "height_m": {"min": 0.2, "max": 0.5, "best": 0.3},
    "parts": [
        {
            "letter": letter,
            "name": "pot",
            "surface": {"material": "ceramic", "density_kgm3": 2000, "youngs_modulus_pa": 1e9, "poisson_ratio": 0.2},
            "interior": {
                "material": "soil",
                "density_kgm3": "1.2 g/cm3",
                "youngs_modulus_pa": 1e6,
                "poisson_ratio": 0.3,
            },
        }
        for letter in "AB"
    ],
}
ANSWER_IN_PROSE = b"Here it is:\n```json\n" + json.dumps(ANSWER, indent=1).encode() + b"\n```\nBest wishes"


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--reader")
    parser.add_argument("--minutes", type=float, default=0.2)
    parser.add_argument("--keep", type=Path, default=Path(tempfile.gettempdir()) / "phys4dgen_fuzz")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    sys.exit(main(chosen.reader, minutes=chosen.minutes, keep=chosen.keep, seed=chosen.seed))
