"""Section ``reconstruct``: a picture becomes Gaussians."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, model_validator

from phys4dgen.scene.sections.values import FilePath, Section, as_tuple

__all__ = ["Reconstruct"]


class Reconstruct(Section):
    """How a picture becomes Gaussians (Paper: Sec. 3.1); of no effect on a splat."""

    backend: Literal["auto", "inflate", "command"] = "auto"
    """inflate: from the outline (stand-in for LGM); command: the program argv; auto: inflate"""
    argv: Annotated[tuple[str, ...], BeforeValidator(as_tuple)] = ()
    """of command: program and arguments, {image} for the RGBA picture, {out} for the .ply to write; no shell"""
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

    @model_validator(mode="after")
    def _one_way_to_find_the_object(self) -> Reconstruct:
        if self.mask is not None and self.matte_model is not None:
            raise ValueError("mask and matte_model both say where the object is; keep one of them")
        return self

    @model_validator(mode="after")
    def _command_has_its_words(self) -> Reconstruct:
        if self.backend == "command" and not any("{out}" in word for word in self.argv[1:]):
            raise ValueError("backend 'command' needs argv, a program and its arguments with {image} and {out}")
        if self.backend != "command" and self.argv:
            raise ValueError(f"argv is given but backend is '{self.backend}'; choose 'command'")
        return self
