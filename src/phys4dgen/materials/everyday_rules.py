"""Rules for food, toys, tools, clothes and heaps: what everyday things of a colour and shape are mostly made of."""

from __future__ import annotations

from phys4dgen.materials.features import PartFeatures
from phys4dgen.materials.plant_rules import is_plant_pot
from phys4dgen.materials.rule import Neighbours, Rule, is_green

__all__ = ["EVERYDAY_RULES"]

_BALL = 0.12
"""Greatest spread of the distance from the centre, over its mean, that a ball has."""


def _is_grey(part: PartFeatures) -> bool:
    return part.chroma < 9


def _is_tan(part: PartFeatures) -> bool:
    """Straw, sand, wood and crust."""
    return 50 <= part.hue_deg <= 100 and 10 <= part.chroma <= 45


def _is_bread(part: PartFeatures) -> bool:
    """Tan, and wider than high in itself: a bun, a loaf."""
    return _is_tan(part) and part.chroma > 25 and 20 < part.lightness < 75 and part.on_ground and part.width > 0.4


def _in_sandwich(part: PartFeatures, others: Neighbours) -> bool:
    """A layer off the ground that is as wide as a bread which reaches below and above it."""
    return any(
        _is_bread(bread)
        and bread.name != part.name
        and bread.foot < part.foot
        and bread.top > part.top
        and 0.7 < part.width / bread.width < 1.5
        for bread in others.values()
    )


def _is_sandwich(part: PartFeatures, others: Neighbours) -> bool:
    return _is_bread(part) and any(_in_sandwich(other, {part.name: part}) for other in others.values())


def _covers_sandwich(part: PartFeatures, others: Neighbours) -> bool:
    """Of a crust's hue, as wide as a sandwich below it, and the highest of it."""
    crust = 45 <= part.hue_deg <= 95 and part.chroma > 15 and part.lightness > 35
    wide = part.area_share > 0.1 and not part.on_ground and not _in_sandwich(part, others)
    return (
        crust
        and wide
        and any(
            _is_sandwich(heel, others)
            and heel.name != part.name
            and part.top > heel.top
            and 0.5 < part.width / heel.width < 1.5
            for heel in others.values()
        )
    )


def _is_vessel(part: PartFeatures, others: Neighbours) -> bool:
    """Stands on the ground and holds something that fills it from wall to wall, but no plant."""
    holds = any(_fills(others[name], part) for name in part.encloses)
    return part.on_ground and holds and not is_plant_pot(part, others)


def _fills(part: PartFeatures, vessel: PartFeatures) -> bool:
    return part.width > 0.4 * vessel.width and part.foot > vessel.foot + 0.03


def _is_level(part: PartFeatures) -> bool:
    return part.top - part.foot < 0.15


def _in_vessel(part: PartFeatures, others: Neighbours) -> bool:
    around = (others[name] for name in part.enclosed_by)
    return any(_fills(part, other) and _is_vessel(other, others) for other in around)


def _is_sand(part: PartFeatures) -> bool:
    pale = 65 <= part.hue_deg <= 100 and 12 <= part.chroma <= 30 and part.lightness > 40
    heap = part.roundness > _BALL and part.is_thin is not True and part.foot < 0.2 and part.width > 0.25
    return pale and heap and part.area_share > 0.3


def _is_plastic(part: PartFeatures) -> bool:
    return part.chroma > 40 and part.is_thin is not True and not is_green(part)


def _on_plastic(part: PartFeatures, others: Neighbours) -> bool:
    """A solid on an object that is mostly one piece of plastic."""
    return part.is_thin is not True and any(
        _is_plastic(other) and other.area_share > 0.5 and other.name != part.name for other in others.values()
    )


def _is_slender(part: PartFeatures) -> bool:
    return part.is_rod is True or part.top - part.foot > 3 * part.width


