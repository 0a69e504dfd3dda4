"""How often the up direction is found: ``python benchmarks/up.py [--captures FOLDER] [--lights]``.

Every bundled object that has an up (a ball has none, and a hammer lies as well as it stands), and three captures where
the folder is given or lies beside the project, in the 24 turns of the axes and tilted by 25 degrees in 24 directions.
Right means within 5 degrees. Exit code 1 where under 80 % are right without a warning, or more than 2 % wrong without
one. ``--lights`` adds evening light, and objects as a capture would hold them, which are not judged.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from phys4dgen.formats import load_gaussians
from phys4dgen.types import Gaussians
from phys4dgen.upright import guess_up
from phys4dgen.zoo.captured import as_captured
from phys4dgen.zoo.catalogue import BUNDLED, bundled

WITHOUT_UP = ("basketball", "hammer")
CAPTURES = ("plant.splat", "ponytail_palm.splat", "guitar.compressed.ply")
CAPTURE_UP = np.array([0.0, -1.0, 0.0])
TILT_DEG = 25.0
RIGHT_DEG = 5.0
LEAST_RIGHT = 0.80
MOST_WRONG = 0.02


class Tally(NamedTuple):
    """Shares of the attempts with one object.

    Attributes:
        right, wrong: without a warning.
        median_deg: error of all attempts.
        seconds: of one attempt.
    """

    right: float
    wrong: float
    median_deg: float
    seconds: float


def main(captures: Path, *, lights: bool) -> int:
    """Print the table."""
    jobs = [(str(captures / name), "", turns) for name in CAPTURES for turns in ("turned", "tilted")]
    jobs = [job for job in jobs if Path(job[0]).is_file()]
    names = [name for name in BUNDLED if name not in WITHOUT_UP]
    judged = len(jobs) + 2 * len(names)
    jobs += [(name, "studio", turns) for name in names for turns in ("turned", "tilted")]
    if lights:
        jobs += [(name, light, "tilted") for name in names for light in ("evening", "as captured")]
    print(f"{'':24}{'':12}{'':8}  right  wrong  median   time")
    print(f"{'':24}{'':12}{'':8}  without warning   error")
    tallies = []
    with ProcessPoolExecutor() as pool:
        for job, tally in zip(jobs, pool.map(attempts, *zip(*jobs, strict=True)), strict=True):
            name = Path(job[0]).name
            row = f"{tally.right:6.0%} {tally.wrong:6.0%} {tally.median_deg:5.1f} deg {tally.seconds:5.2f} s"
            print(f"{name:24}{job[1]:12}{job[2]:8} {row}", flush=True)
            tallies.append(tally)
    right = float(np.mean([tally.right for tally in tallies[:judged]]))
    wrong = float(np.mean([tally.wrong for tally in tallies[:judged]]))
    print(f"captures and studio light: {right:.1%} right and {wrong:.1%} wrong without a warning")
    return 0 if right >= LEAST_RIGHT and wrong <= MOST_WRONG else 1


def attempts(name: str, light: str, turns: str) -> Tally:
    """Guess one object's up in 24 orientations."""
    if Path(name).is_file():
        gaussians, up = load_gaussians(name), CAPTURE_UP
    else:
        thing = bundled(name, light=light if light == "evening" else "studio")
        gaussians, up = thing.gaussians, thing.up
        if light == "as captured":
            gaussians, _ = as_captured(gaussians, thing.labels)
    errors, sure = [], []
    start = time.perf_counter()
    for rotation in axis_turns() if turns == "turned" else tilts(up):
        guess = guess_up(turned(gaussians, rotation))
        errors.append(np.degrees(np.arccos(np.clip(guess.up @ rotation @ up, -1, 1))))
        sure.append(guess.is_sure)
    right = np.array(errors) <= RIGHT_DEG
    return Tally(
        right=float(np.mean(right & sure)),
        wrong=float(np.mean(~right & sure)),
        median_deg=float(np.median(errors)),
        seconds=(time.perf_counter() - start) / len(errors),
    )


def axis_turns() -> Iterator[NDArray[np.float64]]:
    """The 24 rotations that map axes to axes."""
    yield from Rotation.create_group("O").as_matrix().round()


def tilts(up: NDArray[np.float64]) -> Iterator[NDArray[np.float64]]:
    """Tilts by 25 degrees in 24 directions, each with another turn about the vertical."""
    side = np.cross(up, np.roll(up, 1))
    for k in range(24):
        about = Rotation.from_rotvec(np.radians(15 * k) * up).apply(side)
        yield (Rotation.from_rotvec(np.radians(TILT_DEG) * about) * Rotation.from_rotvec(0.7 * k * up)).as_matrix()


def turned(gaussians: Gaussians, rotation: NDArray[np.float64]) -> Gaussians:
    """The Gaussians turned about the origin; of their colour only the constant part."""
    quats = Rotation.from_matrix(rotation) * Rotation.from_quat(np.roll(gaussians.quats_wxyz, -1, axis=1))
    return Gaussians(
        means=(gaussians.means @ rotation.T).astype(np.float32),
        quats_wxyz=np.roll(quats.as_quat(), 1, axis=1).astype(np.float32),
        scales=gaussians.scales,
        opacities=gaussians.opacities,
        sh=gaussians.sh[:, :1],
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--captures", type=Path, default=Path(__file__).parents[1] / "../shared/data/splats")
    parser.add_argument("--lights", action="store_true")
    options = parser.parse_args()
    sys.exit(main(options.captures, lights=options.lights))
