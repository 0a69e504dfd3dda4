"""The rule table: each rule on a case it was made for and one it must leave alone; the features it looks at."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from grouping_objects import from_points, leaf, potted_plant, ring, shaded_ball
from phys4dgen.materials import RULES, find_entry, identify_by_rules
from phys4dgen.materials.features import PartFeatures, part_features
from phys4dgen.materials.rules import DEFAULT_SOLID, DEFAULT_THIN, default_material, matching_rule
from phys4dgen.types import ROD, SHEET, SOLID, Continuum, Frame, Parts, rotation_to_z_up
from phys4dgen.zoo import bundled
from phys4dgen.zoo.zoo_object import PartTruth

Z_UP = Frame(np.eye(3), 1.0)

POT = PartFeatures(
    name="pot", lightness=80, chroma=6, hue_deg=80, foot=0, top=0.35, width=0.2, area_share=0.4,
    roundness=0.3, sheet_share=0.2, rod_share=0, enclosed_by=(), encloses=("the soil",),
    stands_on=(), carries=("the leaves",),
)  # fmt: skip
SOIL = PartFeatures(
    name="the soil", lightness=20, chroma=10, hue_deg=60, foot=0.28, top=0.32, width=0.18, area_share=0.1,
    roundness=0.3, sheet_share=0, rod_share=0, enclosed_by=("pot",), encloses=(), stands_on=(), carries=("the leaves",),
)  # fmt: skip
LEAVES = PartFeatures(
    name="the leaves", lightness=45, chroma=30, hue_deg=120, foot=0.3, top=1, width=0.4, area_share=0.5,
    roundness=0.3, sheet_share=0.9, rod_share=0.05, enclosed_by=(), encloses=(),
    stands_on=("pot", "the soil"), carries=(),
)  # fmt: skip
PETALS = replace(LEAVES, name="the petals", lightness=55, chroma=60, hue_deg=350, foot=0.8)
STEM = replace(LEAVES, name="the stem", sheet_share=0.1, rod_share=0.8)
TRUNK = replace(
    LEAVES, name="trunk", lightness=40, chroma=20, hue_deg=65, top=0.6, width=0.06, sheet_share=0, rod_share=0
)
SAUCER = replace(
    POT, name="saucer", top=0.05, width=0.25, encloses=(), carries=("pot",), lightness=60, chroma=1, sheet_share=1.0
)


def concluded(part: PartFeatures, *others: PartFeatures) -> str | None:
    """Material that the rules conclude for ``part``, standing among others."""
    rule = matching_rule(part, {other.name: other for other in (part, *others)})
    return None if rule is None else rule.material


PLANT = (POT, SOIL, LEAVES)


@pytest.mark.parametrize(
    ("part", "expected"),
    [
        (POT, "ceramic"),
        (replace(POT, lightness=55, chroma=40, hue_deg=50), "ceramic"),  # terracotta
        (replace(POT, lightness=12, chroma=2), "polypropylene"),
        (replace(POT, lightness=40, chroma=50, hue_deg=290), "polypropylene"),  # bright blue
        (SOIL, "garden_soil"),
        (replace(SOIL, lightness=75), None),  # white pebbles, or milk
        (replace(SOIL, enclosed_by=()), None),
        (LEAVES, "leaf_blade"),
        (replace(LEAVES, lightness=18, chroma=5, hue_deg=200), "leaf_blade"),  # against the light
        (replace(LEAVES, sheet_share=0.1, rod_share=0.0), None),  # a green ball
        (replace(LEAVES, lightness=60, chroma=12, hue_deg=280), "cotton_fabric"),  # a flag on a box
        (PETALS, "petal"),
        (replace(PETALS, chroma=10), None),
        (replace(PETALS, sheet_share=0.0, rod_share=0.0), "abs"),  # a red knob
        (STEM, "herbaceous_stem"),
        (TRUNK, "hardwood"),
        (replace(TRUNK, width=0.5), None),  # a brown heap
        (SAUCER, "ceramic"),
        (replace(SAUCER, carries=()), None),
    ],
)
def test_each_rule_on_its_example_and_beside_it(part, expected):
    others = tuple(other for other in PLANT if other.name != part.name)
    assert concluded(part, *others) == expected


def test_nothing_is_guessed_about_an_object_without_a_plant():
    """A white base under a metal figure is no flower pot."""
    figure = replace(LEAVES, name="figure", lightness=60, chroma=5, hue_deg=270, sheet_share=0.0, rod_share=0.0)
    figure = replace(figure, stands_on=("pot",))
    base = replace(POT, encloses=(), carries=("figure",))
    assert concluded(base, figure) is None
    assert concluded(figure, base) is None


def test_the_heart_of_a_flower_lies_among_petals():
    heart = replace(PETALS, name="the middle", area_share=0.01, sheet_share=0.1, enclosed_by=("the petals",))
    assert concluded(heart, *PLANT, PETALS) == "parenchyma"
    assert concluded(replace(heart, enclosed_by=()), *PLANT, PETALS) == "abs"  # a yellow knob


def test_the_lid_of_a_sandwich_is_bread():
    """Bread on the ground and around its layers, and a glossy crust above that colour set apart."""
    heel = replace(POT, name="lower", lightness=45, chroma=38, hue_deg=67, top=0.5, width=0.7, encloses=(), carries=())
    patty = replace(heel, name="layer", lightness=16, chroma=20, hue_deg=47, foot=0.16, top=0.33, width=0.9)
    crown = replace(heel, name="upper", lightness=55, chroma=54, hue_deg=60, foot=0.45, top=0.82, width=0.77)
    assert concluded(heel, patty, crown) == "bread"
    assert concluded(patty, heel, crown) == "meat_grilled"
    assert concluded(crown, heel, patty) == "bread"
    assert concluded(crown, heel) == "abs"  # a toy
    assert concluded(replace(crown, area_share=0.05), heel, patty) == "abs"  # a cocktail tomato


def test_what_nothing_explains_on_a_toy_is_what_the_toy_is():
    """A soft ball under a hard duck would be crushed by it."""
    duck = replace(
        POT, name="duck", lightness=69, chroma=57, hue_deg=93, top=0.81, area_share=0.78, roundness=0.2, encloses=(),
        carries=(),
    )  # fmt: skip
    ball = replace(duck, name="ball", lightness=22, chroma=7, hue_deg=263, top=0.23, area_share=0.06, roundness=0.4)
    assert concluded(duck, ball) == "abs"
    assert concluded(ball, duck) == "abs"
    assert concluded(ball, replace(duck, area_share=0.4)) is None
    assert concluded(replace(ball, sheet_share=0.9), duck) == "cotton_fabric"  # a flag


def test_a_telling_name_decides():
    gaussians, parts = plant_parts(("terracotta", "soil", "Leaves"))
    book = identify_by_rules(gaussians, parts, Z_UP)
    assert [materials.surface.name for materials in book.parts.values()] == ["ceramic", "garden_soil", "leaf_blade"]
    assert "rule 'name'" in book.parts["Leaves"].surface.warnings[0]


def test_petals_need_green_beside_them():
    flag = replace(PETALS, stands_on=("pole",))
    pole = replace(TRUNK, name="pole", foot=0.0)
    assert concluded(flag, pole) == "cotton_fabric"


def test_without_a_continuum_no_part_is_taken_for_a_rod():
    unknown = {"sheet_share": float("nan"), "rod_share": float("nan")}
    assert concluded(replace(STEM, **unknown), POT) == "leaf_blade"
    assert concluded(replace(LEAVES, **unknown), POT) == "leaf_blade"


def test_rules_name_library_materials_and_are_documented():
    assert len({rule.name for rule in RULES}) == len(RULES)
    for rule in RULES:
        assert find_entry(rule.material or "soil") is not None
        assert 0 < rule.confidence < 1
        assert min(len(rule.says), len(rule.example), len(rule.counter_example)) > 10


def plant_parts(names: tuple[str, ...] = ("pot", "dark", "green")):
    gaussians, truth = potted_plant()
    return gaussians, Parts(labels=truth, names=names, backend="file")


def test_features_of_a_potted_plant():
    gaussians, parts = plant_parts()
    pot, soil, leaves = part_features(gaussians, parts, Z_UP)
    assert pot.on_ground and not soil.on_ground and not leaves.on_ground
    assert pot.encloses == ("dark",)
    assert soil.enclosed_by == ("pot",)
    assert leaves.stands_on == ("pot", "dark")
    assert pot.lightness > 75 and pot.chroma < 10
    assert soil.lightness < 25
    assert 100 < leaves.hue_deg < 150
    assert np.isclose(pot.area_share + soil.area_share + leaves.area_share, 1)
    assert leaves.top == pytest.approx(1, abs=0.03)
    assert pot.top == pytest.approx(0.36 / 0.67, abs=0.03)
    assert pot.is_thin is None


def test_features_do_not_depend_on_where_and_how_large_the_object_is():
    gaussians, parts = plant_parts()
    rotation = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
    turned = replace(
        gaussians,
        means=((gaussians.means * 3) @ rotation + [5, -2, 1]).astype(np.float32),
        scales=gaussians.scales * np.float32(3),
    )
    for was, now in zip(
        part_features(gaussians, parts, Z_UP), part_features(turned, parts, Frame(rotation, 0.1)), strict=True
    ):
        assert (was.encloses, was.carries, was.on_ground) == (now.encloses, now.carries, now.on_ground)
        assert now.foot == pytest.approx(was.foot, abs=1e-4)
        assert now.hue_deg == pytest.approx(was.hue_deg, abs=1e-6)


def thin_continuum(parts: Parts, positions, shapes: tuple[int, ...]) -> Continuum:
    """One particle per Gaussian: its part's shape, 1 mm thick where thin."""
    n = len(parts.labels)
    shape = np.array(shapes, np.int8)[parts.labels]
    thickness = np.where(shape == SOLID, np.nan, 1e-3)
    return Continuum(
        positions=positions,
        part=parts.labels,
        is_interior=np.zeros(n, bool),
        volume_m3=np.where(shape == SOLID, 1e-7, 1e-8),
        gaussian_index=np.full(n, -1),
        piece=np.zeros(n),
        shape=shape,
        thickness_m=thickness,
        thickness_measured=shape != SOLID,
        offset_m=np.zeros((n, 3)),
        site=np.arange(n),
        spacing_m=0.005,
    )


