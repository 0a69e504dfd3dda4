"""Well-spaced particles beside one particle per Gaussian: how many they are, and how rough the F is that they give.

    python benchmarks/particles.py OUT plant.splat --up=-y --height-m .35 --hold part_0 --hold part_1

Two short runs of `sway` on one splat, `particles: auto` and `particles: gaussians`, no opacity cut. Printed: the
particles of parts that are not held, how far the Gaussians move (99th percentile, share of the height), and the
roughness of F: the mean over edges of the 8-neighbour graph of visible Gaussians inside one part, of those that move in
both runs, of the Frobenius norm of the difference of F, in each run's livest frame. Beside it the same of S, F = R S:
the rotation R turns from place to place wherever something bends. And how much is noise: the mean distance of F from a
linear function fitted to it and to its 16 neighbours, scaled so that noise alone would give the roughness. Parts of 16
or fewer such Gaussians are left out. Exit code 1 when `auto` takes more than a sixth of the particles or has more than
a quarter of the roughness (fifth issue). Finished runs in OUT are kept.

The second limit is missed: `gaussians` is smooth here, though each Gaussian that is a particle has its own F. On
plant.splat, the first 0.4 s, and 2 s:

    48 cells, .4 s: auto      6,781 particles, roughness 0.00051, of S 0.00014, noise 0.00018
                    gaussians 68,260           0.00049,      0.00024,       0.00017
    64 cells, .4 s: auto      11,207           0.00032,      0.00008,       0.00013
                    gaussians 68,249           0.00018,      0.00009,       0.00009
    64 cells, 2 s:  gaussians as above         0.00023,      0.00012,       0.00012

Most of what `auto` has is rotation: the plant's stalks bend, and no particles can be four times smoother than that.
The limit was set from a prototype (0.0037 and 0.0194) whose leaves stretched by 7 to 10 %, and whose Gaussians did not
share the volume of what they lie in evenly.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from phys4dgen.formats import load_gaussians

FEWER, SMOOTHER = 6.0, 4.0
_VISIBLE = 0.1
_JOINED, _FITTED = 8, 16  # neighbours whose F is compared, and those it is fitted over
_MOVES = 0.1  # of the 99th percentile of the displacements


def main() -> int:
    """Make the two runs and compare them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, nargs="?", help="folder for the runs; without it nothing is run")
    parser.add_argument("splat", nargs="?", help="the capture")
    parser.add_argument("--grid", type=int, default=64, help="cells along the longest side (default: 64)")
    parser.add_argument("--duration-s", type=float, default=0.4, help="of the films (default: 0.4)")
    parser.add_argument("--hold", action="append", default=[], metavar="PART", help="parts that are held")
    options, more = parser.parse_known_args()
    if options.out is None or options.splat is None:
        print("skipped: name a folder and a splat, python benchmarks/particles.py OUT plant.splat")
        return 0
    options.out.mkdir(parents=True, exist_ok=True)
    runs = {}
    for particles in ("auto", "gaussians"):
        run = runs[particles] = options.out / particles
        if not (run / "trajectory.npz").is_file():
            command = [sys.executable, "-m", "phys4dgen", "generate", options.splat, "-o", str(run), "--overwrite"]
            command += ["--motion", "sway", "--until", "simulate", "--interior.particles", particles]
            command += ["--grid", str(options.grid), "--duration-s", str(options.duration_s), *more]
            subprocess.run([*command, *(f"--hold={part}" for part in options.hold)], check=True)
    motions = {name: np.load(run / "trajectory.npz", allow_pickle=False) for name, run in runs.items()}
    farthest = {name: _farthest(motion["positions"]) for name, motion in motions.items()}
    own, near = _neighbours(runs["auto"], list(farthest.values()))
    means = load_gaussians(runs["auto"] / "gaussians.ply").means
    counts, rough = {}, {}
    for name, run in runs.items():
        parts = json.loads((run / "report.json").read_text("utf-8"))["parts"]
        counts[name] = sum(part["particles"] for part in parts if part["name"] not in options.hold)
        gradients = motions[name]["deformation_gradients"]
        by_frame = [_roughness(frame, own, near) for frame in gradients]
        rough[name] = max(by_frame)
        livest = gradients[int(np.argmax(by_frame))]
        stretch = _roughness(_stretch(livest), own, near)
        noise = _noise(livest, means, own, near)
        print(
            f"{name}: {counts[name]} particles that may move; Gaussians move by "
            f"{np.percentile(farthest[name], 99) / _height(run):.3f} of the height, roughness of F {rough[name]:.5f}, "
            f"of S {stretch:.5f}, noise {noise:.5f}"
        )
    fewer, smoother = counts["gaussians"] / counts["auto"], rough["gaussians"] / rough["auto"]
    print(
        f"auto: {fewer:.1f} times fewer particles (at least {FEWER:g}), F {smoother:.1f} times smoother ({SMOOTHER:g})"
    )
    return int(fewer < FEWER or smoother < SMOOTHER)


