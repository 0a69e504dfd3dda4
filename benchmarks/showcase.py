"""Figures of showcase films: the flower under f1, f2 and f3, and what is left of the snowman.

    python benchmarks/showcase.py RUNS

RUNS holds the folders that ``scripts/showcase.py RUNS flower_f1 flower_f2 flower_f3 snowman_melts`` fills. Printed:
how far the petals go along x at most; residual of each part of the snowman after the best rigid fit (rms, of the part's
largest extent); how far the body has spread (95 % quantile of the distance from the axis, over that of its lowest 15 %
at rest).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation


def main() -> None:
    """Read the run folders and print their figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, nargs="?", help="folder of run folders; without it nothing is judged")
    options = parser.parse_args()
    if options.runs is None:
        print("skipped: name the folder of the showcase's runs, python benchmarks/showcase.py RUNS")
        return
    moved = {name: _petals(options.runs / f"flower_{name}") for name in ("f1", "f2", "f3")}
    far = {name: float(np.abs(way).max()) for name, way in moved.items()}
    print(f"f2 goes {far['f2'] / far['f1']:.2f} times as far as f1, f3 {far['f3'] / far['f1']:.3f} times the other way")
    print(f"f1 + f3 at the worst instant: {np.abs(moved['f1'] + moved['f3']).max() / far['f1']:.3f} of f1")
    _snowman(options.runs / "snowman_melts")


def _parts(run: Path) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Rest positions [N, 3], moved ones [T, N, 3], and which Gaussians each part has."""
    groups = np.load(run / "groups.npz", allow_pickle=False)
    moved = np.load(run / "trajectory.npz", allow_pickle=False)["positions"].astype(np.float64)
    names = [str(name) for name in groups["names"]]
    return moved[0], moved, {name: groups["labels"] == number for number, name in enumerate(names)}


def _petals(run: Path) -> np.ndarray:
    rest, moved, parts = _parts(run)
    return (moved - rest)[:, parts["petals"], 0].mean(1)


def _snowman(run: Path) -> None:
    rest, moved, parts = _parts(run)
    for name, mine in parts.items():
        before, after = rest[mine] - rest[mine].mean(0), moved[-1][mine] - moved[-1][mine].mean(0)
        _, root = Rotation.align_vectors(after, before)
        size = np.ptp(rest[mine], axis=0).max()
        print(f"{name:6} residual {root / np.sqrt(mine.sum()) / size:.3f}")
    body = parts["body"]
    low = body & (rest[:, 1] < 0.15 * np.ptp(rest[:, 1]))
    before, after = (np.percentile(np.hypot(p[:, 0], p[:, 2]), 95) for p in (rest[low], moved[-1][body]))
    print(f"body spreads {after / before:.1f} times")


if __name__ == "__main__":
    main()