def test_a_potted_plant_gets_its_materials():
    gaussians, parts = plant_parts()
    continuum = thin_continuum(parts, gaussians.means, (SOLID, SOLID, SHEET))
    for known in (None, continuum):
        book = identify_by_rules(gaussians, parts, Z_UP, known)
        found = {name: materials.surface for name, materials in book.parts.items()}
        assert {name: chosen.name for name, chosen in found.items()} == {
            "pot": "ceramic",
            "dark": "garden_soil",
            "green": "leaf_blade",
        }
        assert all(chosen.source == "rule" and "confidence" in chosen.warnings[0] for chosen in found.values())
    rods = identify_by_rules(gaussians, parts, Z_UP, thin_continuum(parts, gaussians.means, (SOLID, SOLID, ROD)))
    assert rods.parts["green"].surface.name == "herbaceous_stem"


def test_what_no_rule_knows_gets_neutral_values_and_a_warning():
    ball = shaded_ball()
    one = Parts(labels=np.zeros(len(ball), np.int32), names=("ball",), backend="none")
    book = identify_by_rules(ball, one, Z_UP)
    assert book.parts["ball"].surface == DEFAULT_SOLID
    grass = replace(LEAVES, foot=0.0, stands_on=())
    assert concluded(grass) is None
    assert default_material(grass) == DEFAULT_THIN
    values = [(m.youngs_modulus_pa, m.density_kgm3, m.poisson_ratio, m.law) for m in (DEFAULT_SOLID, DEFAULT_THIN)]
    assert values == [(2e5, 300, 0.3, "neo_hookean"), (1e8, 800, 0.3, "neo_hookean")]
    assert all(chosen.source == "default" and chosen.warnings for chosen in (DEFAULT_SOLID, DEFAULT_THIN))


