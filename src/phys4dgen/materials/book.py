"""The material of every part: who decides, and materials.yaml in and out.

Precedence: the user's flags > a materials.yaml > what was identified (rules, later a language model) > defaults.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from phys4dgen.errors import MaterialError, did_you_mean
from phys4dgen.materials.library import find_entry, material
from phys4dgen.types import Material, MaterialBook, PartMaterials

__all__ = ["RUNNABLE_LAWS", "assemble_book", "library_warnings", "parse_choices", "runnable_law"]

RUNNABLE_LAWS = ("neo_hookean", "fixed_corotated")
"""Constitutive laws that the engine has."""


def runnable_law(material: Material) -> tuple[str, str | None]:
    """The law that the engine runs for a material, and a warning where it is not the one asked for."""
    if material.law in RUNNABLE_LAWS:
        return material.law, None
    return "neo_hookean", (
        f"{material.name}: the law {material.law} is not built yet; it runs as neo_hookean, elastic and without yield"
    )


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
    """Decide the materials of every part; a law that the engine does not have adds a warning to its material.

    Args:
        part_names: all parts, in the order of their numbers.
        identified: a material for every part, from the rules.
        from_file: parts that a materials.yaml describes, from ``read_materials``.
        surface: library name by part, from the user; also of the interior, unless that is given too.
        interior: library name by part, from the user.
        thickness_m: thickness of sheets and rods by part, from the user.

    Raises:
        MaterialError: a part or a material does not exist.
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
        book[name] = PartMaterials(
            surface=_with_law_warning(chosen.surface), interior=_with_law_warning(chosen.interior)
        )
    return MaterialBook(book)


def _with_law_warning(chosen: Material) -> Material:
    """The material, saying so where the engine runs another law."""
    warning = runnable_law(chosen)[1]
    if warning is None or warning in chosen.warnings:
        return chosen
    return replace(chosen, warnings=(*chosen.warnings, warning))


def _users(name: str) -> Material:
    chosen = material(name)
    entry = find_entry(name)
    notes = []
    if entry is not None and entry.needs_review:
        notes.append(f"{entry.name}: some of the library's values are from memory and need review")
    return replace(chosen, source="user", warnings=tuple(notes))
