"""Section ``grouping``: the Gaussians are divided into parts, and the parts corrected."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from phys4dgen.scene.sections.models import Sam2
from phys4dgen.scene.sections.values import Auto, FilePath, PartName, Section, SeedPoints, as_tuple

__all__ = ["Grouping", "NamedPicture", "PartEdit", "ViewBox"]

Share = Annotated[float, Field(ge=0, le=1)]


class ViewBox(Section):
    """A box that a person has drawn in a view of the run."""

    view: Annotated[str, Field(min_length=1, max_length=64)]
    """name of the view in cameras.json"""
    corners: Annotated[tuple[Share, Share, Share, Share], BeforeValidator(as_tuple)]
    """left, top, right and bottom, in widths and heights of the picture"""

    @model_validator(mode="after")
    def _has_an_inside(self) -> ViewBox:
        left, top, right, bottom = self.corners
        if not (left < right and top < bottom):
            raise ValueError(f"corners: expected left, top, right, bottom with an inside, got {list(self.corners)}")
        return self


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
    boxes: dict[PartName, ViewBox] = Field(default_factory=dict)
    """with split and by sam2: a box round the piece of that name"""
    by: Literal["appearance", "sam2"] = "appearance"
    """of a split with one piece: what finds it from seeds or boxes"""

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
        pointed = {**self.seeds, **self.boxes}
        if self.by == "sam2" and (self.split is None or len(pointed) != 1 or len(self.seeds) + len(self.boxes) != 1):
            raise ValueError("by sam2 needs split and either seeds or a box for one piece")
        if self.boxes and self.by != "sam2":
            raise ValueError("boxes need by: sam2; colour and shape can follow points alone")
        if self.split is not None and (self.pieces is None) == (not pointed):
            raise ValueError(f"split of '{self.split}' needs either pieces, how many, or seeds, points on each")
        if self.split is None and len(self.seeds) == 1:
            raise ValueError("seeds need points on two or more parts, or split, the part that a single one is part of")
        if self.split is not None and list(pointed) == [self.split]:
            raise ValueError(f"split of '{self.split}' needs another name for the piece that is pointed at")
        return self

    @model_serializer(mode="wrap")
    def _what_is_said(self, whole: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Its kind alone, without the keys of the others."""
        return {key: value for key, value in whole(self).items() if value and value != "appearance"}

    @property
    def pieces_of(self) -> tuple[str, ...]:
        """Names of the parts that stand in the place of ``split``; of all parts where only ``seeds`` are given."""
        if self.pieces is not None:
            return tuple(f"{self.split}_{number}" for number in range(1, self.pieces + 1))
        remainder = () if self.split is None or len(self.seeds) > 1 else (self.split,)
        return tuple(dict.fromkeys((*self.seeds, *self.boxes, *remainder)))


class NamedPicture(Section):
    """A picture of the object with names on it, which reach the parts that they fit (Paper: Sec. 3.4)."""

    picture: FilePath
    """of the same object, from whatever side and in whatever light"""
    segments: FilePath
    """grey or indexed PNG of the same size: 0 for nothing, else the number of a segment"""
    names: Annotated[dict[Annotated[int, Field(ge=1, le=255)], PartName], Field(min_length=1)]
    """names by the numbers in segments"""
    compare: Literal["auto", "clip", "descriptor"] = "auto"
    """what a segment is compared with a part by; descriptor: colour and shape (stand-in for CLIP); auto: clip where its
    weights are on this machine"""

    @model_validator(mode="after")
    def _own_names(self) -> NamedPicture:
        if len(set(self.names.values())) != len(self.names):
            raise ValueError(f"names: every segment needs its own name, got {list(self.names.values())}")
        return self


class Grouping(Section):
    """How the Gaussians are divided into parts (Paper: Sec. 3.2)."""

    backend: Literal["auto", "sam2", "appearance", "file", "none"] = "auto"
    """auto: file where labels_file is given, else sam2 where its weights are on this machine, no number of parts is
    given and at most three minutes are predicted, else appearance (stand-in for SAM2); none: one part"""
    parts: Auto | Annotated[int, Field(ge=1, le=256)] = "auto"
    """number of parts for appearance; auto: as many as the colours say"""
    labels_file: FilePath | None = None
    """.npy or .npz with one whole number per Gaussian, in the input's order; or label maps of views: .npz or folder"""
    occlusion_threshold_rel: Annotated[float, Field(gt=0, le=1)] = 0.05
    """for label maps: how far a Gaussian may lie from the rendered depth and count as visible, of the longest side"""
    sam2: Sam2 = Field(default_factory=Sam2)
    """of the backend sam2, and of edits by sam2"""
    names: dict[Annotated[int, Field(ge=0, le=255)], PartName] = Field(default_factory=dict)
    """names by part number (numbered from the ground up), instead of part_0, part_1 ..."""
    named_picture: NamedPicture | None = None
    """a picture with names on it, which are given to the parts that they fit; names win over it"""
    edits: Annotated[tuple[PartEdit, ...], BeforeValidator(as_tuple)] = ()
    """corrections made after that, as by 'phys4dgen group': [{merge: [a, b]}, {rename: a, to: c},
    {split: c, pieces: 2}, {split: d, seeds: {e: [[x, y, z]]}}]"""

    @model_validator(mode="after")
    def _backend_has_its_file(self) -> Grouping:
        if self.backend == "file" and self.labels_file is None:
            raise ValueError("backend 'file' needs labels_file; name the file, or choose backend 'auto'")
        if self.backend in ("sam2", "appearance", "none") and self.labels_file is not None:
            raise ValueError(f"labels_file is given but backend is '{self.backend}'; choose 'auto' or 'file'")
        if self.parts != "auto" and (self.backend in ("sam2", "file", "none") or self.labels_file is not None):
            raise ValueError("parts is a choice of the appearance backend; remove it, or the labels_file")
        if len(set(self.names.values())) != len(self.names):
            raise ValueError(f"names: every part needs its own name, got {list(self.names.values())}")
        return self

    def with_paths_from(self, folder: Path) -> Grouping:
        """A copy whose relative paths are taken from ``folder``."""
        changed: dict[str, Any] = {"sam2": self.sam2.with_paths_from(folder)}
        if self.labels_file is not None:
            changed["labels_file"] = folder / self.labels_file
        if (named := self.named_picture) is not None:
            paths = {"picture": folder / named.picture, "segments": folder / named.segments}
            changed["named_picture"] = named.model_copy(update=paths)
        return self.model_copy(update=changed)
