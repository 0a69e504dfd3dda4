"""The core types as files of the run folder; README.md says what each file holds."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.export.pictures import write_png
from phys4dgen.run.folder import RunFolder
from phys4dgen.types import Continuum, Frame, Masks, Parts, Views

__all__ = ["write_continuum", "write_groups", "write_part_maps", "write_views"]

_DEPTH_STEPS = 65535
"""Depth is stored in 16-bit PNGs, which every image library reads."""


def write_views(run: RunFolder, views: Views, *, frame: Frame) -> None:
    """Write rgb, mask and depth of every view and ``cameras.json``.

    ``view_00_mask.png`` is opacity, 255 = opaque; ``view_00_depth.png`` is median depth, 16 bit, in steps of
    ``depth_step`` input units, 0 = none.
    """
    step = max(float(views.depth.max()), 1e-12) / _DEPTH_STEPS
    cameras = []
    for i, camera in enumerate(views.cameras):
        stem = f"view_{i:02d}"
        write_png(_eight_bit(views.rgb[i]), run.views / f"{stem}_rgb.png")
        write_png(_eight_bit(views.alpha[i]), run.views / f"{stem}_mask.png")
        write_png(np.rint(views.depth[i] / step).astype(np.uint16), run.views / f"{stem}_depth.png")
        cameras.append(
            {
                "name": stem,
                "width": camera.width,
                "height": camera.height,
                "K": camera.K,
                "viewmat": camera.viewmat,
                "position": camera.position,
            }
        )
    facts = {
        "convention": "OpenCV (x right, y down, z forward); viewmat maps input coordinates to the camera",
        "depth_step": step,
        "up": frame.up,
        "metres_per_unit": frame.metres_per_unit,
        "cameras": cameras,
    }
    run.write_json(run.cameras_json, facts)


def write_part_maps(run: RunFolder, masks: Masks) -> None:
    """Write ``view_00_parts.png`` per view: 0 where there is nothing, else 1 + part number."""
    for i, labels in enumerate(masks.labels):
        write_png(
            (labels + 1).astype(np.uint16 if labels.max() > 254 else np.uint8), run.views / f"view_{i:02d}_parts.png"
        )


def write_groups(run: RunFolder, parts: Parts, *, votes: NDArray[Any] | None = None, visible: Any = None) -> None:
    """Write ``groups.npz``.

    Args:
        run: the folder.
        parts: label of every Gaussian, and names.
        votes: votes per Gaussian and part, shape [N, G], where the grouping took votes over views.
        visible: seen in at least one view, shape [N], bool, where views were used.
    """
    arrays = {"labels": parts.labels, "names": np.array(parts.names)}
    optional = {"votes": votes, "visible": visible}
    run.write_npz(run.groups_npz, {**arrays, **{name: array for name, array in optional.items() if array is not None}})


def write_continuum(run: RunFolder, continuum: Continuum) -> None:
    """Write ``continuum.npz``: the simulated particles, positions float32 in input coordinates."""
    run.write_npz(
        run.continuum_npz,
        {
            "positions": continuum.positions.astype(np.float32),
            "group": continuum.part,
            "is_interior": continuum.is_interior,
            "volume_m3": continuum.volume_m3,
            "gaussian_index": continuum.gaussian_index,
            "piece": continuum.piece,
            "shape": continuum.shape,
            "thickness_m": continuum.thickness_m,
        },
    )


def _eight_bit(values: NDArray[np.float32]) -> NDArray[np.uint8]:
    return np.rint(np.clip(values, 0, 1) * 255).astype(np.uint8)
