"""From the text of one answer to judged numbers: nothing in it is trusted, nothing in it is run.

A server may ignore the schema, so the JSON is looked for in the text (also inside a code fence or between sentences),
parts are taken one by one, and a part that cannot be understood is left out and named. Numbers in the wrong unit are
recognised where the material's name leaves no doubt: a modulus of 2 for a plastic is 2 GPa.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from phys4dgen.materials.library import LibraryEntry, find_entry
from phys4dgen.materials.mllm.schema import ASKED_LAWS
from phys4dgen.materials.mllm.text import harmless, material_word

__all__ = ["MAX_ANSWER_CHARS", "PartReading", "Reading", "SideReading", "UnreadableAnswerError", "read_answer"]

MAX_ANSWER_CHARS = 200_000
"""Longest answer that is looked at; 26 parts take a tenth of it."""
_MAX_DEPTH = 12
_MAX_PARTS = 64

E_RANGE_PA = (1e2, 10**11.5)
DENSITY_RANGE_KGM3 = (5.0, 23000.0)
_POISSON_RANGE = (0.0, 0.49)
_EXTRA_RANGES = {"yield_stress_pa": (1.0, 1e10), "friction_angle_deg": (1.0, 60.0)}
_UNITS = {
    "pa": 1.0, "kpa": 1e3, "mpa": 1e6, "gpa": 1e9, "kg/m3": 1.0, "kg/m^3": 1.0, "kg/m³": 1.0,
    "g/cm3": 1e3, "g/cm^3": 1e3, "g/cm³": 1e3, "g/cc": 1e3, "kg/l": 1e3, "m": 1.0, "cm": 1e-2, "mm": 1e-3,
    "deg": 1.0, "°": 1.0, "degrees": 1.0, "": 1.0,
}  # fmt: skip
_NUMBER = re.compile(r"\s*([-+]?[0-9]{1,20}(?:\.[0-9]{0,20})?(?:[eE][-+]?[0-9]{1,3})?)\s*([^\s\d]?[^\s]{0,9})\s*")
_FENCE = re.compile(r"```[a-zA-Z]{0,10}\s(.*?)```", re.DOTALL)
_FACTORS = {
    "youngs_modulus_pa": ((1e9, "GPa"), (1e6, "MPa"), (1e3, "kPa")),
    "density_kgm3": ((1e3, "g/cm3"),),
}


class UnreadableAnswerError(ValueError):
    """The text holds no answer; the message is a phrase for users."""


@dataclass(frozen=True)
class SideReading:
    """A surface or an interior as one sample sees it.

    Attributes:
        said: the material's name in the model's words, small letters.
        material: its name in the library, or ``said`` where the library has none.
        law: constitutive law, or None where the answer names none that exists.
        youngs_modulus_pa: best value.
        density_kgm3: best value.
        poisson_ratio: best value.
        extra: yield stress and friction angle, where given.
    """

    said: str
    material: str
    law: str | None
    youngs_modulus_pa: float
    density_kgm3: float
    poisson_ratio: float
    extra: Mapping[str, float]


@dataclass(frozen=True)
class PartReading:
    """A part as one sample sees it."""

    letter: str
    what_it_is: str
    origin: Literal["natural", "artificial"] | None
    shape: Literal["solid", "hollow", "sheet"] | None
    thickness_m: float | None
    reason: str
    surface: SideReading
    interior: SideReading


@dataclass(frozen=True)
class Reading:
    """One sample.

    Attributes:
        thing: what the object is, in the model's words.
        height_m: its real height, or None.
        parts: what could be read, by letter.
        notes: what was left out or converted, one phrase each.
    """

    thing: str
    height_m: float | None
    parts: Mapping[str, PartReading]
    notes: tuple[str, ...]


def read_answer(text: str, letters: Sequence[str]) -> Reading:
    """Read the answer of a model about the parts of these letters.

    Raises:
        UnreadableAnswerError: there is no answer in the text, or none of the parts can be read.
    """
    tree = _json_in(text)
    rows = tree.get("parts")
    if isinstance(rows, Mapping):  # the paper's own format: {letter: {surface, internal}}
        rows = [{"letter": key, **row} for key, row in rows.items() if isinstance(row, Mapping)]
    if not isinstance(rows, list):
        raise UnreadableAnswerError("it has no list of parts")
    notes: list[str] = []
    parts: dict[str, PartReading] = {}
    for row in rows[:_MAX_PARTS]:
        letter = _letter(row, letters)
        if letter is None:
            notes.append("a part that was not asked for is left out")
        elif letter in parts:
            notes.append(f"part {letter} is described twice; the first counts")
        else:
            try:
                parts[letter] = _part(letter, row, notes)
            except UnreadableAnswerError as error:
                notes.append(f"part {letter} is left out: {error}")
    if not parts:
        raise UnreadableAnswerError(notes[0] if notes else "it describes none of the parts")
    notes += [f"part {letter} is missing" for letter in letters if letter not in parts and not _told(letter, notes)]
    height = _best(tree.get("height_m"), "m")
    return Reading(
        thing=harmless(tree.get("object", ""), limit=80),
        height_m=height if height is not None and 1e-3 <= height <= 100 else None,
        parts=parts,
        notes=tuple(notes),
    )


def _told(letter: str, notes: list[str]) -> bool:
    return any(note.startswith(f"part {letter} is left out") for note in notes)


def _json_in(text: str) -> Mapping[str, Any]:
    """The JSON object in a text."""
    if len(text) > MAX_ANSWER_CHARS:
        raise UnreadableAnswerError(f"it is longer than {MAX_ANSWER_CHARS:,} characters")
    fence = _FENCE.search(text)
    first, last = text.find("{"), text.rfind("}")
    for candidate in (text, fence[1] if fence else "", text[first : last + 1] if first >= 0 else ""):
        tree = _loaded(candidate)
        if isinstance(tree, Mapping):
            return tree
    raise UnreadableAnswerError("it is not JSON")


def _loaded(text: str) -> Any:
    try:
        tree = json.loads(text, parse_constant=lambda _: None)
    except (ValueError, RecursionError):
        return None
    return tree if _depth_within(tree, _MAX_DEPTH) else None


def _depth_within(tree: Any, left: int) -> bool:
    if not isinstance(tree, (dict, list)):
        return True
    children = tree.values() if isinstance(tree, dict) else tree
    return left > 0 and all(_depth_within(child, left - 1) for child in children)


def _letter(row: Any, letters: Sequence[str]) -> str | None:
    if not isinstance(row, Mapping):
        return None
    said = str(row.get("letter", ""))[:20].strip().upper().removeprefix("PART ").strip(" .:)")
    return said if said in letters else None


def _part(letter: str, row: Mapping[str, Any], notes: list[str]) -> PartReading:
    surface = _side(row.get("surface"), f"part {letter}, surface", notes)
    inner = row.get("interior", row.get("internal"))
    interior = surface if inner is None else _side(inner, f"part {letter}, interior", notes)
    thickness = _best(row.get("thickness_m"), "m")
    origin, shape = row.get("origin"), row.get("shape")
    return PartReading(
        letter=letter,
        what_it_is=harmless(row.get("what_it_is", ""), limit=80),
        origin=origin if origin in ("natural", "artificial") else None,
        shape=shape if shape in ("solid", "hollow", "sheet") else None,
        thickness_m=thickness if thickness is not None and 1e-6 <= thickness <= 1 else None,
        reason=harmless(row.get("reason", "")),
        surface=surface,
        interior=interior,
    )


def _side(row: Any, where: str, notes: list[str]) -> SideReading:
    if not isinstance(row, Mapping):
        raise UnreadableAnswerError("it has no material")
    said = material_word(row.get("material"))
    if said is None:
        raise UnreadableAnswerError("what it gives as a material is no name of one")
    entry = find_entry(said)
    values: dict[str, float] = {}
    for key, limits in (
        ("youngs_modulus_pa", E_RANGE_PA),
        ("density_kgm3", DENSITY_RANGE_KGM3),
        ("poisson_ratio", _POISSON_RANGE),
    ):
        value = _best(row.get(key), key)
        if value is None:
            raise UnreadableAnswerError(f"{said} has no {key}")
        value, unit = _in_si(key, value, entry)
        if unit:
            notes.append(f"{where}: {key} of {said} was taken for a number in {unit}")
        if key == "poisson_ratio":
            value = min(value, limits[1]) if value < 0.51 else value  # 0.5 is meant for "incompressible"
        if not limits[0] <= value <= limits[1]:
            raise UnreadableAnswerError(f"{key} of {said} is {value:g}, which no material has")
        values[key] = value
    extra = {}
    for key, (low, high) in _EXTRA_RANGES.items():
        value = _best(row.get(key), key)
        if value is not None and low <= value <= high:
            extra[key] = value
    law = row.get("law")
    return SideReading(
        said=said,
        material=said if entry is None else entry.name,
        law=law if law in ASKED_LAWS else None,
        extra=extra,
        **values,
    )


def _best(value: Any, _key: str) -> float | None:
    """The best value of an interval, a bare number, or a text such as '2 GPa'; None where there is none."""
    if isinstance(value, Mapping):
        best = _best(value.get("best"), _key)
        if best is not None:
            return best
        low, high = _best(value.get("low"), _key), _best(value.get("high"), _key)
        return math.sqrt(low * high) if low is not None and high is not None and low > 0 and high > 0 else None
    if isinstance(value, bool):
        return None
    if isinstance(value, (int, float)):
        try:
            number = float(value)
        except OverflowError:
            return None
        return number if math.isfinite(number) else None
    if isinstance(value, str) and len(value) <= 40:
        match = _NUMBER.fullmatch(value)
        factor = _UNITS.get(match[2].lower()) if match else None
        return float(match[1]) * factor if match and factor else None
    return None


def _in_si(key: str, value: float, entry: LibraryEntry | None) -> tuple[float, str]:
    """The value, and the unit that it must have been in where the named material leaves no doubt."""
    if entry is None or key not in _FACTORS or value <= 0:
        return value, ""
    low, high = getattr(entry, key).range
    slack = 10**0.5 if key == "youngs_modulus_pa" else 1.3
    if value >= low / 10 ** (2.5 if key == "youngs_modulus_pa" else 1.5):
        return value, ""
    for factor, unit in _FACTORS[key]:
        if low / slack <= value * factor <= high * slack:
            return value * factor, unit
    return value, ""
