"""The material of every part: who decides, and materials.yaml in and out.

Precedence: the user's flags > a materials.yaml > what was identified (rules, later a language model) > defaults.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from phys4dgen.errors import MaterialError, did_you_mean
from phys4dgen.materials.library import find_entry, material
from phys4dgen.types import Material, MaterialBook, PartMaterials, wrong_number

__all__ = ["assemble_book", "library_warnings", "parse_choices"]


def library_warnings(chosen: Material) -> tuple[str, ...]:
    """Where the numbers of a material lie outside the range that the library gives for its name."""
    entry = find_entry(chosen.name)
    if entry is None:
        return ()
    found = []
    for key in ("density_kgm3", "youngs_modulus_pa", "poisson_ratio", "thickness_m"):
        quantity, value = getattr(entry, key), getattr(chosen, key)
        if quantity is not None and value is not None and not quantity.range[0] <= value <= quantity.range[1]:
            low, high = quantity.range
            found.append(f"{key} {value:g} lies outside the library's range {low:g} to {high:g} for {entry.name}")
    return tuple(found)


def parse_choices(flags: Iterable[str], *, flag: str = "--material") -> dict[str, str]:
    """Read ``PART=NAME`` flags.

    Args:
        flags: for example ``["leaves=felt", "pot=steel"]``; the last one on a part counts.
        flag: its name in errors.

    Raises:
        MaterialError: a flag is not of this form.
    """
    choices: dict[str, str] = {}
    for text in flags:
        part, equals, name = (piece.strip() for piece in text.partition("="))
        if not (part and equals and name):
            raise MaterialError(f"{flag}: expected PART=NAME such as leaves=felt, got '{text}'.")
        choices[part] = name
    return choices


def assemble_book(
    part_names: tuple[str, ...],
    identified: MaterialBook,
    *,
    from_file: Mapping[str, PartMaterials] | None = None,
    surface: Mapping[str, str] | None = None,
    interior: Mapping[str, str] | None = None,
    thickness_m: Mapping[str, float] | None = None,
) -> MaterialBook:
    """Decide the materials of every part.

    Args:
        part_names: all parts, in the order of their numbers.
        identified: a material for every part, from the rules.
        from_file: parts that a materials.yaml describes, from ``read_materials``.
        surface: library name by part, from the user; also of the interior, unless that is given too.
        interior: library name by part, from the user.
        thickness_m: thickness of sheets and rods by part, from the user.

    Raises:
        MaterialError: a part or a material does not exist, or a law lacks a number.
    """
    from_file, surface, interior, thickness_m = from_file or {}, surface or {}, interior or {}, thickness_m or {}
    for source, names in (
        ("materials file", from_file),
        ("material of the surface", surface),
        ("material of the interior", interior),
        ("thickness_m", thickness_m),
    ):
        for name in names:
            if name not in part_names:
                hint = did_you_mean(name, part_names)
                raise MaterialError(
                    f"{source}: there is no part '{name}'.{hint} The parts are {', '.join(part_names)}."
                )
    book: dict[str, PartMaterials] = {}
    for name in part_names:
        chosen = from_file.get(name, identified.parts[name])
        if name in surface:
            by_user = _users(surface[name])
            chosen = PartMaterials(surface=by_user, interior=by_user)
        if name in interior:
            chosen = PartMaterials(surface=chosen.surface, interior=_users(interior[name]))
        if name in thickness_m:
            chosen = PartMaterials(
                surface=replace(chosen.surface, thickness_m=thickness_m[name]),
                interior=replace(chosen.interior, thickness_m=thickness_m[name]),
            )
        for side in (chosen.surface, chosen.interior):
            wrong = wrong_number(side.law, side.extra, side.youngs_modulus_pa, side.poisson_ratio)
            if wrong is not None:
                raise MaterialError(f"part '{name}', material {side.name}: {wrong}.")
        book[name] = chosen
    return MaterialBook(book)


def _users(name: str) -> Material:
    chosen = material(name)
    entry = find_entry(name)
    notes = []
    if entry is not None and entry.needs_review:
        notes.append(f"{entry.name}: some of the library's values are from memory and need review")
    return replace(chosen, source="user", warnings=tuple(notes))
