"""The ``.splat`` format of antimatter15/splat: 32 bytes per Gaussian, no header, no spherical harmonics.

A record holds position (3 float32), linear scale (3 float32), RGBA (4 bytes) and quaternion (w, x, y, z) as 4 bytes,
each (byte - 128) / 128. Colour bytes are 255 * (0.5 + SH_C0 * f_dc) clipped to [0, 1].
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from phys4dgen.errors import FormatError
from phys4dgen.formats.atomic import atomic_path
from phys4dgen.formats.splat_file import (
    LARGEST_VALUE,
    SplatFile,
    existing_file,
    raise_scales,
    refuse_invalid_rows,
    unit_quaternions,
)
from phys4dgen.types import SH_C0, Gaussians

__all__ = ["read_splat", "write_splat"]

RECORD = np.dtype([("position", "<f4", 3), ("scale", "<f4", 3), ("rgba", "u1", 4), ("rotation", "u1", 4)])


def read_splat(path: Path | str) -> SplatFile:
    """Read a ``.splat`` file; the Gaussians have SH degree 0.

    Raises:
        FormatError: the size is not a multiple of 32 bytes, or values are not usable numbers.
    """
    path = existing_file(path)
    size = path.stat().st_size
    if size % RECORD.itemsize:
        raise FormatError(
            f"{path}: expected a .splat file of 32 bytes per Gaussian, got {size} bytes, {size % 32} too many; "
            "the file is cut off or of another format, get it again."
        )
    records = np.fromfile(path, RECORD)
    position, scale = records["position"], records["scale"]
    refuse_invalid_rows(
        path,
        [
            (("x", "y", "z"), position, -LARGEST_VALUE, LARGEST_VALUE),
            (("scale x", "scale y", "scale z"), scale, 0.0, LARGEST_VALUE),
        ],
    )
    scales, scale_notes = raise_scales(scale)
    quats, quat_notes = unit_quaternions((records["rotation"].astype(np.float32) - 128) / 128)
    rgba = records["rgba"].astype(np.float32) / np.float32(255)
    gaussians = Gaussians(
        means=position,
        quats_wxyz=quats,
        scales=scales,
        opacities=rgba[:, 3],
        sh=((rgba[:, :3] - np.float32(0.5)) / np.float32(SH_C0))[:, None, :],
    )
    return SplatFile(gaussians=gaussians, layout=".splat, 32 bytes", extra={}, notes=(*quat_notes, *scale_notes))


def write_splat(gaussians: Gaussians, path: Path | str) -> None:
    """Write a ``.splat`` file atomically, in the order of ``gaussians``.

    Lossy: opacity to 1/510, colour to 1/510 after clipping to [0, 1], quaternion components to 1/128; coefficients
    above the constant one are left out.
    """
    records = np.zeros(len(gaussians), RECORD)
    records["position"] = gaussians.means
    records["scale"] = gaussians.scales
    records["rgba"][:, :3] = np.rint(gaussians.base_colors * 255)
    records["rgba"][:, 3] = np.rint(gaussians.opacities * 255)
    records["rotation"] = np.clip(np.rint(gaussians.quats_wxyz * 128 + 128), 0, 255)
    with atomic_path(path) as temporary:
        records.tofile(temporary)
