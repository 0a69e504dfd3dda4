"""Judge the motion in a run folder by the figures of a right sway (Done-when of the first issue, MOTION.md).

    python benchmarks/judge_motion.py RUN [--axis y --moving-below 0.1 --still-above 0.27]

Prints: displacement of what moves (99th percentile and largest, share of the height) and of what must not; what is left
of the displacement after the best affine fit; frequency and damping ratio of the tip after the gust; and how far the
edges of the 8-neighbour graph of Gaussians inside one part grow, and how rough their F is.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from phys4dgen.formats import load_gaussians
from phys4dgen.motion import damped_frequency


def main() -> None:
    """Read the run folder and print its figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, nargs="?", help="run folder with a trajectory; without it nothing is judged")
    parser.add_argument("--axis", choices="xyz", default="y", help="input axis that tells moving from still")
    parser.add_argument("--moving-below", type=float, help="Gaussians with a smaller coordinate should move")
    parser.add_argument("--still-above", type=float, help="Gaussians with a larger coordinate should not")
    options = parser.parse_args()
    if options.run is None:
        print("skipped: name a run folder, python benchmarks/judge_motion.py RUN")
        return

    gaussians = load_gaussians(options.run / "gaussians.ply")
    groups = np.load(options.run / "groups.npz", allow_pickle=False)
    motion = np.load(options.run / "trajectory.npz", allow_pickle=False)
    cameras = json.loads((options.run / "views" / "cameras.json").read_text("utf-8"))
    continuum = np.load(options.run / "continuum.npz", allow_pickle=False)
    times, positions = motion["times_s"], motion["positions"]
    rest, up = gaussians.means, np.array(cameras["up"])
    lower, upper = np.percentile(rest[gaussians.opacities > 0.02] @ up, [0.5, 99.5])
    height = upper - lower
    across = rest[:, "xyz".index(options.axis)]
    moving = np.ones(len(rest), bool) if options.moving_below is None else across < options.moving_below
    still = np.zeros(len(rest), bool) if options.still_above is None else across > options.still_above

    size = np.stack([np.linalg.norm(frame - rest, axis=1) for frame in positions])
    largest = size.max(0)
    print(f"moving: 99th percentile {np.percentile(largest[moving], 99) / height:.3f} of the height", end=", ")
    print(f"largest {largest[moving].max() / height:.3f}")
    if still.any():
        print(f"still: largest {largest[still].max() / height:.5f} of the height")
    print(f"not jelly: residual after the best affine fit {_affine_residual(rest, positions, moving):.3f} of the RMS")
    heights = rest @ up
    top = (gaussians.opacities > 0.3) & (heights > np.percentile(heights[gaussians.opacities > 0.3], 98))
    _report_swing("top", times, (positions - rest)[:, top].mean(1), options.run)
    # Where the top is stiff (the upright blades of a palm), what is seen to swing is elsewhere.
    _report_swing("what swings far", times, _weighted(positions, rest, largest**2 * moving), options.run)
    _report_tips(times, positions, rest, moving & (gaussians.opacities > 0.3), 0.04 * height, options.run)
    unit = float(cameras["metres_per_unit"])
    spacing = float(continuum["spacing_m"]) / unit
    _report_edges("Gaussians", rest, groups["labels"], positions, spacing, visible=gaussians.opacities > 0.1)
    _report_roughness(
        rest, groups["labels"], motion["deformation_gradients"], largest, visible=gaussians.opacities > 0.1
    )
    print(f"particles: {len(continuum['positions'])}")


def _affine_residual(rest, positions, moving) -> float:
    """Median over the livelier half of the frames of RMS(displacement - affine fit) / RMS(displacement)."""
    basis = np.column_stack([rest[moving], np.ones(moving.sum())]).astype(np.float64)
    inverse = np.linalg.pinv(basis)
    rms, left = [], []
    for frame in positions:
        displacement = (frame - rest)[moving].astype(np.float64)
        rms.append(np.sqrt((displacement**2).mean()))
        left.append(np.sqrt(((displacement - basis @ (inverse @ displacement)) ** 2).mean()))
    rms, left = np.array(rms), np.array(left)
    lively = rms > 0.5 * rms.max()
    return float(np.median(left[lively] / rms[lively]))


def _weighted(positions, rest, weights):
    """Mean displacement per frame, [T, 3]."""
    return np.stack([weights @ (frame - rest).astype(np.float64) for frame in positions]) / weights.sum()


