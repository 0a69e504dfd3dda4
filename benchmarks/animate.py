"""Time to animate one frame beside the time to render it.

    python benchmarks/animate.py --splat plant.splat

Particles fill the voxels that hold Gaussians (about as many as the solver has); everything above the lower quarter
bends sideways. Animating and rendering take turns in the same process; the minimum of the repetitions counts. Exit
code 1 when skinning, covariances and rotations together take longer than the picture.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from phys4dgen.animate import Animator, AxisTracker, skin
from phys4dgen.formats import load_gaussians
from phys4dgen.render.cameras import orbit_camera
from phys4dgen.render.rasterise import Rasteriser
from phys4dgen.types import Continuum, Frame, Gaussians, rotation_to_z_up

SHARED = Path(__file__).resolve().parents[2] / "shared"
UP = np.array([0.0, -1.0, 0.0])


def random_gaussians(n: int) -> Gaussians:
    """A cloud to time where no splat is at hand."""
    rng = np.random.default_rng(0)
    quats = rng.normal(size=(n, 4))
    return Gaussians(
        means=rng.uniform(-0.4, 0.4, (n, 3)),
        quats_wxyz=quats / np.linalg.norm(quats, axis=1, keepdims=True),
        scales=0.004 * np.exp(rng.normal(0, 0.5, (n, 3))),
        opacities=rng.uniform(0.05, 0.999, n),
        sh=rng.normal(0, 0.5, (n, 1, 3)),
    )


def particles_in(gaussians: Gaussians, spacing: float) -> Continuum:
    """One particle per voxel that holds an opaque Gaussian, all of one part; one input unit is one metre."""
    opaque = gaussians.means[gaussians.opacities > 0.3].astype(np.float64)
    positions = (np.unique(np.floor(opaque / spacing), axis=0) + 0.5) * spacing
    p = len(positions)
    return Continuum(
        positions=positions,
        part=np.zeros(p, np.int32),
        is_interior=np.zeros(p, bool),
        volume_m3=np.full(p, spacing**3),
        gaussian_index=np.full(p, -1),
        piece=np.zeros(p, np.int32),
        shape=np.zeros(p),
        thickness_m=np.full(p, np.nan),
        thickness_measured=np.zeros(p, bool),
        offset_m=np.zeros((p, 3)),
        site=np.arange(p),
        spacing_m=spacing,
    )


def bent(positions: np.ndarray, amount: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions and F when heights above the lower quarter lean sideways, quadratically, by ``amount``."""
    height = positions @ UP
    base, top = np.percentile(height, [25, 100])
    above = np.clip(height - base, 0, None) / (top - base)
    sideways = np.array([1.0, 0.0, 0.0])
    slope = 2 * amount * above / (top - base)
    return (
        positions + amount * (above**2)[:, None] * sideways,
        np.eye(3) + slope[:, None, None] * np.outer(sideways, UP),
    )


def main() -> int:
    """Print one line per thread count; 1 if animating is slower than rendering."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--splat", type=Path, default=SHARED / "data/splats/plant.splat")
    parser.add_argument("--size-px", type=int, default=512)
    parser.add_argument("--repetitions", type=int, default=10)
    arguments = parser.parse_args()

    if arguments.splat.is_file():
        gaussians, name = load_gaussians(arguments.splat), arguments.splat.name
    else:
        gaussians, name = random_gaussians(113_648), "random cloud"
    lower, upper = gaussians.robust_bounds()
    length = float((upper - lower).max())
    continuum = particles_in(gaussians, length / 110)
    labels = np.zeros(len(gaussians), np.int32)
    frame = Frame(rotation=rotation_to_z_up(UP), metres_per_unit=1.0)
    start = time.perf_counter()
    hung = skin(gaussians, labels, continuum, frame=frame)
    skin_s = time.perf_counter() - start
    print(
        f"animate: {name}, {len(gaussians)} Gaussians on {len(continuum)} particles, skin made once in {skin_s:.2f} s"
    )

    camera = orbit_camera(
        azimuth_deg=15,
        elevation_deg=15,
        target=(lower + upper) / 2,
        rotation=frame.rotation,
        radius=1.6 * length,
        fovy_deg=49.1,
        width=arguments.size_px,
        height=arguments.size_px,
    )
    slower = False
    for threads in (1, 2):
        animator = Animator(gaussians, hung, continuum.positions, threads=threads)
        tracker = AxisTracker(gaussians, threads=threads)
        renderer = Rasteriser(threads=threads)
        times = []
        for k in range(arguments.repetitions + 1):  # the first warms up
            moved, gradient = bent(continuum.positions, 0.1 * length * np.sin(0.4 * k))
            start = time.perf_counter()
            now = animator.frame(moved, gradient)
            animated = time.perf_counter()
            tracker.advance(now.deformation)
            tracked = time.perf_counter()
            renderer.render(
                now.positions,
                now.covariances6,
                gaussians.opacities,
                camera=camera,
                sh=gaussians.sh,
                sh_rotations=now.rotations,
            )
            times.append((animated - start, tracked - animated, time.perf_counter() - tracked))
        animate_ms, axes_ms, render_ms = 1e3 * np.min(times[1:], axis=0)
        print(
            f"  {threads} thread(s): skinning + covariance + rotation {animate_ms:6.1f} ms, "
            f"render {arguments.size_px} px {render_ms:6.1f} ms, ratio {animate_ms / render_ms:.2f}; "
            f"scales and quaternions for export {axes_ms:6.1f} ms"
        )
        slower |= bool(animate_ms > render_ms)
    return int(slower)


if __name__ == "__main__":
    sys.exit(main())
