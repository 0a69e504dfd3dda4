"""Section ``select``: the object inside a captured scene."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, model_validator
from pydantic_core import PydanticCustomError

from phys4dgen.scene.sections.values import FilePath, PartName, Section

__all__ = ["Select"]


def _numbers(count: int, example: str) -> BeforeValidator:
    """So many numbers, given as a list, a tuple or text as in a flag (``"0,0,0,1"``)."""

    def numbers(value: Any) -> Any:
        words = value.split(",") if isinstance(value, str) else value
        try:
            if not isinstance(words, (list, tuple)) or len(words) != count or any(isinstance(w, bool) for w in words):
                raise ValueError
            return tuple(float(word) for word in words)
        except (ValueError, TypeError, OverflowError):
            raise PydanticCustomError("numbers", f"{count} numbers such as {example}") from None  # pyright: ignore[reportArgumentType]

    return BeforeValidator(numbers)


def _labels(value: Any) -> Any:
    """Numbers and names, given as a list or as text in a flag (``"3,plant"``)."""
    words = value.split(",") if isinstance(value, str) else value if isinstance(value, (list, tuple)) else [value]
    stripped = [word.strip() if isinstance(word, str) else word for word in words]
    return tuple(int(word) if isinstance(word, str) and word.isdecimal() else word for word in stripped)


class Select(Section):
    """Which Gaussians are the object, where a scene was captured around it; all of them if nothing is said.

    Only the object is divided into parts, filled and moved; size and up are its own. The rest is as it was, to the bit,
    in every frame.
    """

    box: Annotated[tuple[float, float, float, float, float, float], _numbers(6, "[0, 0, 0, 1, 1, 1]")] | None = None
    """[x0, y0, z0, x1, y1, z1] in the input's coordinates: centres inside it are the object"""
    sphere: Annotated[tuple[float, float, float, float], _numbers(4, "[0, 0, 0, 0.5]")] | None = None
    """[x, y, z, radius] in the input's coordinates; with box: inside both"""
    labels_file: FilePath | None = None
    """.npy or .npz with one whole number per Gaussian, as for grouping.labels_file; -1 is allowed"""
    labels: Annotated[tuple[int | PartName, ...], BeforeValidator(_labels)] = ()
    """numbers or names in labels_file that are the object; with box or sphere: of these those inside"""
    rest: Literal["static", "hide"] = "static"
    """what is not the object is shown where it is, or is fully transparent in film and frames"""

    @model_validator(mode="after")
    def _makes_sense(self) -> Select:
        if self.box is not None and not all(low < high for low, high in zip(self.box[:3], self.box[3:], strict=True)):
            raise ValueError(f"box: expected x0 < x1, y0 < y1 and z0 < z1, got {list(self.box)}")
        if self.sphere is not None and self.sphere[3] <= 0:
            raise ValueError(f"sphere: expected a radius greater than 0, got {self.sphere[3]:g}")
        if (self.labels_file is None) != (not self.labels):
            raise ValueError("labels and labels_file belong together; give both, or neither")
        return self

    @property
    def selects_all(self) -> bool:
        """Nothing is said, so that everything is the object."""
        return self.box is None and self.sphere is None and self.labels_file is None

    def with_paths_from(self, folder: Path) -> Select:
        """A copy whose relative paths are taken from ``folder``."""
        if self.labels_file is None:
            return self
        return self.model_copy(update={"labels_file": folder / self.labels_file})
