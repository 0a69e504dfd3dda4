"""How still a run stands: every Gaussian's displacement from the capture, as shares of the height.

    phys4dgen generate plant.splat --up=-y --height-m .35 --motion rest --gravity on --hold part_0 --hold part_1 -o RUN
    python benchmarks/prestress.py RUN

The aim of the fifth issue: under `gravity: on`, with prestress, less than 0.5 % in 2 s.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

_AIM = 0.005


def main() -> None:
    """Read the run folder and print its figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, nargs="?", help="run folder with a trajectory; without it nothing is judged")
    options = parser.parse_args()
    if options.run is None:
        print("skipped: name a run folder, python benchmarks/prestress.py RUN")
        return
    motion = np.load(options.run / "trajectory.npz", allow_pickle=False)
    facts = json.loads((options.run / "motion.json").read_text("utf-8"))
    up = np.array(json.loads((options.run / "views" / "cameras.json").read_text("utf-8"))["up"])
    positions = motion["positions"]
    heights = positions[0] @ up
    lower, upper = np.percentile(heights, [0.5, 99.5])
    moved = np.linalg.norm(positions - positions[0], axis=2) / (upper - lower)
    for time_s, now in zip(motion["times_s"][::8], moved[::8], strict=True):
        middle, most, largest = np.percentile(now, [50, 99, 100])
        print(f"{time_s:6.3f} s: median {middle:.4%}, 99th percentile {most:.4%}, largest {largest:.4%} of the height")
    print(f"all: 99th percentile {np.percentile(moved.max(0), 99):.3%}, largest {moved.max():.3%}; aim {_AIM:.1%}")
    print(f"prestress: {facts.get('prestress')}")


if __name__ == "__main__":
    main()