def _farthest(positions) -> np.ndarray:
    return np.stack([np.linalg.norm(frame - positions[0], axis=1) for frame in positions]).max(0)


def _height(run: Path) -> float:
    up = np.array(json.loads((run / "views" / "cameras.json").read_text("utf-8"))["up"])
    gaussians = load_gaussians(run / "gaussians.ply")
    return float(np.ptp(np.percentile(gaussians.means[gaussians.opacities > 0.02] @ up, [0.5, 99.5])))


def _neighbours(run: Path, farthest: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Gaussians that are seen and move in all runs, [n], and the 16 of them nearest to each in its part, [n, 16]."""
    gaussians, labels = load_gaussians(run / "gaussians.ply"), np.load(run / "groups.npz", allow_pickle=False)["labels"]
    chosen = gaussians.opacities > _VISIBLE
    for moved in farthest:
        chosen &= moved > _MOVES * np.percentile(moved, 99)
    every, around = [], []
    for label in np.unique(labels[chosen]):
        own = np.flatnonzero(chosen & (labels == label))
        if len(own) > _FITTED:
            points = gaussians.means[own].astype(np.float64)
            _, near = cKDTree(points).query(points, k=_FITTED + 1)
            every.append(own)
            around.append(own[near[:, 1:]])
    return np.concatenate(every), np.concatenate(around)


def _roughness(gradients: np.ndarray, own: np.ndarray, near: np.ndarray) -> float:
    """Mean difference of F [N, 3, 3] along the edges of the graph."""
    return float(np.linalg.norm(gradients[own][:, None] - gradients[near[:, :_JOINED]], axis=(2, 3)).mean())


def _stretch(gradients: np.ndarray) -> np.ndarray:
    """S of F = R S, [N, 3, 3]."""
    _, values, axes = np.linalg.svd(gradients.astype(np.float64))
    return np.swapaxes(axes, 1, 2) @ (values[:, :, None] * axes)


def _noise(gradients: np.ndarray, means: np.ndarray, own: np.ndarray, near: np.ndarray) -> float:
    """Mean distance of F from its linear fit over a Gaussian and its neighbours, as roughness that noise would have."""
    each = np.concatenate([own[:, None], near], 1)
    steps = means[each] - means[own][:, None]
    steps /= np.sqrt((steps**2).sum(2).mean(1))[:, None, None]
    at_itself = np.linalg.pinv(np.concatenate([np.ones((*steps.shape[:2], 1)), steps], 2), rcond=1e-2)[:, 0]
    fitted = np.einsum("nk,nkab->nab", at_itself, gradients[each])
    apart = np.linalg.norm(gradients[own] - fitted, axis=(1, 2))
    own_share = at_itself[:, 0]  # of a Gaussian in its own fit; variances: 2 of a difference, 1 - share of a residual
    return float((apart * np.sqrt(2 / (1 - own_share))).mean())


if __name__ == "__main__":
    sys.exit(main())
