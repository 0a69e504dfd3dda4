"""What every part is made of, at its surface and inside (Paper: Sec. 3.4)."""

from __future__ import annotations

from phys4dgen.interior import Interior
from phys4dgen.materials import assemble_book, identify_by_rules, read_materials
from phys4dgen.progress import Progress
from phys4dgen.scene import Scene
from phys4dgen.stages.asset import Asset
from phys4dgen.types import MaterialBook, Parts

__all__ = ["identify"]


def identify(scene: Scene, asset: Asset, parts: Parts, interior: Interior, progress: Progress) -> MaterialBook:
    """Name the materials of every part (Paper: Sec. 3.4); rules stand in for the multimodal model."""
    identified = identify_by_rules(asset.gaussians, parts, asset.frame, interior.continuum)
    from_file = None if scene.materials.file is None else read_materials(scene.materials.file, parts.names)
    options = scene.parts
    book = assemble_book(
        parts.names,
        identified,
        from_file=from_file,
        surface={name: o.material for name, o in options.items() if o.material is not None},
        interior={name: o.interior_material for name, o in options.items() if o.interior_material is not None},
        thickness_m={name: o.thickness_m for name, o in options.items() if o.thickness_m is not None},
    )
    for name, entry in book.parts.items():
        for warning in dict.fromkeys((*entry.surface.warnings, *entry.interior.warnings)):
            progress.warn(f"Material of part '{name}': {warning}.")
    return book
