"""Who decides on a material, and materials.yaml there and back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phys4dgen.errors import MaterialError
from phys4dgen.materials import (
    assemble_book,
    library_entries,
    material,
    parse_choices,
    read_materials,
    write_materials,
)
from phys4dgen.materials.rules import DEFAULT_SOLID
from phys4dgen.types import Material, MaterialBook, PartMaterials

NAMES = ("pot", "soil", "leaves")


def both(chosen: Material) -> PartMaterials:
    return PartMaterials(surface=chosen, interior=chosen)


IDENTIFIED = MaterialBook({name: both(DEFAULT_SOLID) for name in NAMES})


def test_flags_win_over_the_file_and_the_file_over_the_rules():
    book = assemble_book(
        NAMES,
        IDENTIFIED,
        from_file={"pot": both(material("steel")), "leaves": both(material("paper"))},
        surface={"leaves": "felt"},
        interior={"soil": "clay"},
        thickness_m={"leaves": 0.002},
    )
    assert tuple(book.parts) == NAMES
    assert book.parts["pot"].surface.name == "steel"
    assert book.parts["leaves"].surface.name == book.parts["leaves"].interior.name == "felt"
    assert book.parts["leaves"].surface.source == "user"
    assert book.parts["leaves"].surface.thickness_m == 0.002
    assert book.parts["soil"].surface == DEFAULT_SOLID
    assert book.parts["soil"].interior.name == "clay_soil"


def test_a_surface_may_differ_from_the_interior():
    book = assemble_book(NAMES, IDENTIFIED, surface={"pot": "leather"}, interior={"pot": "foam"})
    assert (book.parts["pot"].surface.name, book.parts["pot"].interior.name) == ("leather", "pu_foam")


@pytest.mark.parametrize("where", ["surface", "interior", "thickness_m", "from_file"])
def test_an_unknown_part_gets_a_suggestion(where):
    value = {"surface": "felt", "interior": "felt", "thickness_m": 0.1, "from_file": both(DEFAULT_SOLID)}[where]
    with pytest.raises(MaterialError, match=r"there is no part 'leafs'\. Did you mean 'leaves'\? The parts are pot, s"):
        assemble_book(NAMES, IDENTIFIED, **{where: {"leafs": value}})


def test_flags_are_read_and_refused():
    assert parse_choices(["leaves=felt", "pot = steel", "leaves=paper"]) == {"leaves": "paper", "pot": "steel"}
    for bad in ("leaves", "=felt", "leaves=", ""):
        with pytest.raises(MaterialError, match="--material: expected PART=NAME such as leaves=felt, got"):
            parse_choices([bad])


@pytest.mark.parametrize(
    ("law", "extra", "problem"),
    [
        ("von_mises", {}, "the law von_mises needs yield_stress_pa"),
        (
            "snow",
            {"critical_compression": 0.5},
            r"critical_compression of the law snow must lie in \[0.0001, 0.2\], got 0.5",
        ),
        ("von_mises", {"yield_stress_pa": 1e4, "hardening_modulus_pa": -1e12}, "hardening_modulus_pa must be at least"),
        ("von_mises", {"yield_stress_pa": 1e4, "residual_yield_stress_pa": 2e4}, "must not exceed yield_stress_pa"),
    ],
)
def test_a_law_without_its_numbers_is_refused(tmp_path: Path, law, extra, problem):
    wrong = replace(material("felt"), law=law, extra=extra)
    with pytest.raises(MaterialError, match=f"part 'soil', material felt: .*{problem}"):
        assemble_book(NAMES, IDENTIFIED, from_file={"soil": PartMaterials(wrong, wrong)})
    path = tmp_path / "materials.yaml"
    numbers = "".join(f"{key}: {value}, " for key, value in extra.items())
    path.write_text(f"parts:\n  soil:\n    surface: {{name: felt, law: {law}, extra: {{{numbers}}}}}\n")
    with pytest.raises(MaterialError, match=f"line 3: .*{problem}"):
        read_materials(path, NAMES)


def test_a_number_of_no_law_is_refused(tmp_path: Path):
    path = tmp_path / "materials.yaml"
    path.write_text("parts:\n  pot: {surface: {name: wax, extra: {yeild_stress_pa: 1e6}}}\n")
    with pytest.raises(
        MaterialError, match=r"'yeild_stress_pa' is not a number of any law.*Did you mean 'yield_stress_pa'"
    ):
        read_materials(path)


def test_the_whole_library_survives_the_file(tmp_path: Path):
    book = MaterialBook({name: both(entry.material()) for name, entry in library_entries().items()})
    write_materials(tmp_path / "materials.yaml", book)
    assert read_materials(tmp_path / "materials.yaml") == dict(book.parts)


materials = st.builds(
    Material,
    name=st.sampled_from(["goo", "steel", "my cloth: 2", "#1"]),
    law=st.sampled_from(["neo_hookean", "stvk_hencky"]),
    density_kgm3=st.floats(1, 25000),
    youngs_modulus_pa=st.floats(1, 2e12),
    poisson_ratio=st.floats(0, 0.4999),
    source=st.sampled_from(["user", "rule", "mllm:gpt-4o"]),
    thickness_m=st.none() | st.floats(1e-6, 1),
    extra=st.dictionaries(st.sampled_from(["yield_stress_pa", "cohesion_pa"]), st.floats(0, 1e9)),
    warnings=st.lists(st.text(max_size=30), max_size=2).map(tuple),
)


@settings(max_examples=60, deadline=None)
@given(materials, materials)
def test_any_book_survives_the_file(tmp_path_factory, surface: Material, interior: Material):
    path = tmp_path_factory.mktemp("book") / "materials.yaml"
    write_materials(path, MaterialBook({"a part": PartMaterials(surface=surface, interior=interior)}))
    back = read_materials(path)["a part"]
    for was, now in ((surface, back.surface), (interior, back.interior)):
        expected, got = dict(vars(was)), dict(vars(now))
        told, heard = expected.pop("warnings"), got.pop("warnings")
        # steel of another stiffness is allowed, but said; a library name brings what the file left out
        assert set(told) <= set(heard)
        if was.name == "steel" and not was.extra:
            expected.pop("extra"), got.pop("extra")
        assert got == expected


def test_a_person_may_write_as_little_as_a_name(tmp_path: Path):
    path = tmp_path / "materials.yaml"
    path.write_text(
        "parts:\n"
        "  hat: {surface: felt}\n"
        "  body:\n"
        "    surface: {name: snow, youngs_modulus_pa: 2e5}\n"
        "    interior: {name: goo, density_kgm3: 900, youngs_modulus_pa: 1e4, poisson_ratio: 0.4}\n"
    )
    parts = read_materials(path)
    assert parts["hat"].surface == parts["hat"].interior
    assert parts["hat"].surface.source == "user"
    assert parts["hat"].surface.thickness_m == 3e-3
    assert parts["body"].surface.name == "snow_packed"
    assert parts["body"].surface.youngs_modulus_pa == 2e5
    assert parts["body"].surface.density_kgm3 == 400
    assert parts["body"].interior.law == "neo_hookean"


def test_a_file_of_an_older_version_is_read(tmp_path: Path):
    path = tmp_path / "materials.yaml"
    path.write_text("parts: {pot: {surface: {name: snow, law: snow, effective_law: neo_hookean}}}")
    assert read_materials(path)["pot"].surface.law == "snow"


def test_values_outside_the_library_range_are_said(tmp_path: Path):
    path = tmp_path / "materials.yaml"
    path.write_text("parts:\n  hat:\n    surface: {name: felt, youngs_modulus_pa: 1e9}\n")
    warnings = read_materials(path)["hat"].surface.warnings
    assert warnings == ("youngs_modulus_pa 1e+09 lies outside the library's range 100000 to 5e+06 for felt",)


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("part: {}", 1, "'part' is not a key of materials.yaml. Did you mean 'parts'?"),
        ("parts:\n  hat:\n    surfce: felt", 3, "'surfce' is not a key of materials.yaml. Did you mean 'surface'?"),
        ("parts:\n  hat: {interior: felt}", 2, "part 'hat' has no surface"),
        (
            "parts:\n  hat:\n    surface:\n      name: felt\n      youngs_modulus: 3",
            5,
            "'youngs_modulus' is not a key of materials.yaml. Did you mean 'youngs_modulus_pa'?",
        ),
        (
            "parts:\n  hat:\n    surface: {name: felt, poisson_ratio: 0.5}",
            3,
            "expected poisson_ratio to be a number from 0 to 0.4999, got 0.5.",
        ),
        ("parts:\n  hat:\n    surface: {name: felt, density_kgm3: heavy}", 3, "from 1 to 25000, got 'heavy'."),
        ("parts:\n  hat:\n    surface: {name: felt, density_kgm3: .nan}", 3, "from 1 to 25000, got nan."),
        ("parts:\n  hat:\n    surface: {name: felt, law: neohookean}", 3, "Did you mean 'neo_hookean'?"),
        (
            "parts:\n  hat:\n    surface: fellt",
            3,
            "the library has no material 'fellt', so density_kgm3 must be given. Did you mean 'felt'?",
        ),
        ("parts:\n  hat:\n    surface: {law: snow}", 3, "expected name to be text, got None."),
        ("parts: [1, 2]", 1, "expected parts to be a mapping of names to values, got [1, 2]."),
        ("parts: {hat: {surface: {name: felt, warnings: 3}}}", 1, "expected warnings to be a list of sentences"),
        ("parts: {hat: {surface: {name: felt, extra: {a: b}}}}", 1, "'a' is not a number of any law"),
        ("- 1", 1, "expected the file to be a mapping of names to values, got [1]."),
        ("parts: {", 1, ""),
    ],
)
def test_mistakes_are_named_with_file_line_and_way_out(tmp_path: Path, text: str, line: int, message: str):
    path = tmp_path / "materials.yaml"
    path.write_text(text)
    with pytest.raises(MaterialError) as error:
        read_materials(path)
    assert str(error.value).startswith(f"{path} line {line}: ") or not message
    assert message in str(error.value)


def test_what_a_terminal_would_obey_is_escaped(tmp_path: Path):
    path = tmp_path / "materials.yaml"
    path.write_text('parts: {pot: {surface: {"\\e[2J\\ue996\\nname": felt}}}', encoding="utf-8")
    with pytest.raises(MaterialError) as caught:
        read_materials(path)
    assert str(caught.value).isprintable()
    assert "'\\x1b[2J\\ue996\\nname' is not a key" in str(caught.value)


def test_a_part_that_does_not_exist_is_refused_with_its_line(tmp_path: Path):
    path = tmp_path / "materials.yaml"
    path.write_text("parts:\n  pot: {surface: steel}\n  leafs: {surface: felt}\n")
    assert set(read_materials(path)) == {"pot", "leafs"}
    with pytest.raises(
        MaterialError, match=r"line 3: there is no part 'leafs'\. Did you mean 'leaves'\? The parts are p"
    ):
        read_materials(path, NAMES)


def test_a_missing_file_is_a_material_error(tmp_path: Path):
    with pytest.raises(MaterialError, match="cannot read the file"):
        read_materials(tmp_path / "nothing.yaml")
