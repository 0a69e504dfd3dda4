"""Section ``grouping``: the Gaussians are divided into parts, and the parts corrected."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from phys4dgen.scene.sections.values import Auto, FilePath, PartName, Section, SeedPoints, as_tuple

__all__ = ["Grouping", "PartEdit"]


class PartEdit(Section):
    """One correction of the parts; edits are made in their order.

    Either ``merge``, or ``rename`` with ``to``, or ``split`` with ``pieces`` or ``seeds``, or ``seeds`` alone.
    """

    merge: Annotated[tuple[PartName, ...], BeforeValidator(as_tuple)] = ()
    """names of parts that become one, which keeps the first name"""
    rename: PartName | None = None
    """name of a part that gets another one"""
    to: PartName | None = None
    """its new name"""
    split: PartName | None = None
    """name of a part that is divided"""
    pieces: Annotated[int, Field(ge=2, le=20)] | None = None
    """into so many, called NAME_1, NAME_2 ... from the ground up"""
    seeds: dict[PartName, SeedPoints] = Field(default_factory=dict)
    """points on the surface in the input's coordinates, by the name of the part or piece; without split all parts are
    found anew from them"""

    @model_validator(mode="after")
    def _one_kind(self) -> PartEdit:
        kinds = (bool(self.merge), self.rename is not None, self.split is not None or bool(self.seeds))
        whole = (self.rename is None) == (self.to is None) and (self.pieces is None or self.split is not None)
        if sum(kinds) != 1 or not whole:
            raise ValueError(
                "an edit is one of {merge: [a, b]}, {rename: a, to: b}, {split: a, pieces: 2}, "
                "{split: a, seeds: {b: [[x, y, z]]}} and {seeds: {a: [[x, y, z]], b: [[x, y, z]]}}"
            )
        if self.merge and len(set(self.merge)) < max(2, len(self.merge)):
            raise ValueError(f"merge needs two or more different parts, got {list(self.merge)}")
        if self.split is not None and (self.pieces is None) == (not self.seeds):
            raise ValueError(f"split of '{self.split}' needs either pieces, how many, or seeds, points on each")
        if self.split is None and len(self.seeds) == 1:
            raise ValueError("seeds need points on two or more parts, or split, the part that a single one is part of")
        if self.split is not None and list(self.seeds) == [self.split]:
            raise ValueError(f"split of '{self.split}' needs another name for the piece that is pointed at")
        return self

    @model_serializer(mode="wrap")
    def _what_is_said(self, whole: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Its kind alone, without the keys of the others."""
        return {key: value for key, value in whole(self).items() if value}

    @property
    def pieces_of(self) -> tuple[str, ...]:
        """Names of the parts that stand in the place of ``split``; of all parts where only ``seeds`` are given."""
        if self.pieces is not None:
            return tuple(f"{self.split}_{number}" for number in range(1, self.pieces + 1))
        remainder = () if self.split is None or len(self.seeds) > 1 else (self.split,)
        return tuple(dict.fromkeys((*self.seeds, *remainder)))


class Grouping(Section):
    """How the Gaussians are divided into parts (Paper: Sec. 3.2)."""

    backend: Literal["auto", "appearance", "file", "none"] = "auto"
    """auto: file where labels_file is given, else appearance (stand-in for SAM2); none: one part"""
    parts: Auto | Annotated[int, Field(ge=1, le=256)] = "auto"
    """number of parts for appearance; auto: as many as the colours say"""
    labels_file: FilePath | None = None
    """.npy or .npz with one whole number per Gaussian, in the input's order; or label maps of views: .npz or folder"""
    occlusion_threshold_rel: Annotated[float, Field(gt=0, le=1)] = 0.05
    """for label maps: how far a Gaussian may lie from the rendered depth and count as visible, of the longest side"""
    names: dict[Annotated[int, Field(ge=0, le=255)], PartName] = Field(default_factory=dict)
    """names by part number (numbered from the ground up), instead of part_0, part_1 ..."""
    edits: Annotated[tuple[PartEdit, ...], BeforeValidator(as_tuple)] = ()
    """corrections made after that, as by 'phys4dgen group': [{merge: [a, b]}, {rename: a, to: c},
    {split: c, pieces: 2}, {split: d, seeds: {e: [[x, y, z]]}}]"""

    @model_validator(mode="after")
    def _backend_has_its_file(self) -> Grouping:
        if self.backend == "file" and self.labels_file is None:
            raise ValueError("backend 'file' needs labels_file; name the file, or choose backend 'auto'")
        if self.backend in ("appearance", "none") and self.labels_file is not None:
            raise ValueError(f"labels_file is given but backend is '{self.backend}'; choose 'auto' or 'file'")
        if self.parts != "auto" and (self.backend in ("file", "none") or self.labels_file is not None):
            raise ValueError("parts is a choice of the appearance backend; remove it, or the labels_file")
        if len(set(self.names.values())) != len(self.names):
            raise ValueError(f"names: every part needs its own name, got {list(self.names.values())}")
        return self
