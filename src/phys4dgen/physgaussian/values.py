"""Values of PhysGaussian's configuration: numbers, triples, and tables of keys."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

__all__ = ["Keys", "Seconds", "Triple", "as_tuple"]


def as_tuple(value: Any) -> Any:
    """JSON has lists only; in strict mode pydantic wants the tuple."""
    return tuple(value) if isinstance(value, list) else value


Number = Annotated[float, Field(ge=-1e9, le=1e9)]
Triple = Annotated[tuple[Number, Number, Number], BeforeValidator(as_tuple)]
Seconds = Annotated[float, Field(ge=-1e9, le=1e9)]


class Keys(BaseModel):
    """Keys that are checked; others are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)
