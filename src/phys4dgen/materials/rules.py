"""The rule table: a stand-in for the language model that names materials without any input from the user.

Paper: Sec. 3.4 (MLLM-Guided Material Identification), with rules on colour, shape, height and neighbours in the place
of the model. Every rule is one entry with the case it was made for and one that it gets wrong; the first that applies
decides. Where none does, neutral values keep the object moving plausibly. Either way the material carries a warning.
"""

from __future__ import annotations

from dataclasses import replace

from phys4dgen.materials.everyday_rules import EVERYDAY_RULES
from phys4dgen.materials.features import PartFeatures, part_features
from phys4dgen.materials.library import find_entry, material
from phys4dgen.materials.plant_rules import PLANT_RULES
from phys4dgen.materials.rule import Neighbours, Rule
from phys4dgen.types import Continuum, Frame, Gaussians, Material, MaterialBook, PartMaterials, Parts

__all__ = ["DEFAULT_SOLID", "DEFAULT_THIN", "RULES", "Rule", "default_material", "identify_by_rules", "matching_rule"]

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
    *PLANT_RULES,
    *EVERYDAY_RULES,
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
