"""What a person changed in materials.yaml, and how it survives.

Beside materials.yaml lies ``.identified.yaml``, the materials as they were identified. Where the two differ, a person
has edited: that material counts as the user's own (``source: user``), and a later identification leaves it alone,
unless the scene has been told another material for the part since.

Two files cannot be replaced at once. So the new ``.identified.yaml`` lies beside the old one, under a name of its own,
until materials.yaml is replaced too; of a command that was killed in between, the one that materials.yaml differs less
from is the one that belongs to it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from phys4dgen.materials import read_materials, write_materials
from phys4dgen.materials.book import library_warnings
from phys4dgen.materials.library import find_entry
from phys4dgen.types import Material, MaterialBook, PartMaterials

__all__ = ["SIDES", "current_book", "edited_materials", "with_edits", "write_both"]

SIDES = ("surface", "interior")
_NUMBERS = ("law", "density_kgm3", "youngs_modulus_pa", "poisson_ratio", "thickness_m", "extra")


def edited_materials(materials_yaml: Path, identified_yaml: Path) -> dict[tuple[str, str], Material]:
    """Materials that differ from what was identified, by part and side, with ``source: user``.

    Raises:
        MaterialError: materials.yaml is damaged; names file, line and the way out.
    """
    if not (identified_yaml.is_file() or _coming(identified_yaml).is_file()):
        return {}
    return _found(materials_yaml, identified_yaml)[1]


def current_book(materials_yaml: Path, identified_yaml: Path) -> MaterialBook:
    """The materials as they hold: identified, and edited where a person did.

    Raises:
        MaterialError: a file is damaged; names file, line and the way out.
    """
    return with_edits(*_found(materials_yaml, identified_yaml))


def write_both(materials_yaml: Path, identified_yaml: Path, *, book: MaterialBook, identified: MaterialBook) -> None:
    """Replace both files, so that a command killed in between makes no edits of what it identified.

    Args:
        materials_yaml: gets ``book``.
        identified_yaml: gets ``identified``.
        book: the materials as they hold.
        identified: as they were identified.
    """
    coming = _coming(identified_yaml)
    write_materials(coming, identified)
    write_materials(materials_yaml, book)
    coming.replace(identified_yaml)


def with_edits(book: MaterialBook, edits: Mapping[tuple[str, str], Material]) -> MaterialBook:
    """The book with edited materials in place of identified ones."""
    parts = {}
    for name, materials in book.parts.items():
        parts[name] = PartMaterials(**{side: edits.get((name, side), getattr(materials, side)) for side in SIDES})
    return MaterialBook(parts)


def _found(materials_yaml: Path, identified_yaml: Path) -> tuple[MaterialBook, dict[tuple[str, str], Material]]:
    """The materials as identified, and the edits."""
    paths = [path for path in (identified_yaml, _coming(identified_yaml)) if path.is_file()]
    books = [MaterialBook(read_materials(path)) for path in paths or [identified_yaml]]
    if not materials_yaml.is_file():
        return books[0], {}
    now = read_materials(materials_yaml)
    return min(((book, _edits(now, book)) for book in books), key=lambda found: len(found[1]))


def _edits(now: Mapping[str, PartMaterials], before: MaterialBook) -> dict[tuple[str, str], Material]:
    edits = {}
    for part, materials in now.items():
        for side in SIDES:
            past = getattr(before.parts[part], side) if part in before.parts else None
            present: Material = getattr(materials, side)
            if past is None or _as_edited(past) != _as_edited(present):
                edits[part, side] = _users(_meant(present, past))
    return edits


def _coming(identified_yaml: Path) -> Path:
    return identified_yaml.with_name(".identified.coming.yaml")


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
