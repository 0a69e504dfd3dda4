"""The paper's ablation: the hamburger under a plate, with and without material groups, with and without an inside.

    python benchmarks/ablation.py OUT [--force-n 3] [--grid 22]

Four runs under the same force. Without groups everything is bread, as if one material had been named for the whole
object; without inside the parts are skins of one layer of particles. Printed per run: the height that is left under the
plate, and how much the bun and the patty are shortened, as the slope of a line through the heights of their Gaussians
under the plate over those at rest (of the two halves of the bun the mean, weighted by their Gaussians). Exit code 1
when a figure misses its limit. Finished runs in OUT are kept.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import numpy as np

from phys4dgen.formats import load_gaussians

SCENE = """input: hamburger
motion: {{preset: press}}
boundaries:
  - {{kind: ground, below_m: 0, friction: 0.8}}
  - {{kind: plate, force_n: {force_n}, press_s: 0.6, hold_s: 0.4, release_s: null}}
simulation: {{grid: {grid}, duration_s: 1.0, fps: 24}}
output: {{video: {{orbit_deg: 0, elevation_deg: 8}}}}
"""
NO_GROUPS = "parts: {patty: {material: bread}, cheese: {material: bread}, lettuce: {material: bread}}\n"
NO_INSIDE = "interior: {method: none}\n"
VARIANTS = {
    "groups_and_inside": "",
    "no_groups": NO_GROUPS,
    "no_inside": NO_INSIDE,
    "neither": NO_GROUPS + NO_INSIDE,
}
LIMITS = "limits: bun over patty >= 1.5 with groups, 0.8 to 1.25 without; height >= .75 with an inside, <= .6 without"


def main() -> int:
    """Run the four variants and print what the plate does to each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, nargs="?", help="folder for the runs; without it nothing is run")
    parser.add_argument("--force-n", type=float, default=3.0, help="of the plate (default: 3)")
    parser.add_argument("--grid", type=int, default=22, help="cells along the longest side (default: 22)")
    options = parser.parse_args()
    if options.out is None:
        print("skipped: name a folder for the runs, python benchmarks/ablation.py OUT")
        return 0
    options.out.mkdir(parents=True, exist_ok=True)
    missed = False
    for name, more in VARIANTS.items():
        scene = options.out / f"{name}.yaml"
        scene.write_text(SCENE.format(force_n=options.force_n, grid=options.grid) + more, encoding="utf-8")
        run = options.out / name
        if not (run / "video.mp4").is_file():
            command = [sys.executable, "-m", "phys4dgen", "demo", "--scene", str(scene), "-o", str(run), "-q"]
            subprocess.run([*command, "--output.frames", "none"], check=True)
        height, bun, patty = _pressed(run)
        ratio = bun / patty
        right_ratio = 0.8 <= ratio <= 1.25 if NO_GROUPS in more else ratio >= 1.5
        right_height = height <= 0.6 if NO_INSIDE in more else height >= 0.75
        missed = missed or not (right_ratio and right_height)
        print(
            f"{name:20} height {height:.3f}, bun {bun:.3f}, patty {patty:.3f}, bun over patty {ratio:.2f}", flush=True
        )
    print(LIMITS)
    return int(missed)


def _pressed(run: Path) -> tuple[float, float, float]:
    """Height under the plate over that at rest, and the strain of bun and patty."""
    rest = load_gaussians(run / "gaussians.ply").means[:, 1]
    groups = np.load(run / "groups.npz", allow_pickle=False)
    motion = np.load(run / "trajectory.npz", allow_pickle=False)
    pressed = motion["positions"][-1][:, 1]
    extent = [float(np.ptp(np.percentile(y, [0.5, 99.5]))) for y in (rest, pressed)]
    stretches = np.linalg.svd(motion["deformation_gradients"][-1].astype(np.float64), compute_uv=False)
    strain = np.linalg.norm(np.log(np.maximum(stretches, 1e-3)), axis=1)
    names = [str(name) for name in groups["names"]]
    bun, patty = (float(np.median(strain[groups["labels"] == names.index(name)])) for name in ("bun", "patty"))
    return extent[1] / extent[0], bun, patty


if __name__ == "__main__":
    sys.exit(main())
