"""The rule table on the bundled objects: true parts, and the material that the rules make of each.

    python benchmarks/rules.py

The rules were written on the first half of the objects. Share of the material's volume whose class in the library is
right, and share whose Young's modulus lies within 1.5 decades of the truth: per object, their mean, and over the volume
of all objects of a half together (in which the large ones decide). Exit code 1 when the latter misses its limits on
the second half.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np
from numpy.typing import NDArray

from phys4dgen.interior import discover_interior
from phys4dgen.materials import identify_by_rules
from phys4dgen.materials.library import find_entry
from phys4dgen.render.cameras import view_cameras
from phys4dgen.render.views import render_views
from phys4dgen.types import Frame, Material, MaterialBook, Parts, rotation_to_z_up
from phys4dgen.zoo import ZooObject, bundled

WRITTEN_ON = ("potted_flower", "snowman", "hammer", "carnation", "hamburger", "basketball")
JUDGED_ON = ("rubber_duck", "sandcastle", "telephone", "straw_hat", "balloon", "cup")
CLASS_LIMIT = 0.60
MODULUS_LIMIT = 0.80
_DECADES = 1.5
_GRID = 28


def ruled(item: ZooObject) -> MaterialBook:
    """What the rules say of the true parts, under names that tell nothing."""
    rotation = rotation_to_z_up(item.up)
    frame = Frame(rotation, item.metres_per_unit)
    lower, upper = item.gaussians.robust_bounds(rotation=rotation)
    cameras = view_cameras("carve", lower=lower, upper=upper, rotation=rotation, size_px=224)
    names = tuple(f"part_{number}" for number in range(len(item.part_names)))
    parts = Parts(labels=item.labels, names=names, backend="zoo")
    inside = discover_interior(
        item.gaussians, render_views(item.gaussians, cameras), parts,
        frame=frame, cell=float((upper - lower).max()) / _GRID,
    )  # fmt: skip
    return identify_by_rules(item.gaussians, parts, frame, inside.continuum)


def right_m3(item: ZooObject, book: MaterialBook) -> NDArray[np.float64]:
    """Volume whose class is right, volume whose stiffness is right within 1.5 decades, and all of it; m3, shape [3]."""
    found = [of_part.surface for of_part in book.parts.values()]
    volumes = np.array([truth.volume_m3 for truth in item.truth.values()])
    pairs = list(zip(found, item.truth.values(), strict=True))
    right = np.array([_class(said) == _class_of(truth.material) for said, truth in pairs])
    decades = np.array([np.log10(said.youngs_modulus_pa / _modulus(truth.material)) for said, truth in pairs])
    near = np.abs(decades) <= _DECADES
    return np.array([volumes @ right, volumes @ near, volumes.sum()])


def _class(found: Material) -> str:
    entry = find_entry(found.name)
    return "none" if entry is None else entry.kind


def _class_of(name: str) -> str:
    entry = find_entry(name)
    assert entry is not None
    return entry.kind


def _modulus(name: str) -> float:
    entry = find_entry(name)
    assert entry is not None
    return entry.material().youngs_modulus_pa


def main() -> int:
    """Print the tables; 1 where the second half misses its limits."""
    argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0]).parse_args()
    missed = False
    for half, names in (("written on", WRITTEN_ON), ("judged on", JUDGED_ON)):
        print(f"rules: objects that the rules were {half}\n  {'object':14s}  class  modulus  parts")
        rows = []
        for name in names:
            item = bundled(name)
            book = ruled(item)
            rows.append(right_m3(item, book))
            kinds, stiffness = rows[-1][:2] / rows[-1][2]
            said = (f"{part} {of.surface.name}" for part, of in zip(item.part_names, book.parts.values(), strict=True))
            print(f"  {name:14s}{kinds:7.2f}{stiffness:9.2f}  {', '.join(said)}", flush=True)
        volumes = np.array(rows)
        mean = (volumes[:, :2] / volumes[:, 2:]).mean(0)
        together = volumes[:, :2].sum(0) / volumes[:, 2].sum()
        print(f"  {'mean':14s}{mean[0]:7.2f}{mean[1]:9.2f}\n  {'by volume':14s}{together[0]:7.2f}{together[1]:9.2f}")
        missed = bool(together[0] < CLASS_LIMIT or together[1] < MODULUS_LIMIT)
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
