"""Types of values in a scene, and what every section of it is: frozen, strict, without unknown keys."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Discriminator, Field, PlainSerializer
from pydantic_core import PydanticCustomError

__all__ = [
    "ALL_PARTS",
    "Auto",
    "AxisName",
    "Direction",
    "FilePath",
    "Length",
    "ObjectName",
    "PartAddress",
    "PartName",
    "Positive",
    "Section",
    "SeedPoints",
    "Vector",
    "as_tuple",
    "kind_of",
]

ALL_PARTS = "all"
"""In a force: every part that is not held."""


def _vector(value: Any) -> Any:
    """Three numbers, given as a list, a tuple or text as in a flag (``"1,0,0"``)."""
    words = value.split(",") if isinstance(value, str) else value
    try:
        if not isinstance(words, (list, tuple)) or len(words) != 3 or any(isinstance(word, bool) for word in words):
            raise ValueError
        return tuple(float(word) for word in words)
    except (ValueError, TypeError, OverflowError):
        raise PydanticCustomError("vector", "three numbers such as [1, 0, 0]") from None


def _nonzero(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    if math.hypot(*vector) < 1e-9:
        raise ValueError("expected a direction, got a vector of length 0")
    return vector


def as_tuple(value: Any) -> Any:
    """YAML has lists only; in strict mode pydantic wants the tuple."""
    return tuple(value) if isinstance(value, list) else value


def kind_of(default: str) -> Discriminator:
    """Chooses the member of a union by its key ``kind``; ``default`` where it is left out."""
    return Discriminator(
        lambda value: value.get("kind", default) if isinstance(value, dict) else getattr(value, "kind", None)
    )


Vector = Annotated[tuple[float, float, float], BeforeValidator(_vector)]
Direction = Annotated[tuple[float, float, float], BeforeValidator(_vector), AfterValidator(_nonzero)]
FilePath = Annotated[
    Path,
    BeforeValidator(lambda value: Path(value) if isinstance(value, str) and value else value),
    PlainSerializer(lambda value: value.as_posix(), return_type=str),
]
PartName = Annotated[str, Field(pattern=r"^[^\W\d][\w -]{0,63}$")]
ObjectName = Annotated[str, Field(pattern=r"^[^\W\d][\w-]{0,63}$")]
"""Of one of several objects; also the name of a folder."""
PartAddress = Annotated[str, Field(pattern=r"^[^\W\d][\w -]{0,63}(/[^\W\d][\w -]{0,63})?$")]
"""A part; where there are several objects ``object/part``, or the name of an object for all of its parts."""
SeedPoints = Annotated[tuple[Vector, ...], BeforeValidator(as_tuple), Field(min_length=1, max_length=100)]
Auto = Literal["auto"]
AxisName = Literal["auto", "x", "+x", "-x", "y", "+y", "-y", "z", "+z", "-z"]
Positive = Annotated[float, Field(gt=0, le=1e6)]
Length = Annotated[float, Field(gt=0, le=1e9)]
"""In the input's units."""


class Section(BaseModel):
    """Keys with values that are checked once and never change."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, use_attribute_docstrings=True
    )
