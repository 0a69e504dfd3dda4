"""Rules for pots and what grows in them."""

from __future__ import annotations

from phys4dgen.materials.features import PartFeatures
from phys4dgen.materials.rule import Neighbours, Rule, is_brown, is_green

__all__ = ["PLANT_RULES", "is_plant_pot"]


def _is_foliage_color(part: PartFeatures) -> bool:
    """Green, or too dark to have a colour (leaves against the light)."""
    return is_green(part) or (part.lightness < 35 and part.chroma < 12)


def _grows(part: PartFeatures) -> bool:
    """Off the ground and thin, as far as anybody measured."""
    return not part.on_ground and part.is_thin is not False


def is_plant_pot(part: PartFeatures, others: Neighbours) -> bool:
    """Stands on the ground or on a dish, is no foliage, and holds or carries something that grows."""
    low = part.foot < 0.15 and part.top < 0.75
    holds = [others[name] for name in (*part.encloses, *part.carries)]
    return low and not is_green(part) and any(_grows(other) and _is_foliage_color(other) for other in holds)


def _in_container(part: PartFeatures, others: Neighbours) -> bool:
    return any(is_plant_pot(others[name], others) for name in part.enclosed_by)


def _on_container(part: PartFeatures, others: Neighbours) -> bool:
    below = (others[name] for name in (*part.stands_on, *part.enclosed_by))
    return any(is_plant_pot(other, others) for other in below)


def _is_petal(part: PartFeatures, others: Neighbours) -> bool:
    strong_color = part.chroma > 25 and not 95 <= part.hue_deg <= 185 and not is_brown(part)
    has_leaves = any(is_green(other) and _grows(other) for other in others.values())
    return _grows(part) and strong_color and part.top > 0.5 and has_leaves


PLANT_RULES: tuple[Rule, ...] = (
    Rule(
        name="soil",
        says="a dark part that is no leaf, enclosed by a pot",
        material="garden_soil",
        confidence=0.8,
        example="potting soil inside a flower pot",
        counter_example="coffee in a cup with a sprig of mint",
        applies=lambda part, others: (
            part.lightness < 50
            and not (is_green(part) and part.chroma > 15)
            and part.top < 0.6
            and not part.is_rod
            and _in_container(part, others)
        ),
    ),
    Rule(
        name="dish",
        says="a low part on the ground under a pot",
        material="ceramic",
        confidence=0.4,
        example="the saucer of a flower pot",
        counter_example="a plastic saucer, a wooden table top, the shadow under the pot",
        applies=lambda part, others: (
            part.on_ground
            and part.top < 0.15
            and any(is_plant_pot(others[name], others) for name in (*part.carries, *part.encloses))
        ),
    ),
    Rule(
        name="dark or coloured pot",
        says="a part low down that holds a plant and is black, or of a strong colour that fired clay seldom has",
        material="polypropylene",
        confidence=0.5,
        example="the black nursery pot of a palm",
        counter_example="a pot with a black or blue glaze",
        applies=lambda part, others: (
            is_plant_pot(part, others) and (part.lightness < 27 or (part.chroma > 35 and not 25 <= part.hue_deg <= 75))
        ),
    ),
    Rule(
        name="terracotta or glazed pot",
        says="a part low down that holds a plant and is white, grey, cream, orange or brown",
        material="ceramic",
        confidence=0.6,
        example="a white glazed or a terracotta flower pot",
        counter_example="a white plastic pot, a wooden planter",
        applies=is_plant_pot,
    ),
    Rule(
        name="stem",
        says="a green rod above the ground",
        material="herbaceous_stem",
        confidence=0.7,
        example="the stalk of a tulip",
        counter_example="a green cable, the handle of a green toy",
        applies=lambda part, others: part.is_rod is True and is_green(part) and not part.on_ground,
    ),
    Rule(
        name="leaf",
        says="a green thin part above the ground",
        material="leaf_blade",
        confidence=0.8,
        example="the leaves of a houseplant",
        counter_example="green felt, a green plastic toy plant",
        applies=lambda part, others: is_green(part) and _grows(part),
    ),
    Rule(
        name="leaf against the light",
        says="a thin part on a pot, too dark to show a colour",
        material="leaf_blade",
        confidence=0.5,
        example="the long dark leaves of a palm",
        counter_example="black wire ornaments stuck into a pot",
        applies=lambda part, others: _grows(part) and _is_foliage_color(part) and _on_container(part, others),
    ),
    Rule(
        name="petal",
        says="a thin part of a strong colour other than green and brown, high up on an object with green parts",
        material="petal",
        confidence=0.7,
        example="the petals of a carnation",
        counter_example="a paper flag on a green stick",
        applies=_is_petal,
    ),
    Rule(
        name="heart of a flower",
        says="a small part enclosed by petals",
        material="parenchyma",
        confidence=0.5,
        example="the yellow middle of a daisy",
        counter_example="a glass bead or a bee on a flower",
        applies=lambda part, others: (
            part.area_share < 0.1 and any(_is_petal(others[name], others) for name in part.enclosed_by)
        ),
    ),
    Rule(
        name="trunk",
        says="a brown part that rises out of a pot",
        material="hardwood",
        confidence=0.6,
        example="the trunk of a ponytail palm or a bonsai",
        counter_example="a stick of cinnamon, a rope",
        applies=lambda part, others: (
            not part.on_ground
            and is_brown(part)
            and part.top - part.foot > 1.5 * part.width
            and _on_container(part, others)
        ),
    ),
)
"""Tried in this order."""
