"""Time of one picture: this renderer and, where its folder is given, the prototype whose speed it must keep.

    python benchmarks/render.py --splat plant.splat --prototype-dir prototypes/raster

Both render the same view (azimuth 15, elevation 15, radius 1.5, fovy 49.1, up -y) in turns in the same process, on
one and on two threads; the minimum of the repetitions counts. Exit code 1 when ours takes more than 1.2 times as long.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import numpy as np

from phys4dgen.formats import load_gaussians
from phys4dgen.render.cameras import orbit_camera
from phys4dgen.render.rasterise import Rasteriser, packed_covariances
from phys4dgen.types import Camera, Gaussians, rotation_to_z_up

LIMIT = 1.2
SHARED = Path(__file__).resolve().parents[2] / "shared"


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


def prototype_renderer(
    folder: Path, gaussians: Gaussians, covariances: np.ndarray, camera: Camera, threads: int
) -> Callable[[], np.ndarray] | None:
    """The prototype's picture of the view, or None where it is not there."""
    if not (folder / "nbrast2.py").is_file():
        return None
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))
    renderer = import_module("nbrast2").Rast(threads=threads, md=1)
    arrays = [np.array(a) for a in (gaussians.means, covariances, gaussians.opacities, gaussians.sh)]
    size = camera.width, camera.height
    return lambda: renderer(*arrays, camera.viewmat, camera.K, *size, bg=(1, 1, 1))[0]


def main() -> int:
    """Print one line per thread count; 1 if too slow."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--splat", type=Path, default=SHARED / "data/splats/plant.splat")
    parser.add_argument("--prototype-dir", type=Path, default=SHARED / "prototypes/raster")
    parser.add_argument("--size-px", type=int, default=512)
    parser.add_argument("--repetitions", type=int, default=10)
    arguments = parser.parse_args()

    if arguments.splat.is_file():
        gaussians, name = load_gaussians(arguments.splat), arguments.splat.name
    else:
        gaussians, name = random_gaussians(100_000), "random cloud"
    covariances = packed_covariances(gaussians.covariances())
    camera = orbit_camera(
        azimuth_deg=15,
        elevation_deg=15,
        target=np.zeros(3),
        rotation=rotation_to_z_up(np.array([0.0, -1.0, 0.0])),
        radius=1.5,
        fovy_deg=49.1,
        width=arguments.size_px,
        height=arguments.size_px,
    )
    print(f"render: {name}, {len(gaussians)} Gaussians, SH degree {gaussians.sh_degree}, {arguments.size_px} px")
    too_slow = False
    for threads in (1, 2):
        rasteriser = Rasteriser(threads)

        def ours(rasteriser: Rasteriser = rasteriser) -> np.ndarray:
            return rasteriser.render(
                gaussians.means, covariances, gaussians.opacities, sh=gaussians.sh, camera=camera, near=0.01
            ).rgb

        start = time.perf_counter()
        picture = ours()
        first_s = time.perf_counter() - start
        candidates = {"ours": ours}
        prototype = prototype_renderer(arguments.prototype_dir, gaussians, covariances, camera, threads)
        if prototype is not None:
            error = float(np.mean((np.clip(prototype(), 0, 1) - np.clip(picture, 0, 1)) ** 2))
            candidates["prototype"] = prototype
        best_s = dict.fromkeys(candidates, np.inf)
        for _ in range(arguments.repetitions):
            for label, run in candidates.items():
                start = time.perf_counter()
                run()
                best_s[label] = min(best_s[label], time.perf_counter() - start)
        line = f"  {threads} thread(s): ours {1e3 * best_s['ours']:.1f} ms (first call {first_s:.2f} s)"
        if prototype is None:
            line += "; prototype not found, skipped"
        else:
            ratio = best_s["ours"] / best_s["prototype"]
            psnr_db = -10 * np.log10(max(error, 1e-20))
            line += f", prototype {1e3 * best_s['prototype']:.1f} ms, ratio {ratio:.2f} (limit {LIMIT}), "
            line += f"pictures agree to {psnr_db:.1f} dB"
            too_slow |= ratio > LIMIT
        print(line)
    return int(too_slow)


if __name__ == "__main__":
    sys.exit(main())
