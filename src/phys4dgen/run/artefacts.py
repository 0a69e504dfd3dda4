"""The core types as files of the run folder; README.md says what each file holds."""

from __future__ import annotations

import zipfile
from dataclasses import asdict, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import StageError
from phys4dgen.export.pictures import parts_picture, write_png
from phys4dgen.grouping.merging import MergeTree, tree_from_arrays
from phys4dgen.interior import Interior
from phys4dgen.interior.bridge import BridgeReport
from phys4dgen.run.folder import RunFolder
from phys4dgen.run.group_edits import digest_of_parts
from phys4dgen.stages.selection import Surroundings
from phys4dgen.types import Continuum, Frame, Masks, Parts, Views

__all__ = [
    "read_groups",
    "read_interior",
    "read_tree",
    "write_groups",
    "write_interior",
    "write_part_maps",
    "write_parts_picture",
    "write_tree",
    "write_views",
]

_PARTICLE_FIELDS = tuple(field.name for field in fields(Continuum))
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


def write_parts_picture(run: RunFolder, parts: Parts, views: Views, maps: NDArray[np.int32]) -> None:
    """Write ``parts.png``: two views from the side, beside them where each part lies and its share of the Gaussians.

    Args:
        run: the folder.
        parts: of the object.
        views: of the object.
        maps: number of the part that each pixel of a view shows, -1 for none, [V, H, W].
    """
    shown = [len(views) // 3, len(views) // 3 + 2]  # two views from the side in every preset
    picture = parts_picture(
        [_eight_bit(views.rgb[i]) for i in shown],
        [maps[i] for i in shown],
        names=parts.names,
        shares=[float((parts.labels == number).mean()) for number in range(parts.count)],
    )
    write_png(picture, run.parts_png)


def write_groups(run: RunFolder, parts: Parts, *, surroundings: Surroundings | None = None) -> None:
    """Write ``groups.npz``; ``votes`` and ``visible`` where the grouping has them, ``made_as`` to tell later edits by.

    Args:
        run: the folder.
        parts: of the object.
        surroundings: the scene that it was selected from, whose other Gaussians get the label -1.
    """
    arrays = {"labels": parts.labels, "names": np.array(parts.names), "backend": np.array(parts.backend)}
    arrays["made_as"] = np.array(digest_of_parts(parts))
    optional = {"votes": parts.votes, "visible": parts.visible}
    arrays |= {name: array for name, array in optional.items() if array is not None}
    if surroundings is not None:
        count = len(surroundings.whole)
        arrays["labels"] = surroundings.with_rest(parts.labels, np.full(count, -1, np.int32))
        for name in optional.keys() & arrays.keys():
            per_gaussian = arrays[name]
            rest = np.zeros((count, *per_gaussian.shape[1:]), per_gaussian.dtype)
            arrays[name] = surroundings.with_rest(per_gaussian, rest)
    run.write_npz(run.groups_npz, arrays)


def read_groups(run: RunFolder) -> Parts:
    """Read ``groups.npz`` back; what is labelled -1 is not part of the object."""
    with np.load(run.groups_npz, allow_pickle=False) as arrays:
        rows = arrays["labels"] >= 0
        votes, visible = arrays.get("votes"), arrays.get("visible")
        return Parts(
            arrays["labels"][rows],
            tuple(str(name) for name in arrays["names"]),
            str(arrays["backend"]) if "backend" in arrays else "file",
            votes=None if votes is None else votes[rows],
            visible=None if visible is None else visible[rows],
        )


def write_tree(run: RunFolder, tree: MergeTree, *, made_from: str) -> None:
    """Write ``groups_tree.npz``; ``made_from`` is a digest of all that the tree follows from."""
    run.write_npz(run.groups_tree_npz, {**tree.arrays(), "made_from": np.array(made_from)})


def read_tree(run: RunFolder, *, made_from: str, gaussian_count: int) -> MergeTree | None:
    """Read ``groups_tree.npz`` back; None where there is none, or one that does not hold and has to be made again."""
    try:
        with np.load(run.groups_tree_npz, allow_pickle=False) as archive:
            if str(archive["made_from"]) != made_from:
                return None
            return tree_from_arrays(dict(archive), gaussian_count)
    except (OSError, ValueError, KeyError, zipfile.BadZipFile, StageError):
        return None


def write_interior(run: RunFolder, interior: Interior, *, settled: Continuum) -> None:
    """Write ``continuum.npz``: the particles, positions float32 in input coordinates, and what discovery reported.

    Args:
        run: the folder.
        interior: as discovered.
        settled: its particles with the final thicknesses, which the file holds under the plain names; what was
            discovered otherwise stands beside them as ``discovered_...``, so that other materials can settle it anew.
    """
    particles = {}
    for name in _PARTICLE_FIELDS:
        final, found = _stored(settled, name), _stored(interior.continuum, name)
        particles["group" if name == "part" else name] = final
        if not np.array_equal(final, found, equal_nan=final.dtype.kind == "f"):
            particles[f"discovered_{name}"] = found
    facts = {
        "solid_voxels": interior.solid_voxels,
        "agreement": interior.agreement,
        "density_threshold": interior.density_threshold,
        "loose_particles": interior.loose_particles,
        "backend": interior.backend,
        **{f"bridges_{name}": value for name, value in asdict(interior.bridges).items()},
    }
    run.write_npz(run.continuum_npz, {name: np.asarray(value) for name, value in {**particles, **facts}.items()})


def read_interior(run: RunFolder) -> Interior:
    """Read the interior as it was discovered back from ``continuum.npz``."""
    with np.load(run.continuum_npz, allow_pickle=False) as archive:
        arrays = dict(archive)
    arrays["part"] = arrays.pop("group")
    arrays.setdefault("site", np.arange(len(arrays["part"])))  # of an older version: one each
    found = {name: arrays.get(f"discovered_{name}", arrays[name]) for name in _PARTICLE_FIELDS}
    continuum = Continuum(**{name: array.item() if array.ndim == 0 else array for name, array in found.items()})
    bridges = BridgeReport(**{f.name: arrays[f"bridges_{f.name}"].item() for f in fields(BridgeReport)})
    return Interior(
        continuum,
        bridges,
        solid_voxels=arrays["solid_voxels"].item(),
        agreement=arrays["agreement"].item(),
        density_threshold=arrays["density_threshold"].item(),
        loose_particles=arrays["loose_particles"].item(),
        backend=arrays["backend"].item() if "backend" in arrays else "carving and density",  # of an older version
    )


def _stored(continuum: Continuum, name: str) -> NDArray[Any]:
    values = np.asarray(getattr(continuum, name))
    return values.astype(np.float32) if name == "positions" else values


def _eight_bit(values: NDArray[np.float32]) -> NDArray[np.uint8]:
    return np.rint(np.clip(values, 0, 1) * 255).astype(np.uint8)