EVERYDAY_RULES: tuple[Rule, ...] = (
    Rule(
        name="liquid in a vessel",
        says="a level surface that a vessel on the ground encloses from wall to wall",
        material="water",
        confidence=0.6,
        example="coffee in a cup, soup in a bowl",
        counter_example="the lid of a jar, a cake in its tin",
        applies=lambda part, others: _is_level(part) and not part.on_ground and _in_vessel(part, others),
    ),
    Rule(
        name="vessel",
        says="a part on the ground that holds another one from wall to wall",
        material="ceramic",
        confidence=0.5,
        example="a cup, a vase",
        counter_example="a bucket of plastic, a saucepan, a basket",
        applies=lambda part, others: _is_vessel(part, others) and part.chroma < 45,
    ),
    Rule(
        name="bread",
        says="a wide tan part on the ground with layers of its own width in it",
        material="bread",
        confidence=0.7,
        example="the two halves of a bun",
        counter_example="a stack of wooden boards with mats between them",
        applies=_is_sandwich,
    ),
    Rule(
        name="bread above",
        says="a part of a crust's hue on top of a sandwich, as wide as that",
        material="bread",
        confidence=0.6,
        example="the upper half of a bun that differs from the lower one in colour",
        counter_example="a fried egg on a burger without its lid",
        applies=_covers_sandwich,
    ),
    Rule(
        name="leaves in a sandwich",
        says="a green layer in bread",
        material="lettuce_leaf",
        confidence=0.8,
        example="lettuce in a hamburger",
        counter_example="slices of gherkin",
        applies=lambda part, others: is_green(part) and _in_sandwich(part, others),
    ),
    Rule(
        name="cheese in a sandwich",
        says="a thin yellow or orange layer in bread",
        material="cheese",
        confidence=0.6,
        example="the slice of cheese of a cheeseburger",
        counter_example="a fried egg, mustard",
        applies=lambda part, others: (
            65 <= part.hue_deg <= 105 and part.chroma > 8 and part.top - part.foot < 0.15 and _in_sandwich(part, others)
        ),
    ),
    Rule(
        name="meat in a sandwich",
        says="a dark or brown layer in bread",
        material="meat_grilled",
        confidence=0.6,
        example="the patty of a hamburger",
        counter_example="chocolate cream",
        applies=lambda part, others: (
            (part.lightness < 35 or 15 <= part.hue_deg <= 65) and not is_green(part) and _in_sandwich(part, others)
        ),
    ),
    Rule(
        name="ball or balloon",
        says="a coloured part as round as a ball, a third of the object or more",
        material="natural_rubber",
        confidence=0.5,
        example="a basketball, a balloon",
        counter_example="an orange, a billiard ball, a glass bauble",
        applies=lambda part, others: part.roundness < _BALL and part.chroma > 15 and part.area_share > 0.3,
    ),
    Rule(
        name="snow",
        says="a large white solid on the ground that holds nothing",
        material="snow_packed",
        confidence=0.4,
        example="the body of a snowman",
        counter_example="a plaster bust, a white appliance",
        applies=lambda part, others: (
            part.lightness > 60
            and part.chroma < 7
            and part.on_ground
            and part.area_share > 0.4
            and part.is_thin is not True
        ),
    ),
    Rule(
        name="stick",
        says="a slender tan or brown part",
        material="softwood",
        confidence=0.6,
        example="a flagpole, a broomstick",
        counter_example="a brass rod, a pretzel stick",
        applies=lambda part, others: (
            _is_tan(part) and part.chroma > 15 and part.is_thin is not True and _is_slender(part)
        ),
    ),
    Rule(
        name="handle",
        says="a tan or brown part that bears a grey one",
        material="hardwood",
        confidence=0.6,
        example="the handle of a hammer",
        counter_example="a leather grip",
        applies=lambda part, others: (
            _is_tan(part)
            and part.chroma > 15
            and part.is_thin is not True
            and any(_is_grey(others[name]) and 25 < others[name].lightness < 70 for name in part.carries)
        ),
    ),
    Rule(
        name="metal head",
        says="a grey part on a tan or brown one",
        material="steel",
        confidence=0.5,
        example="the head of a hammer or an axe",
        counter_example="a stone on a wooden base, a rubber mallet",
        applies=lambda part, others: (
            _is_grey(part)
            and 25 < part.lightness < 70
            and part.is_thin is not True
            and any(_is_tan(others[name]) for name in part.stands_on)
        ),
    ),
    Rule(
        name="sand",
        says="a large pale tan solid, wide and low down",
        material="sand_damp",
        confidence=0.4,
        example="a sandcastle",
        counter_example="a sandstone sculpture, a loaf of bread, a cardboard box",
        applies=lambda part, others: _is_sand(part),
    ),
    Rule(
        name="ground under sand",
        says="a low part on the ground of a sand's hue, under it",
        material="sand_dry",
        confidence=0.4,
        example="the loose sand around a sandcastle",
        counter_example="the wooden tray of a sandpit",
        applies=lambda part, others: (
            part.on_ground
            and part.top < 0.3
            and any(_is_sand(others[name]) and abs(others[name].hue_deg - part.hue_deg) < 20 for name in part.carries)
        ),
    ),
    Rule(
        name="block of wood",
        says="a tan solid on the ground that carries something",
        material="softwood",
        confidence=0.4,
        example="a wooden base or toy block",
        counter_example="a cardboard box, a cork",
        applies=lambda part, others: (
            _is_tan(part) and part.chroma > 20 and part.on_ground and part.is_thin is not True and bool(part.carries)
        ),
    ),
    Rule(
        name="cord",
        says="a thin rod that is not green and no part of a plant in a pot",
        material="cotton_fabric",
        confidence=0.5,
        example="the string of a balloon",
        counter_example="a wire, a plastic cable",
        applies=lambda part, others: (
            part.is_rod is True
            and not is_green(part)
            and not any(is_plant_pot(other, others) for other in others.values())
        ),
    ),
    Rule(
        name="cloth",
        says="a thin sheet that is not green and no part of a plant in a pot",
        material="cotton_fabric",
        confidence=0.5,
        example="a flag, a curtain",
        counter_example="a sheet of paper, a plastic foil",
        applies=lambda part, others: (
            part.is_thin is True
            and not part.is_rod
            and not is_green(part)
            and not any(is_plant_pot(other, others) for other in others.values())
        ),
    ),
    Rule(
        name="scarf or band",
        says="a coloured band as wide as the part that it lies around",
        material="felt",
        confidence=0.5,
        example="the scarf of a snowman, the ribbon of a hat",
        counter_example="a painted stripe, a rubber ring",
        applies=lambda part, others: (
            part.chroma > 15
            and not is_green(part)
            and not part.on_ground
            and part.top - part.foot < 0.3
            and part.area_share < 0.2
            and any(
                other.foot < part.foot and other.top > part.top and part.width / other.width > 0.5
                for other in others.values()
            )
        ),
    ),
    Rule(
        name="hat",
        says="a dark dull part that sits on top of everything",
        material="felt",
        confidence=0.4,
        example="the top hat of a snowman",
        counter_example="the black plastic cap of a bottle",
        applies=lambda part, others: (
            part.lightness < 35 and part.chroma < 20 and part.foot > 0.6 and part.top > 0.95 and bool(part.stands_on)
        ),
    ),
    Rule(
        name="plastic",
        says="a solid of a strong colour",
        material="abs",
        confidence=0.4,
        example="toys and appliances",
        counter_example="a tomato, a painted piece of wood, a wax candle",
        applies=lambda part, others: _is_plastic(part),
    ),
    Rule(
        name="part of a plastic thing",
        says="a solid that nothing else explains, on an object that is mostly one piece of plastic",
        material="abs",
        confidence=0.3,
        example="the painted ball and eyes of a toy duck",
        counter_example="the rubber tyres of a toy car",
        applies=_on_plastic,
    ),
)
"""Tried in this order."""
