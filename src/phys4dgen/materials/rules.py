"""The rule table: a stand-in for the language model that names materials without any input from the user.

Paper: Sec. 3.4 (MLLM-Guided Material Identification), with rules on colour, shape, height and neighbours in the place
of the model. Every rule is one entry with the case it was made for and one that it gets wrong; the first that applies
decides. Where none does, neutral values keep the object moving plausibly. Either way the material carries a warning.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from phys4dgen.materials.features import PartFeatures, part_features
from phys4dgen.materials.library import find_entry, material
from phys4dgen.types import Continuum, Frame, Gaussians, Material, MaterialBook, PartMaterials, Parts

__all__ = ["DEFAULT_SOLID", "DEFAULT_THIN", "RULES", "Rule", "default_material", "identify_by_rules", "matching_rule"]

Neighbours = Mapping[str, PartFeatures]


@dataclass(frozen=True)
class Rule:
    """One row of the rule table.

    Attributes:
        name: short name for the report.
        says: the observation in words.
        material: library name that it concludes; empty for the part's own name.
        confidence: how often it is expected to be right where it applies, 0 to 1; an estimate, not a measurement.
        example: what it was made for.
        counter_example: what it would get wrong.
        applies: the observation, from the part's features and those of all parts by name.
    """

    name: str
    says: str
    material: str
    confidence: float
    example: str
    counter_example: str
    applies: Callable[[PartFeatures, Neighbours], bool]


def _is_green(part: PartFeatures) -> bool:
    return 95 <= part.hue_deg <= 185 and part.chroma > 6


def _is_foliage_color(part: PartFeatures) -> bool:
    """Green, or too dark to have a colour (leaves against the light)."""
    return _is_green(part) or (part.lightness < 35 and part.chroma < 12)


def _is_brown(part: PartFeatures) -> bool:
    return 25 <= part.hue_deg <= 90 and part.chroma > 6 and part.lightness < 55


def _grows(part: PartFeatures) -> bool:
    """Off the ground and thin, as far as anybody measured."""
    return not part.on_ground and part.is_thin is not False


def _is_container(part: PartFeatures, others: Neighbours) -> bool:
    """Stands on the ground or on a dish, is no foliage, and holds or carries something that grows."""
    low = part.foot < 0.15 and part.top < 0.75
    holds = [others[name] for name in (*part.encloses, *part.carries)]
    return low and not _is_green(part) and any(_grows(other) and _is_foliage_color(other) for other in holds)


def _in_container(part: PartFeatures, others: Neighbours) -> bool:
    return any(_is_container(others[name], others) for name in part.enclosed_by)


def _on_container(part: PartFeatures, others: Neighbours) -> bool:
    below = (others[name] for name in (*part.stands_on, *part.enclosed_by))
    return any(_is_container(other, others) for other in below)


def _is_petal(part: PartFeatures, others: Neighbours) -> bool:
    strong_color = part.chroma > 25 and not 95 <= part.hue_deg <= 185 and not _is_brown(part)
    has_leaves = any(_is_green(other) and _grows(other) for other in others.values())
    return _grows(part) and strong_color and part.top > 0.5 and has_leaves


RULES: tuple[Rule, ...] = (
    Rule(
        name="name",
        says="a part that bears the name of a material, as the user or a file of labels gave it",
        material="",
        confidence=0.9,
        example="parts called soil, leaves and petals",
        counter_example="a part called glass that is a drinking glass of plastic",
        applies=lambda part, others: find_entry(part.name) is not None,
    ),
    Rule(
        name="soil",
        says="a dark part that is no leaf, enclosed by a pot",
        material="garden_soil",
        confidence=0.8,
        example="potting soil inside a flower pot",
        counter_example="coffee in a cup with a sprig of mint",
        applies=lambda part, others: (
            part.lightness < 50
            and not (_is_green(part) and part.chroma > 15)
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
            and any(_is_container(others[name], others) for name in (*part.carries, *part.encloses))
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
            _is_container(part, others) and (part.lightness < 35 or (part.chroma > 35 and not 25 <= part.hue_deg <= 75))
        ),
    ),
    Rule(
        name="terracotta or glazed pot",
        says="a part low down that holds a plant and is white, grey, cream, orange or brown",
        material="ceramic",
        confidence=0.6,
        example="a white glazed or a terracotta flower pot",
        counter_example="a white plastic pot, a wooden planter",
        applies=_is_container,
    ),
    Rule(
        name="stem",
        says="a green rod above the ground",
        material="herbaceous_stem",
        confidence=0.7,
        example="the stalk of a tulip",
        counter_example="a green cable, the handle of a green toy",
        applies=lambda part, others: part.is_rod is True and _is_green(part) and not part.on_ground,
    ),
    Rule(
        name="leaf",
        says="a green thin part above the ground",
        material="leaf_blade",
        confidence=0.8,
        example="the leaves of a houseplant",
        counter_example="green felt, a green plastic toy plant",
        applies=lambda part, others: _is_green(part) and _grows(part),
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
            and _is_brown(part)
            and part.top - part.foot > 1.5 * part.width
            and _on_container(part, others)
        ),
    ),
)
"""Tried from the first to the last."""

DEFAULT_SOLID = Material(
    name="default_solid",
    law="neo_hookean",
    density_kgm3=300.0,
    youngs_modulus_pa=2e5,
    poisson_ratio=0.3,
    source="default",
    warnings=("no rule knows this part: neutral values of a soft solid; name its material with --material",),
)
DEFAULT_THIN = Material(
    name="default_thin",
    law="neo_hookean",
    density_kgm3=800.0,
    youngs_modulus_pa=1e8,
    poisson_ratio=0.3,
    source="default",
    warnings=("no rule knows this part: neutral values of a sheet or rod; name its material with --material",),
)


def identify_by_rules(
    gaussians: Gaussians, parts: Parts, frame: Frame, continuum: Continuum | None = None
) -> MaterialBook:
    """Name the material of every part from how it looks and where it stands; surface and interior alike.

    Args:
        gaussians: N static Gaussians.
        parts: their parts.
        frame: which way is up.
        continuum: the particles, which know what is thin; without them no part is taken for a rod.
    """
    features = part_features(gaussians, parts, frame, continuum)
    others = {part.name: part for part in features}
    book: dict[str, PartMaterials] = {}
    for part in features:
        rule = matching_rule(part, others)
        chosen = default_material(part) if rule is None else _concluded(rule, part)
        book[part.name] = PartMaterials(surface=chosen, interior=chosen)
    return MaterialBook(book)


def matching_rule(part: PartFeatures, others: Neighbours) -> Rule | None:
    """The first rule that applies to a part, or None."""
    return next((rule for rule in RULES if rule.applies(part, others)), None)


def default_material(part: PartFeatures) -> Material:
    """Neutral values for a part that no rule knows."""
    return DEFAULT_THIN if part.is_thin else DEFAULT_SOLID


def _concluded(rule: Rule, part: PartFeatures) -> Material:
    warning = (
        f"guessed by rule '{rule.name}' ({rule.says}; confidence {rule.confidence:g}); it would be wrong for "
        f"{rule.counter_example}"
    )
    return replace(material(rule.material or part.name), source="rule", warnings=(warning,))