def _swing(times, mean, run: Path) -> tuple[float, float, float]:
    """Frequency, damping ratio and RMS of a mean displacement [T, 3] after the gust, along its main direction."""
    facts = json.loads((run / "motion.json").read_text("utf-8"))
    mean = mean.astype(np.float64)
    _, _, axes = np.linalg.svd(mean - mean.mean(0), full_matrices=False)
    signal = (mean @ axes[0])[times > facts["gust_s"]]
    return *damped_frequency(signal, times[1] - times[0]), float(signal.std())


def _report_swing(what: str, times, mean, run: Path) -> None:
    frequency, ratio, _ = _swing(times, mean, run)
    print(f"{what}: {frequency:.2f} Hz, damping ratio {ratio:.3f}")


def _report_tips(times, positions, rest, chosen, side: float, run: Path) -> None:
    """The liveliest small places, each by itself: the mean of leaves that swing at several frequencies dies out early.

    Places are cubes of ``side``; the 30 with the largest motion after the gust are fitted.
    """
    facts = json.loads((run / "motion.json").read_text("utf-8"))
    places = np.floor(rest[chosen] / side).astype(np.int64)
    _, number, counts = np.unique(places, axis=0, return_inverse=True, return_counts=True)
    number = number.ravel()
    means = np.stack(
        [
            np.stack([np.bincount(number, (frame - rest)[chosen][:, axis]) for axis in range(3)], 1) / counts[:, None]
            for frame in positions
        ]
    )
    motion = means[times > facts["gust_s"]].std(0)
    motion = np.where(counts >= 10, np.linalg.norm(motion, axis=1), 0)
    order = np.argsort(-motion)
    _report_swing("the tip, where it swings farthest", times, means[:, order[0]], run)
    fits = np.array([_swing(times, means[:, place], run)[:2] for place in order[:30]])
    low, middle, high = np.percentile(fits, [25, 50, 75], axis=0)
    print(
        f"30 liveliest tips, each fitted by itself: {middle[0]:.2f} Hz ({low[0]:.2f}-{high[0]:.2f}), "
        f"damping ratio {middle[1]:.3f} ({low[1]:.3f}-{high[1]:.3f}); median and quartiles"
    )


def _edges(rest, labels, index) -> tuple[np.ndarray, np.ndarray]:
    """Starts and ends of the 8-neighbour graph within one part, places in ``index``."""
    points = rest[index].astype(np.float64)
    starts, ends = [], []
    for label in np.unique(labels[index]):
        own = np.flatnonzero(labels[index] == label)
        if len(own) > 8:
            _, near = cKDTree(points[own]).query(points[own], k=9)
            starts.append(np.repeat(own, 8))
            ends.append(own[near[:, 1:]].ravel())
    return np.concatenate(starts), np.concatenate(ends)


def _report_edges(what: str, rest, labels, positions, spacing: float, *, visible) -> None:
    """How many edges of the 8-neighbour graph within one part grow by more than half of max(length, spacing)."""
    index = np.flatnonzero(visible)
    points = rest[index].astype(np.float64)
    start, end = _edges(rest, labels, index)
    length = np.linalg.norm(points[start] - points[end], axis=1)
    allowed = 0.5 * np.maximum(length, spacing)
    worst = np.zeros(len(length))
    for frame in positions:
        moved = frame[index]
        worst = np.maximum(worst, np.linalg.norm(moved[start] - moved[end], axis=1) - length)
    torn = worst > allowed
    limit = (worst / allowed).max()
    print(f"edges between {what}: {torn.sum()} of {len(torn)} grow too far; worst {limit:.2f} of what is allowed")


def _report_roughness(rest, labels, gradients, largest, *, visible) -> None:
    """How much F differs between neighbours that move: mean over edges of the Frobenius norm, in the livest frame."""
    index = np.flatnonzero(visible & (largest > 0.1 * np.percentile(largest, 99)))
    start, end = _edges(rest, labels, index)
    mean = [np.linalg.norm(f[index[start]] - f[index[end]], axis=(1, 2)).mean() for f in gradients]
    stretch = np.linalg.svd(gradients[int(np.argmax(mean))][index], compute_uv=False)
    low, high = np.percentile(stretch, [0.1, 99.9])
    print(
        f"roughness of F between neighbours: {max(mean):.4f}; singular values {low:.3f} to {high:.3f} (99.8 % of them)"
    )


if __name__ == "__main__":
    main()
