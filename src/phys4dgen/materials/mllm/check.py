"""What the answers agree on, held against the library and against the rule table.

Two checks, because one is not enough. The library knows the range of a named material: a petal of 1 GPa is outside.
It cannot catch a material that was misread alike in all answers: plastic petals of 1 GPa are fine plastic (the paper's
failure case, appendix B.3). For that there is a second opinion from shape, colour and place: where the rule table
knows the part and differs by more than 1.5 decades of stiffness, it is said, and whether the part is natural or
artificial decides. A natural thing of plastic contradicts itself, and is caught at any stiffness.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from phys4dgen.materials.library import LibraryEntry, Quantity, find_entry
from phys4dgen.materials.mllm.consensus import Origin, PartConsensus, SideConsensus
from phys4dgen.types import Material, PartMaterials, wrong_number

__all__ = ["MAX_DISAGREEMENT_DECADES", "MAX_SPREAD_DECADES", "Checked", "check_part"]

MAX_SPREAD_DECADES = 1.0
MAX_DISAGREEMENT_DECADES = 1.5
_NATURAL_KINDS = ("plant", "wood", "snow", "ice", "soil", "sand", "food", "bone", "liquid", "stone")
"""Classes of the library that grow or form in nature."""
_MADE_KINDS = ("plastic", "metal", "glass", "ceramic", "textile", "foam")
"""Classes that nothing natural is made of."""
_LAW_NUMBERS = {
    "von_mises": ("yield_stress_pa",),
    "viscoplastic": ("yield_stress_pa",),
    "drucker_prager": ("friction_angle_deg",),
}


@dataclass(frozen=True)
class Checked:
    """The materials of a part after the checks.

    Attributes:
        materials: surface and interior, with their warnings.
        second_opinion: what the rule table says against it, or an empty text.
        origin: what decided.
        decided_by: "model" or "rule".
    """

    materials: PartMaterials
    second_opinion: str
    origin: Origin
    decided_by: str


def check_part(
    agreed: PartConsensus,
    rule: PartMaterials,
    *,
    model: str,
    trust: bool = False,
    origin: Origin | None = None,
) -> Checked:
    """Judge the consensus on a part.

    Args:
        agreed: what the answers agree on.
        rule: the rule table's materials for the part; an opinion only where their source is "rule".
        model: id of the model, for ``source``.
        trust: keep the model's numbers and materials whatever the checks say; the warnings stay.
        origin: what the user knows about the object, instead of the answers.
    """
    surface = _against_library(agreed.surface, agreed.thickness_m, model=model, trust=trust)
    interior = _against_library(agreed.interior, agreed.thickness_m, model=model, trust=trust)
    chosen = PartMaterials(surface=surface, interior=interior)
    decisive = agreed.origin if origin is None else origin
    opinion = _second_opinion(agreed.surface, surface, rule.surface, is_natural=decisive == "natural")
    if not opinion:
        return Checked(chosen, "", decisive, "model")
    entry = find_entry(rule.surface.name)
    is_natural = entry is not None and entry.kind in _NATURAL_KINDS
    rule_wins = not trust and is_natural and decisive != "artificial"
    who = "you say that it is" if origin is not None else "the answers call it"
    said = f"{who} {decisive}" if decisive != "unsure" else "the answers do not agree whether it is natural"
    if rule_wins:
        warning = f"{opinion}; {said}, so the rule's {rule.surface.name} is used"
        used = {
            side: replace(value, warnings=(warning, *value.warnings))
            for side, value in (("surface", rule.surface), ("interior", rule.interior))
        }
        return Checked(PartMaterials(**used), opinion, decisive, "rule")
    if not is_natural:
        verdict = f"the model's {surface.name} is kept"
    elif decisive == "artificial":
        verdict = f"{said}, so {surface.name} is kept; should it be a real one, say --origin natural"
    else:
        verdict = f"{surface.name} is kept because the model is trusted"
    warning = f"{opinion}; {verdict}"
    kept = {
        side: replace(value, warnings=(warning, *value.warnings))
        for side, value in (("surface", surface), ("interior", interior))
    }
    return Checked(PartMaterials(**kept), opinion, decisive, "model")


def _against_library(agreed: SideConsensus, thickness_m: float | None, *, model: str, trust: bool) -> Material:
    """The material of one side, with the library's numbers where the agreed ones are not plausible."""
    entry = find_entry(agreed.material)
    warnings: list[str] = []
    if agreed.votes * 2 <= agreed.of:
        rivals = ", ".join(f"{name} ({count})" for name, count in agreed.rivals[:3])
        warnings.append(
            f"the answers do not agree: {agreed.votes} of {agreed.of} say {agreed.material}, others {rivals}"
        )
    values: dict[str, float] = {}
    for key in ("youngs_modulus_pa", "density_kgm3", "poisson_ratio"):
        value = getattr(agreed, key)
        limits: Quantity | None = None if entry is None else getattr(entry, key)
        doubt = _doubt(key, value, limits, agreed)
        if doubt and limits is not None and not trust:
            warnings.append(f"{doubt}; the library's {limits.value:g} is used")
            value = limits.value
        elif doubt:
            warnings.append(f"{doubt}; it is kept")
        values[key] = value
    if entry is None:
        warnings.append(f"the library does not know {agreed.material}, so its numbers could not be checked")
    usual = None if entry is None else entry.material()
    law = agreed.law or (usual.law if usual else "neo_hookean")
    if usual is not None and law != usual.law and not trust:
        law = usual.law
    extra = _extra(law, agreed.extra, entry, warnings, trust=trust)
    wrong = wrong_number(law, extra, values["youngs_modulus_pa"], values["poisson_ratio"])
    if wrong is not None:
        warnings.append(f"{wrong}; it is simulated as elastic")
        law = "neo_hookean"
    return Material(
        name=agreed.material,
        law=law,
        source=f"mllm:{model}",
        thickness_m=_thickness(thickness_m, entry, trust=trust),
        extra=extra,
        evidence=agreed.in_words,
        warnings=tuple(warnings),
        **values,
    )


