"""Time to read and write splat files, and to turn spherical harmonics: ``python benchmarks/formats.py``.

Best of several runs on 100,000 Gaussians of SH degree 3; plain NumPy copying the same bytes is the yardstick.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from phys4dgen.export.trajectory import read_trajectory, trajectory_writer
from phys4dgen.formats import PlyFrameWriter, load_gaussians, save_gaussians, write_splat
from phys4dgen.render.sh_rotation import rotate_sh
from phys4dgen.types import Gaussians, rotation_from_quats

COUNT = 100_000
RUNS = 5


def best_ms(work: Callable[[], object]) -> float:
    """Milliseconds of the fastest of RUNS runs."""
    times = []
    for _ in range(RUNS):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return 1000 * min(times)


def random_gaussians() -> Gaussians:
    """COUNT Gaussians of SH degree 3."""
    rng = np.random.default_rng(0)
    quats = rng.normal(size=(COUNT, 4))
    return Gaussians(
        means=rng.normal(size=(COUNT, 3)).astype(np.float32),
        quats_wxyz=(quats / np.linalg.norm(quats, axis=1, keepdims=True)).astype(np.float32),
        scales=np.exp(rng.normal(-4, 1, size=(COUNT, 3))).astype(np.float32),
        opacities=rng.uniform(size=COUNT).astype(np.float32),
        sh=rng.normal(size=(COUNT, 16, 3)).astype(np.float32),
    )


def main() -> None:
    """Print one line per measurement."""
    gaussians = random_gaussians()
    rotations = rotation_from_quats(gaussians.quats_wxyz)
    gradients = rotations.astype(np.float32)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        ply, splat, plain, motion = (folder / file for file in ("a.ply", "a.splat", "a.bin", "a.npz"))
        writer = PlyFrameWriter(gaussians)
        pose = {"means": gaussians.means, "quats_wxyz": gaussians.quats_wxyz, "scales": gaussians.scales}

        def write_trajectory() -> None:
            with trajectory_writer(motion, times_s=np.arange(10.0), gaussian_count=COUNT) as append:
                for _ in range(10):
                    append(gaussians.means, gradients)

        table = np.zeros((COUNT, 62), np.float32)
        for what, work in (
            ("write the bytes of a PLY (NumPy tofile)", lambda: table.tofile(plain)),
            ("read them (NumPy fromfile)", lambda: np.fromfile(plain, np.float32)),
            ("write PLY", lambda: save_gaussians(gaussians, ply)),
            ("write a frame PLY, SH unchanged", lambda: writer.write(ply, **pose)),
            ("write a frame PLY, SH turned", lambda: writer.write(ply, **pose, sh_rest=gaussians.sh[:, 1:])),
            ("read PLY", lambda: load_gaussians(ply)),
            ("write .splat", lambda: write_splat(gaussians, splat)),
            ("read .splat", lambda: load_gaussians(splat)),
            ("rotate SH of degree 3", lambda: rotate_sh(gaussians.sh, rotations)),
            ("write a trajectory of 10 frames", write_trajectory),
            ("read a trajectory of 10 frames", lambda: read_trajectory(motion)),
        ):
            print(f"{what:42s} {best_ms(work):8.1f} ms")


if __name__ == "__main__":
    main()
