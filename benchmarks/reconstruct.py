"""Pictures to Gaussians: fidelity of the front, holes, size and seconds of the stand-in, picture by picture.

Holes are pixels with alpha < 0.95 inside the own silhouette (alpha > 0.5, closed by 3 px, eroded by 2 px) over 29
views; walls are the same with the Gaussians that face the camera alone. The front is compared with the cut-out on
white, whole picture and inside its mask. All views are 512 px wide. Exit code 1 when a figure misses its limit.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
import scipy.ndimage as nd
from PIL import Image

from phys4dgen.reconstruct.foreground import cut_out
from phys4dgen.reconstruct.framing import framed
from phys4dgen.reconstruct.inflate import inflate
from phys4dgen.reconstruct.reconstruction import Reconstruction
from phys4dgen.render.cameras import orbit_camera
from phys4dgen.render.views import render_gaussians, render_views
from phys4dgen.types import Camera, Gaussians, rotation_to_z_up
from phys4dgen.types.gaussians import rotation_from_quats

IMAGES = Path(__file__).resolve().parents[2] / "shared/data/images"
UPRIGHT = rotation_to_z_up(np.array([0.0, 1.0, 0.0]))
VIEWS = [(360 / 17 * k, 0) for k in range(17)] + [(45 * k, 30) for k in range(8)] + [(90 * k, -20) for k in range(4)]
SHEET = [*((45 * k, 8) for k in range(8)), (0, 89), (0, -89)]
LIMITS = "limits: PSNR 27 (23 in mask), IoU .98, holes .5 / 1.2 %, walls 1 %, 130,000 Gaussians, 10 s"


def orbit(gaussians: Gaussians, directions: list[tuple[float, float]], size_px: int) -> list[Camera]:
    """Cameras round an object."""
    lower, upper = gaussians.robust_bounds(rotation=UPRIGHT)
    return [
        orbit_camera(
            azimuth_deg=azimuth,
            elevation_deg=elevation,
            target=(lower + upper) / 2 @ UPRIGHT,
            rotation=UPRIGHT,
            radius=float(np.linalg.norm(upper - lower)) / 2 / np.tan(np.radians(15)),
            fovy_deg=30,
            width=size_px,
            height=size_px,
        )
        for azimuth, elevation in directions
    ]


def hole_share(alpha: np.ndarray) -> float:
    """Share of the object's inner pixels that are not opaque, percent."""
    inner = nd.binary_erosion(nd.binary_closing(alpha > 0.5, iterations=3), iterations=2)
    return 100 * float((inner & (alpha < 0.95)).sum() / max(inner.sum(), 1))


def figures(made: Reconstruction, target_rgba: np.ndarray) -> dict[str, float]:
    """All that is measured of one picture."""
    camera, size = made.camera, len(target_rgba)
    assert camera is not None
    K = np.diag([size / camera.width, size / camera.height, 1]) @ camera.K
    front = render_gaussians(made.gaussians, Camera(viewmat=camera.viewmat, K=K, width=size, height=size))
    target = target_rgba[..., :3] * target_rgba[..., 3:] + 1 - target_rgba[..., 3:]
    inside = target_rgba[..., 3] > 0.5
    error = (np.clip(front.rgb, 0, 1) - target) ** 2
    shown = front.alpha > 0.5
    cameras = orbit(made.gaussians, VIEWS, 512)
    holes = [hole_share(alpha) for alpha in render_views(made.gaussians, cameras).alpha]
    normals = rotation_from_quats(made.gaussians.quats_wxyz)[:, :, 2]
    walls = []
    for view in cameras:
        facing = ((view.position - made.gaussians.means) * normals).sum(1) > 0
        walls.append(hole_share(render_gaussians(made.gaussians.subset(facing), view).alpha))
    return {
        "psnr": -10 * np.log10(error.mean()),
        "psnr_mask": -10 * np.log10(error[inside].mean()),
        "iou": (shown & inside).sum() / (shown | inside).sum(),
        "holes": float(np.mean(holes)),
        "worst": float(np.max(holes)),
        "walls": float(np.mean(walls)),
    }


def contact_sheet(made: Reconstruction, size_px: int = 140) -> np.ndarray:
    """8 azimuths, top and bottom side by side."""
    views = render_views(made.gaussians, orbit(made.gaussians, SHEET, 2 * size_px))
    pairs = views.rgb.reshape(len(SHEET), size_px, 2, size_px, 2, 3).mean((2, 4))
    return np.concatenate(list(np.rint(np.clip(pairs, 0, 1) * 255).astype(np.uint8)), 1)


def main() -> int:
    """Print one line per picture; 1 if a limit is missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--images", type=Path, default=IMAGES)
    parser.add_argument("--matte-model", type=Path, default=IMAGES.parent / "weights/isnet_small.onnx")
    parser.add_argument("--sheet", type=Path, help="write a contact sheet of all pictures there")
    arguments = parser.parse_args()
    if not arguments.images.is_dir():
        print("reconstruct: no pictures, skipped")
        return 0
    print(f"reconstruct: {LIMITS}")
    missed, rows = False, []
    for path in sorted(arguments.images.iterdir()):
        if path.stem.endswith("_mask") or path.suffix not in (".png", ".jpg"):
            continue
        mask = path.with_name(path.name.replace("_image", "_mask"))
        options = {"mask": mask} if mask.is_file() and mask != path else {}
        if not options and path.suffix == ".jpg" and arguments.matte_model.is_file():
            options = {"matte_model": arguments.matte_model}
        cutout = cut_out(path, **options)
        if not rows:
            inflate(cutout)  # compiles the kernels
        start = time.perf_counter()
        made = inflate(cutout)
        seconds = time.perf_counter() - start
        f = figures(made, framed(cutout.rgba, 512))
        print(
            f"  {path.stem:<18} PSNR {f['psnr']:.1f} ({f['psnr_mask']:.1f} in mask), IoU {f['iou']:.3f}, "
            f"holes {f['holes']:.2f} / {f['worst']:.2f} %, walls {f['walls']:.2f} %, "
            f"{len(made.gaussians):,} Gaussians, "
            f"{seconds:.1f} s",
            flush=True,
        )
        missed |= f["psnr"] < 27 or f["psnr_mask"] < 23 or f["iou"] < 0.98 or len(made.gaussians) > 130_000
        missed |= f["holes"] > 0.5 or f["worst"] > 1.2 or f["walls"] > 1 or seconds > 10
        rows.append(contact_sheet(made))
    if arguments.sheet is not None:
        Image.fromarray(np.concatenate(rows)).save(arguments.sheet)
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
