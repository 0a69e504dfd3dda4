"""The material library: library.yaml, read once and checked, found by name or alias."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib import resources
from types import MappingProxyType
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from phys4dgen.errors import MaterialError, did_you_mean
from phys4dgen.types import KNOWN_NUMBERS, LAW_NUMBERS, Material, wrong_number
from phys4dgen.yaml12 import parse_yaml

__all__ = ["KNOWN_LAWS", "LibraryEntry", "Quantity", "find_entry", "library_entries", "material"]

KNOWN_LAWS: tuple[str, ...] = tuple(LAW_NUMBERS)
"""Laws that a material may ask for."""


class _Frozen(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Quantity(_Frozen):
    """A number with its range and where it comes from."""

    value: float
    range: tuple[float, float]
    quality: Literal["A", "B", "C"]
    source: Annotated[str, Field(min_length=3)]
    needs_review: bool = False

    @model_validator(mode="after")
    def _consistent(self) -> Quantity:
        low, high = self.range
        if not low <= self.value <= high:
            raise ValueError(f"value {self.value:g} lies outside its range {low:g} to {high:g}")
        if self.needs_review != (self.quality == "C"):
            raise ValueError("needs_review belongs to quality C, and to no other")
        return self


class LibraryEntry(_Frozen):
    """One material of the library."""

    name: str
    aliases: tuple[str, ...]
    kind: Annotated[str, Field(alias="class")]
    law: str
    density_kgm3: Quantity
    youngs_modulus_pa: Quantity
    poisson_ratio: Quantity
    thickness_m: Quantity | None = None
    extra: dict[str, Quantity] = Field(default_factory=dict)
    rigid_candidate: bool = False
    note: str = ""

    @model_validator(mode="after")
    def _has_its_numbers(self) -> LibraryEntry:
        if self.law not in LAW_NUMBERS:
            raise ValueError(f"law must be one of {', '.join(LAW_NUMBERS)}, got {self.law}")
        unknown = set(self.extra) - KNOWN_NUMBERS
        if unknown:
            raise ValueError(f"unknown numbers {', '.join(sorted(unknown))}")
        given = {key: quantity.value for key, quantity in self.extra.items()}
        wrong = wrong_number(self.law, given, self.youngs_modulus_pa.value, self.poisson_ratio.value)
        if wrong is not None:
            raise ValueError(wrong)
        return self

    @property
    def needs_review(self) -> bool:
        """Whether one of the three elastic numbers is from memory."""
        return any(q.needs_review for q in (self.density_kgm3, self.youngs_modulus_pa, self.poisson_ratio))

    def material(self) -> Material:
        """The typical values, with ``source: library``."""
        return Material(
            name=self.name,
            law=self.law,
            density_kgm3=self.density_kgm3.value,
            youngs_modulus_pa=self.youngs_modulus_pa.value,
            poisson_ratio=self.poisson_ratio.value,
            source="library",
            thickness_m=None if self.thickness_m is None else self.thickness_m.value,
            extra={key: quantity.value for key, quantity in self.extra.items()},
        )


@cache
def library_entries() -> Mapping[str, LibraryEntry]:
    """All entries by their own name, in the order of the file."""
    text = resources.files("phys4dgen.materials").joinpath("library.yaml").read_text(encoding="utf-8")
    rows = parse_yaml(text, source="library.yaml").value
    return MappingProxyType({name: LibraryEntry.model_validate({"name": name, **row}) for name, row in rows.items()})


@cache
def _names() -> Mapping[str, str]:
    """Own name of the entry for every name and alias."""
    return MappingProxyType(
        {word: name for name, entry in library_entries().items() for word in (name, *entry.aliases)}
    )


def find_entry(name: str) -> LibraryEntry | None:
    """Entry of that name or alias, whatever its capitals, spaces and hyphens; None where there is none."""
    own = _names().get("_".join(name.lower().replace("-", " ").split()))
    return None if own is None else library_entries()[own]


def material(name: str) -> Material:
    """The library's material of that name or alias.

    Raises:
        MaterialError: the library has no such material.
    """
    entry = find_entry(name)
    if entry is None:
        hint = did_you_mean(name, _names()) or f" Known materials: {', '.join(library_entries())}."
        raise MaterialError(f"material '{name}': the library has no material of this name.{hint}")
    return entry.material()