def _doubt(key: str, value: float, limits: Quantity | None, agreed: SideConsensus) -> str:
    """Why a number is not plausible, or an empty text."""
    if limits is not None and not limits.range[0] <= value <= limits.range[1]:
        low, high = limits.range
        return f"{key} {value:.3g} of the answers lies outside the library's {low:g} to {high:g} for {agreed.material}"
    if key == "youngs_modulus_pa" and agreed.spread_decades > MAX_SPREAD_DECADES:
        return f"{key} spreads over {agreed.spread_decades:.1f} decades between the answers"
    return ""


def _thickness(answered: float | None, entry: LibraryEntry | None, *, trust: bool) -> float | None:
    """The thickness of a sheet or wall, where the answers give a plausible one; else the library's."""
    usual = None if entry is None else entry.thickness_m
    if answered is None or (usual is not None and not trust and not usual.range[0] <= answered <= usual.range[1]):
        return None if usual is None else usual.value
    return answered


def _extra(
    law: str, answered: Mapping[str, float], entry: LibraryEntry | None, warnings: list[str], *, trust: bool
) -> dict[str, float]:
    """Further numbers of the law: the library's, replaced by plausible answers."""
    known = {} if entry is None else entry.extra
    extra = {key: quantity.value for key, quantity in known.items()}
    for key in _LAW_NUMBERS.get(law, ()):
        value = answered.get(key)
        if value is None:
            continue
        limits = known.get(key)
        if limits is None or trust or limits.range[0] <= value <= limits.range[1]:
            extra[key] = value
        else:
            low, high = limits.range
            warnings.append(
                f"{key} {value:.3g} of the answers lies outside the library's {low:g} to {high:g}; "
                f"the library's {limits.value:g} is used"
            )
    return extra


def _second_opinion(agreed: SideConsensus, chosen: Material, rule: Material, *, is_natural: bool) -> str:
    """How the rule table contradicts the answers, or an empty text."""
    if rule.source != "rule" or rule.name == chosen.name:
        return ""
    apart = abs(math.log10(chosen.youngs_modulus_pa) - math.log10(rule.youngs_modulus_pa))
    entry = find_entry(chosen.name)
    contradicts_itself = is_natural and entry is not None and entry.kind in _MADE_KINDS
    if apart <= MAX_DISAGREEMENT_DECADES and not contradicts_itself:
        return ""
    return (
        f"second opinion: {agreed.votes} of {agreed.of} answers say {chosen.name} of {agreed.youngs_modulus_pa:.2g} "
        f"Pa, but shape, colour and place look like {rule.name} of {rule.youngs_modulus_pa:.2g} Pa, {apart:.1f} "
        "decades away"
    )
