"""Answers of a model, written by us after the paper's tables and its failure case (appendix B.3 and B.5)."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from phys4dgen.materials.mllm.reading import Reading, read_answer
from phys4dgen.materials.mllm.subimages import PartView, SubImages, make_sub_images


def number(best: float) -> dict[str, float]:
    return {"low": best / 2, "best": best, "high": best * 2}


def side(material: str, e_pa: float, density_kgm3: float, poisson: float, law: str = "neo_hookean") -> dict[str, Any]:
    return {
        "material": material,
        "law": law,
        "youngs_modulus_pa": number(e_pa),
        "density_kgm3": number(density_kgm3),
        "poisson_ratio": {"low": poisson, "best": poisson, "high": poisson},
        "yield_stress_pa": None,
        "friction_angle_deg": None,
    }


def part(letter: str, surface: dict[str, Any], interior: dict[str, Any] | None = None, **facts: Any) -> dict[str, Any]:
    return {
        "letter": letter,
        "what_it_is": "a part",
        "origin": "artificial",
        "shape": "solid",
        "thickness_m": None,
        "reason": "it looks like it",
        "surface": surface,
        "interior": surface if interior is None else interior,
        **facts,
    }


def answer(*parts: dict[str, Any], thing: str = "a thing", height_m: float = 0.3) -> dict[str, Any]:
    return {"object": thing, "height_m": number(height_m), "parts": list(parts)}


def readings(*answers: dict[str, Any]) -> list[Reading]:
    """As if these answers had come from a model."""
    letters = sorted({row["letter"] for one in answers for row in one["parts"]})
    return [read_answer(json.dumps(one), letters) for one in answers]


# ----------------------------------------------------------------------------------------------- the paper's tables


def _column(*counted: tuple[float, int]) -> list[float]:
    """Values with their counts, dealt out so that neighbours differ, as 50 independent answers would."""
    values = [value for value, count in counted for _ in range(count)]
    assert len(values) == 50
    return [values[i * 7 % 50] for i in range(50)]


_BODY_LOG_E = _column((6.0, 24), (5.699, 13), (5.301, 13))
_BODY_DENSITY = _column((100, 47), (300, 2), (350, 1))
_BODY_NU = _column((0.3, 41), (0.25, 4), (0.2, 5))
_SCARF_LOG_E = _column((7.699, 12), (7.0, 7), (7.301, 7), (9.0, 11), (9.301, 9), (8.699, 3), (9.477, 1))
_SCARF_DENSITY = _column((1500, 32), (1300, 8), (1000, 10))
_SCARF_NU = _column((0.4, 34), (0.3, 10), (0.35, 6))
_HAT_LOG_E = _column((7.699, 34), (8.301, 8), (8.477, 8))
_HAT_DENSITY = _column((200, 39), (300, 1), (900, 10))
_HAT_NU = _column((0.3, 37), (0.35, 10), (0.25, 3))


def snowman_answers() -> list[dict[str, Any]]:
    """Fifty answers with the statistics of the paper's table on the Snowman (A body, B scarf, C hat)."""
    answers = []
    for i in range(50):
        cloth = "fabric" if i < 37 else "wool"  # 74 %
        answers.append(
            answer(
                part("A", side("snow", 10 ** _BODY_LOG_E[i], _BODY_DENSITY[i], _BODY_NU[i], "snow"), origin="natural"),
                part("B", side(cloth, 10 ** _SCARF_LOG_E[i], _SCARF_DENSITY[i], _SCARF_NU[i]), shape="sheet"),
                part("C", side("felt", 10 ** _HAT_LOG_E[i], _HAT_DENSITY[i], _HAT_NU[i])),
                thing="a snowman with scarf and hat",
                height_m=1.2,
            )
        )
    return answers


CARNATION_LOG_E = {  # petal (A), stem (B), pot (C)
    "gpt-4o": (6.00, 7.176, 9.301),
    "gpt-o3": (6.00, 7.301, 9.176),
    "gemini-2.5-pro": (6.00, 7.00, 9.176),
}


def carnation_answers(model: str = "gpt-4o") -> list[dict[str, Any]]:
    """Five answers around the paper's values; the middle one is the paper's."""
    petal, stem, pot = (10**value for value in CARNATION_LOG_E[model])
    plastic, density_kgm3 = ("abs", 1030) if pot > 1.9e9 else ("polypropylene", 900)
    return [
        answer(
            part("A", side("petal", petal * f, 900, 0.3), origin="natural", shape="sheet", thickness_m=3e-4),
            part("B", side("herbaceous stem", stem * f, 900, 0.35), origin="natural"),
            part("C", side(plastic, pot * f, density_kgm3, 0.4)),
            thing="a potted carnation",
        )
        for f in (0.8, 1.0, 1.1, 1.0, 0.9)
    ]


def basketball_answers() -> list[dict[str, Any]]:
    """Five answers around the paper's 10^7 Pa."""
    return [
        answer(
            part("A", side("rubber", 10 ** (7 + shift), 1100, 0.48), shape="hollow", thickness_m=4e-3),
            thing="a basketball",
            height_m=0.24,
        )
        for shift in (0, -0.05, 0, 0.05, 0)
    ]


def red_flower_answers(origin: str = "natural") -> list[dict[str, Any]]:
    """The paper's failure: petals (A) and leaves (B) taken for plastic of 1 GPa, in every answer."""
    plastic = side("plastic", 1e9, 1020, 0.38)
    return [
        answer(
            part("A", plastic, origin=origin, shape="sheet"),
            part("B", plastic, origin=origin, shape="sheet"),
            thing="a red flower",
        )
        for _ in range(5)
    ]


# ------------------------------------------------------------------------------------------------------- pictures


def striped_view(parts: int, size_px: int = 120) -> PartView:
    """A view of ``parts`` upright stripes on white."""
    part_map = np.full((size_px, size_px), -1, np.int32)
    inside = slice(size_px // 6, -size_px // 6)
    for index, columns in enumerate(np.array_split(np.arange(10, size_px - 10), parts)):
        part_map[inside, columns] = index
    rng = np.random.default_rng(0)
    colors = rng.integers(30, 220, (parts + 1, 3)).astype(np.uint8)
    colors[-1] = 255
    return PartView(colors[part_map], part_map)


def striped_images(parts: int) -> SubImages:
    return make_sub_images(striped_view(parts), list, parts)
