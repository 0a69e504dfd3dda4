"""What a multimodal model is asked to answer, as a JSON schema (Paper: Sec. 3.4, surface and internal per part).

The schema is strict (every field required, nothing else allowed) and holds no bounds: providers refuse schemas with
bounds, and servers may ignore the schema altogether, so every number is judged after the answer is read (``reading``).
"""

from __future__ import annotations

from typing import Any, Literal, get_args

from pydantic import BaseModel, ConfigDict

__all__ = ["ASKED_LAWS", "Answer", "PartAnswer", "Range", "Side", "json_schema"]

Law = Literal["neo_hookean", "fixed_corotated", "von_mises", "drucker_prager", "snow", "viscoplastic", "fluid"]
ASKED_LAWS: tuple[str, ...] = get_args(Law)


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid")


class Range(_Strict):
    """A number as an interval and its best value."""

    low: float
    best: float
    high: float


class Side(_Strict):
    """The material of a surface or of an interior."""

    material: str
    law: Law
    youngs_modulus_pa: Range
    density_kgm3: Range
    poisson_ratio: Range
    yield_stress_pa: Range | None
    friction_angle_deg: Range | None


class PartAnswer(_Strict):
    """One lettered part."""

    letter: str
    what_it_is: str
    origin: Literal["natural", "artificial"]
    shape: Literal["solid", "hollow", "sheet"]
    thickness_m: float | None
    reason: str
    surface: Side
    interior: Side


class Answer(_Strict):
    """The whole answer."""

    object: str
    height_m: Range
    parts: list[PartAnswer]


def json_schema() -> dict[str, Any]:
    """The schema as a prompt can carry it, for servers that take no schema beside it."""
    return Answer.model_json_schema()
