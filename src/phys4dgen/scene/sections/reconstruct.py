"""Section ``reconstruct``: a picture or a mesh becomes Gaussians."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from phys4dgen.scene.sections.values import FilePath, Section, as_tuple

__all__ = ["Reconstruct"]


class Reconstruct(Section):
    """How a picture or a mesh becomes Gaussians (Paper: Sec. 3.1); of no effect on a splat."""

    backend: Literal["auto", "inflate", "lgm", "command"] = "auto"
    """inflate: from the outline (stand-in for LGM); lgm: by that network; command: the program argv; auto: lgm where
    checkpoint, views and torch are there, else inflate"""
    checkpoint: FilePath | None = None
    """of lgm: its public weights, model_fp16_fixrot.safetensors"""
    views: Annotated[tuple[FilePath, ...], BeforeValidator(as_tuple)] = ()
    """of lgm: four square pictures of the object on white or on nothing: front, from the viewer's right, back, from the
    viewer's left (docs/lgm.md)"""
    argv: Annotated[tuple[str, ...], BeforeValidator(as_tuple)] = ()
    """of command: program and arguments, {image} for the RGBA picture, {out} for the .ply to write, splat or mesh, or
    {out.splat}, {out.glb}, {out.obj}, {out.stl}; no shell"""
    timeout_s: Annotated[float, Field(gt=0, le=86_400)] = 1800.0
    """of command: it is ended after this time"""
    mask: FilePath | None = None
    """picture of the same section, white where the object is"""
    matte_model: FilePath | None = None
    """ONNX file of U2-Net or IS-Net that finds the object; null: alpha channel, a model of rembg, or border colour"""
    front_gaussians: Annotated[int, Field(ge=2000, le=200_000)] = 40_000
    """Gaussians towards the camera; all together are some three times as many"""
    thickness_rel: Annotated[float, Field(ge=0.1, le=3)] = 1.0
    """depth of the object relative to what its outline says"""
    mesh_gaussians: Annotated[int, Field(ge=1000, le=500_000)] = 100_000
    """of a mesh, given or made by argv: about so many Gaussians lie in its surface"""

    @model_validator(mode="after")
    def _one_way_to_find_the_object(self) -> Reconstruct:
        if self.mask is not None and self.matte_model is not None:
            raise ValueError("mask and matte_model both say where the object is; keep one of them")
        return self

    @model_validator(mode="after")
    def _lgm_has_its_files(self) -> Reconstruct:
        if self.backend == "lgm" and self.checkpoint is None:
            raise ValueError("backend 'lgm' needs checkpoint, the file model_fp16_fixrot.safetensors")
        if (self.checkpoint is not None and len(self.views) != 4) or (self.checkpoint is None and self.views):
            raise ValueError(f"lgm needs checkpoint and four views together, got {len(self.views)} views")
        if self.checkpoint is not None and self.backend not in ("auto", "lgm"):
            raise ValueError(f"checkpoint is given but backend is '{self.backend}'; choose 'lgm'")
        return self

    @model_validator(mode="after")
    def _command_has_its_words(self) -> Reconstruct:
        if self.backend == "command" and not any("{out" in word for word in self.argv[1:]):
            raise ValueError("backend 'command' needs argv, a program and its arguments with {image} and {out}")
        if self.backend != "command" and self.argv:
            raise ValueError(f"argv is given but backend is '{self.backend}'; choose 'command'")
        return self

    def with_paths_from(self, folder: Path) -> Reconstruct:
        """A copy whose relative paths are taken from ``folder``."""
        named = {name: getattr(self, name) for name in ("mask", "matte_model", "checkpoint")}
        paths: dict[str, Any] = {name: folder / path for name, path in named.items() if path is not None}
        paths["views"] = tuple(folder / path for path in self.views)
        return self.model_copy(update=paths)