def test_objects_that_the_rules_were_not_written_on():
    """The bar of the contract, by volume; benchmarks/rules.py has every part, with the particles of the product."""
    right = near = total = 0.0
    for name in ("rubber_duck", "sandcastle", "telephone", "straw_hat", "balloon", "cup"):
        item = bundled(name)
        names = tuple(f"part_{number}" for number in range(len(item.part_names)))
        parts = Parts(labels=item.labels, names=names, backend="zoo")
        shapes = tuple(true_shape(truth, item.height_m) for truth in item.truth.values())
        continuum = thin_continuum(parts, item.gaussians.means, shapes)
        frame = Frame(rotation_to_z_up(item.up), item.metres_per_unit)
        book = identify_by_rules(item.gaussians, parts, frame, continuum)
        for sides, truth in zip(book.parts.values(), item.truth.values(), strict=True):
            entry, found = find_entry(truth.material), find_entry(sides.surface.name)
            decades = np.log10(sides.surface.youngs_modulus_pa / entry.material().youngs_modulus_pa)
            right += truth.volume_m3 * (found is not None and found.kind == entry.kind)
            near += truth.volume_m3 * (abs(decades) <= 1.5)
            total += truth.volume_m3
    assert right / total >= 0.6
    assert near / total >= 0.8


def true_shape(truth: PartTruth, height_m: float) -> int:
    """What the product takes a part for on a grid of some 28 cells."""
    if truth.thickness_m is None or truth.area_m2 is None or truth.thickness_m > 0.5 * height_m / 28:
        return SOLID
    return SHEET if truth.area_m2 * truth.thickness_m / truth.volume_m3 < 1.5 else ROD  # 1 for a sheet, 4 for a rod


def test_hanging_leaves_still_stand_on_their_pot():
    """A palm's leaves reach lower than the rim of its pot, and most of them hang beside it."""
    rng = np.random.default_rng(0)
    hanging = np.concatenate([leaf(400, turn, rng) for turn in (0.0, 1.5, 3.0, 4.5)])
    out = np.hypot(hanging[:, 0], hanging[:, 1])
    hanging[:, 2] -= 3.0 * np.clip(out - 0.2, 0, None) ** 2 + 0.1 * out
    hanging[:, :2] *= 1.5
    pot = ring(1500, (0.15, 0.2), (0, 0.35), rng)
    points = np.concatenate([pot, hanging])
    rgb = np.concatenate([np.tile([0.1, 0.1, 0.1], (len(pot), 1)), np.tile([0.2, 0.35, 0.15], (len(hanging), 1))])
    labels = np.repeat([0, 1], [len(pot), len(hanging)]).astype(np.int32)
    book = identify_by_rules(
        from_points(points, rgb, size=0.01, seed=0), Parts(labels=labels, names=("pot", "fronds"), backend="file"), Z_UP
    )
    assert [book.parts[name].surface.name for name in ("pot", "fronds")] == ["polypropylene", "leaf_blade"]
