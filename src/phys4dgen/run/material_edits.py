"""What a person changed in materials.yaml, and how it survives.

Beside materials.yaml lies ``.identified.yaml``, the materials as they were identified. Where the two differ, a person
has edited: that material counts as the user's own (``source: user``), and a later identification leaves it alone,
unless the scene has been told another material for the part since.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from phys4dgen.materials import read_materials
from phys4dgen.materials.book import library_warnings
from phys4dgen.materials.library import find_entry
from phys4dgen.types import Material, MaterialBook, PartMaterials

__all__ = ["SIDES", "current_book", "edited_materials", "with_edits"]

SIDES = ("surface", "interior")
_NUMBERS = ("law", "density_kgm3", "youngs_modulus_pa", "poisson_ratio", "thickness_m", "extra")


def edited_materials(materials_yaml: Path, identified_yaml: Path) -> dict[tuple[str, str], Material]:
    """Materials that differ from what was identified, by part and side, with ``source: user``.

    Raises:
        MaterialError: materials.yaml is damaged; names file, line and the way out.
    """
    if not (materials_yaml.is_file() and identified_yaml.is_file()):
        return {}
    before, now = read_materials(identified_yaml), read_materials(materials_yaml)
    edits = {}
    for part, materials in now.items():
        for side in SIDES:
            past = getattr(before[part], side) if part in before else None
            present: Material = getattr(materials, side)
            if past is None or _as_edited(past) != _as_edited(present):
                edits[part, side] = _users(_meant(present, past))
    return edits


def current_book(materials_yaml: Path, identified_yaml: Path) -> MaterialBook:
    """The materials as they hold: identified, and edited where a person did.

    Raises:
        MaterialError: a file is damaged; names file, line and the way out.
    """
    identified = MaterialBook(read_materials(identified_yaml))
    return with_edits(identified, edited_materials(materials_yaml, identified_yaml))


def with_edits(book: MaterialBook, edits: Mapping[tuple[str, str], Material]) -> MaterialBook:
    """The book with edited materials in place of identified ones."""
    parts = {}
    for name, materials in book.parts.items():
        parts[name] = PartMaterials(**{side: edits.get((name, side), getattr(materials, side)) for side in SIDES})
    return MaterialBook(parts)


def _users(material: Material) -> Material:
    """The same as the user's own, with the warnings that its numbers earn and no others."""
    return replace(material, source="user", warnings=library_warnings(material))


def _as_edited(material: Material) -> dict[str, object]:
    """What a person can edit; warnings are worked out anew."""
    return {key: value for key, value in vars(material).items() if key != "warnings"}


def _meant(present: Material, past: Material | None) -> Material:
    """A new name beside the old numbers means the library's numbers of that name."""
    entry = find_entry(present.name)
    only_named = past is not None and all(getattr(present, key) == getattr(past, key) for key in _NUMBERS)
    return present if entry is None or past is None or present.name == past.name or not only_named else entry.material()
