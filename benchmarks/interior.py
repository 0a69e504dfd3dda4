"""How well the inside is found: analytic shapes, and three meshes by others from their splats alone.

    python benchmarks/interior.py

Shapes: IoU of half-full cells on a grid of 32 cells a side, and volume against the truth. Meshes: recall of the cells
that lie inside and hold no Gaussian, share of particles outside, IoU. Exit code 1 when a figure misses its limit.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from phys4dgen.formats import load_gaussians
from phys4dgen.interior import Interior, discover_interior
from phys4dgen.render.cameras import view_cameras
from phys4dgen.render.views import render_views
from phys4dgen.types import Frame, Gaussians, Parts, rotation_to_z_up

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))
from interior_shapes import SHAPES, occupancy  # noqa: E402

MESHES = ROOT.parent / "shared" / "data" / "interior"
LIMITS = {
    "sphere": (0.95, 0.05),
    "box": (0.95, 0.05),
    "torus": (0.90, 0.12),
    "cup": (0.90, 0.12),
    "snowman": (0.93, 0.05),
    "stem and bulb": (0.88, 0.12),
}


def filled(gaussians: Gaussians, up: np.ndarray, grid: int) -> Interior:
    """The inside of one part, at one metre per unit."""
    rotation = rotation_to_z_up(up)
    lower, upper = gaussians.robust_bounds(rotation=rotation)
    views = render_views(gaussians, view_cameras("carve", lower=lower, upper=upper, rotation=rotation, size_px=640))
    parts = Parts(np.zeros(len(gaussians), np.int32), ("all",), "none")
    cell = float((upper - lower).max()) / grid
    return discover_interior(gaussians, views, parts, frame=Frame(rotation, 1.0), cell=cell)


def main() -> int:
    """Print the table; 1 when a limit is missed."""
    missed = False
    for name, make in SHAPES.items():
        shape = make()
        body = filled(shape.gaussians(0.02), np.array([0, 0, 1.0]), 48).continuum
        iou = occupancy(body.positions, body.volume_m3, shape, spacing=body.spacing_m)
        volume = float(body.volume_m3.sum()) / shape.volume
        fine = iou >= LIMITS[name][0] and abs(volume - 1) <= LIMITS[name][1]
        missed |= not fine
        print(f"{name:14} IoU {iou:.3f}  volume {volume:.3f}{'' if fine else '  MISSED'}", flush=True)
    if not MESHES.is_dir():
        print("meshes skipped: the folder of real test data (../shared/data) is not here")
    for path in sorted(MESHES.glob("[!h]*_10k.splat")):
        name = path.name.removesuffix("_10k.splat")
        body = filled(load_gaussians(path), np.array([0, 1.0, 0]), 64).continuum
        truth = np.load(MESHES / f"{name}_interior32.npz", allow_pickle=False)
        inside, surface, step = truth["inside"].ravel(), truth["surface"].ravel(), float(truth["side"]) / 32
        place = np.floor(body.positions / step + 16).astype(int)
        cell = np.ravel_multi_index(tuple(np.clip(place, 0, 31).T), (32,) * 3)
        share = np.bincount(cell, body.volume_m3, minlength=32**3) / step**3
        recall = float((share > 0)[inside & ~surface].mean())
        outside = float(1 - (inside | surface)[cell].mean())
        iou = float(((share >= 0.5) & inside).sum() / ((share >= 0.5) | inside).sum())
        fine = recall >= 0.95 and outside <= 0.05 and iou >= 0.85
        missed |= not fine
        print(
            f"{name:14} recall {recall:.3f}  outside {outside:.3f}  IoU {iou:.3f}{'' if fine else '  MISSED'}",
            flush=True,
        )
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
