"""materials.yaml: the material of every part as a file that a person can read, edit and run again from.

Per part ``surface`` and ``interior``, each a mapping or just the name of a library material; ``interior`` may be left
out where it is like the surface. Values left out come from the library. ``evidence``, ``range`` and ``warnings`` are
written for the reader; ``range`` is worked out anew on reading. ``extra`` holds the numbers of the law.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

from phys4dgen.errors import FormatError, MaterialError, did_you_mean
from phys4dgen.formats.atomic import atomic_path
from phys4dgen.materials.book import library_warnings
from phys4dgen.materials.library import KNOWN_LAWS, find_entry, library_entries
from phys4dgen.types import KNOWN_NUMBERS, Material, MaterialBook, PartMaterials, wrong_number
from phys4dgen.yaml12 import YamlDocument, YamlPath, format_yaml, read_yaml

__all__ = ["read_materials", "write_materials"]

_RANGES = {
    "density_kgm3": (1.0, 25000.0),
    "youngs_modulus_pa": (1.0, 2e12),
    "poisson_ratio": (0.0, 0.4999),
    "thickness_m": (1e-7, 10.0),
}
"""What physics allows at all; a named material has a narrower range in the library."""

_REQUIRED = ("density_kgm3", "youngs_modulus_pa", "poisson_ratio")
_KEYS = ("name", "law", *_RANGES, "extra", "source", "evidence", "range", "warnings")
_OF_OLDER_VERSIONS = ("effective_law",)
"""What stands in files of older versions and means nothing any more."""
_SIDES = ("surface", "interior")

_HEADER = """\
# The material of every part. Edit and run again; an entry that you edit should say `source: user`.
# SI units. law: {laws}; extra: the numbers of the law.
# range is the library's for the material's name, for reading only.
"""


def write_materials(path: Path | str, book: MaterialBook) -> None:
    """Write a book as materials.yaml, whole or not at all."""
    tree = {
        name: {"surface": _row(materials.surface)}
        | ({} if materials.interior == materials.surface else {"interior": _row(materials.interior)})
        for name, materials in book.parts.items()
    }
    text = _HEADER.format(laws=", ".join(KNOWN_LAWS)) + format_yaml({"parts": tree})
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def read_materials(path: Path | str, part_names: tuple[str, ...] | None = None) -> dict[str, PartMaterials]:
    """Read a materials.yaml, by part name.

    Args:
        path: the file.
        part_names: the parts that exist; None accepts any name.

    Raises:
        MaterialError: a key, a name or a value is wrong; names file, line, part and the way out.
    """
    path = Path(path)
    try:
        document = read_yaml(path)
    except FormatError as error:
        raise MaterialError(str(error)) from error
    reader = _Reader(document, path)
    root = reader.mapping(document.value, ())
    reader.known_keys(root, ("parts",), ())
    parts = reader.mapping(root.get("parts"), ("parts",))
    for name in parts:
        if part_names is not None and name not in part_names:
            reader.refuse_part(str(name), part_names)
    return {str(name): reader.part(row, ("parts", name)) for name, row in parts.items()}


def _row(chosen: Material) -> dict[str, Any]:
    """One material as it is written."""
    entry = find_entry(chosen.name)
    row: dict[str, Any] = {
        "name": chosen.name,
        "law": chosen.law,
        "density_kgm3": chosen.density_kgm3,
        "youngs_modulus_pa": chosen.youngs_modulus_pa,
        "poisson_ratio": chosen.poisson_ratio,
    }
    if chosen.thickness_m is not None:
        row["thickness_m"] = chosen.thickness_m
    if chosen.extra:
        row["extra"] = dict(chosen.extra)
    row["source"] = chosen.source
    if chosen.evidence:
        row["evidence"] = chosen.evidence
    if entry is not None:
        quantities = {key: getattr(entry, key) for key in _RANGES}
        row["range"] = {key: list(quantity.range) for key, quantity in quantities.items() if quantity is not None}
    if chosen.warnings:
        row["warnings"] = list(chosen.warnings)
    return row


class _Reader:
    """Checks values on the way in and says where a wrong one stands."""

    def __init__(self, document: YamlDocument, path: Path) -> None:
        self._lines = document.lines
        self._path = path

    def part(self, row: Any, at: YamlPath) -> PartMaterials:
        """Surface and interior of one part."""
        sides = self.mapping(row, at)
        self.known_keys(sides, _SIDES, at)
        if "surface" not in sides:
            raise self._error(at, f"part '{at[-1]}' has no surface; give it one, such as 'surface: felt'")
        surface = self._material(sides["surface"], (*at, "surface"))
        if "interior" not in sides:
            return PartMaterials(surface=surface, interior=surface)
        return PartMaterials(surface=surface, interior=self._material(sides["interior"], (*at, "interior")))

    def mapping(self, value: Any, at: YamlPath) -> Mapping[Any, Any]:
        """The value, if it is a mapping."""
        if not isinstance(value, Mapping):
            what = ".".join(map(str, at)) or "the file"
            raise self._error(at, f"expected {what} to be a mapping of names to values, got {value!r:.60}")
        return value

    def known_keys(self, row: Mapping[Any, Any], known: tuple[str, ...], at: YamlPath) -> None:
        """Refuse a key that means nothing."""
        for key in row:
            if key not in known:
                hint = did_you_mean(str(key), known) or f" Known keys here: {', '.join(known)}."
                raise self._error((*at, key), f"'{key}' is not a key of materials.yaml", hint)

    def refuse_part(self, name: str, known: tuple[str, ...]) -> NoReturn:
        """Say that there is no such part."""
        hint = f"{did_you_mean(name, known)} The parts are {', '.join(known)}."
        raise self._error(("parts", name), f"there is no part '{name}'", hint)

    def _material(self, row: Any, at: YamlPath) -> Material:
        if isinstance(row, str):
            row = {"name": row, "source": "user"}
        row = self.mapping(row, at)
        self.known_keys({key: row[key] for key in row if key not in _OF_OLDER_VERSIONS}, _KEYS, at)
        name = self._text(row, "name", at)
        entry = find_entry(name)
        usual = None if entry is None else entry.material()
        if usual is None and any(key not in row for key in _REQUIRED):
            missing = next(key for key in _REQUIRED if key not in row)
            raise self._error(
                at, f"the library has no material '{name}', so {missing} must be given", self._suggestion(name)
            )
        law = self._text(row, "law", at) if "law" in row else (usual.law if usual else "neo_hookean")
        if law not in KNOWN_LAWS:
            hint = did_you_mean(law, KNOWN_LAWS)
            raise self._error((*at, "law"), f"expected law to be one of {', '.join(KNOWN_LAWS)}, got '{law}'", hint)
        thickness_m = None if usual is None else usual.thickness_m
        if row.get("thickness_m") is not None:
            thickness_m = self._number(row, "thickness_m", at, None)
        chosen = Material(
            name=name if entry is None else entry.name,
            law=law,
            density_kgm3=self._number(row, "density_kgm3", at, usual),
            youngs_modulus_pa=self._number(row, "youngs_modulus_pa", at, usual),
            poisson_ratio=self._number(row, "poisson_ratio", at, usual),
            source=self._text(row, "source", at) if "source" in row else "user",
            thickness_m=thickness_m,
            extra=self._extra(row["extra"], (*at, "extra")) if "extra" in row else dict(usual.extra) if usual else {},
        )
        wrong = wrong_number(chosen.law, chosen.extra, chosen.youngs_modulus_pa, chosen.poisson_ratio)
        if wrong is not None:
            raise self._error((*at, "extra"), wrong)
        evidence = self._text(row, "evidence", at) if "evidence" in row else ""
        told = self._warnings(row.get("warnings", []), (*at, "warnings"))
        warnings = tuple(dict.fromkeys((*told, *library_warnings(chosen))))
        return replace(chosen, evidence=evidence, warnings=warnings)

    def _suggestion(self, name: str) -> str:

        words = [word for entry in library_entries().values() for word in (entry.name, *entry.aliases)]
        return did_you_mean(name, words)

    def _text(self, row: Mapping[Any, Any], key: str, at: YamlPath) -> str:
        value = row.get(key)
        if not (isinstance(value, str) and 0 < len(value) <= 200):
            raise self._error((*at, key), f"expected {key} to be text, got {value!r:.60}")
        return value

    def _number(self, row: Mapping[Any, Any], key: str, at: YamlPath, usual: Material | None) -> float:
        """The number given, or the library's."""
        value = getattr(usual, key) if usual is not None and row.get(key) is None else row[key]
        low, high = _RANGES[key]
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
            raise self._error((*at, key), f"expected {key} to be a number from {low:g} to {high:g}, got {value!r:.60}")
        return float(value)

    def _extra(self, value: Any, at: YamlPath) -> dict[str, float]:
        extra: dict[str, float] = {}
        for key, number in self.mapping(value, at).items():
            if key not in KNOWN_NUMBERS:
                hint = did_you_mean(str(key), KNOWN_NUMBERS) or f" Known: {', '.join(sorted(KNOWN_NUMBERS))}."
                raise self._error((*at, key), f"'{key}' is not a number of any law", hint)
            if isinstance(number, bool) or not isinstance(number, (int, float)) or not abs(number) <= 1e15:
                raise self._error((*at, key), f"expected {key} to be a number up to 1e15, got {number!r:.60}")
            extra[str(key)] = float(number)
        return extra

    def _warnings(self, value: Any, at: YamlPath) -> tuple[str, ...]:
        if not (isinstance(value, list) and all(isinstance(text, str) for text in value)):
            raise self._error(at, f"expected warnings to be a list of sentences, got {value!r:.60}")
        return tuple(value)

    def _error(self, at: YamlPath, problem: str, hint: str = "") -> MaterialError:
        line = next((self._lines[at[:n]] for n in range(len(at), -1, -1) if at[:n] in self._lines), 1)
        return MaterialError(f"{self._path} line {line}: {problem}.{hint}")
