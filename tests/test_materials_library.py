"""The material library: every number in its range and with a source, every name found, no name twice."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter

import pytest

from phys4dgen.errors import MaterialError
from phys4dgen.materials import KNOWN_LAWS, find_entry, library_entries, material

ENTRIES = list(library_entries().values())

LAW_PARAMETERS = {
    "von_mises": {"yield_stress_pa"},
    "drucker_prager": {"friction_angle_deg"},
    "snow": {"critical_compression", "critical_stretch", "hardening_coefficient"},
    "viscoplastic": {"yield_stress_pa"},
    "fluid": {"viscosity_pas"},
}
"""What a law cannot run without."""


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.name)
def test_every_number_is_physical_and_has_a_source(entry):
    assert entry.density_kgm3.range[0] >= 5 and entry.density_kgm3.range[1] <= 23000
    assert entry.youngs_modulus_pa.range[0] >= 1e2 and entry.youngs_modulus_pa.range[1] <= 10**11.5
    assert entry.poisson_ratio.range[0] >= 0 and entry.poisson_ratio.range[1] < 0.5
    quantities = [entry.density_kgm3, entry.youngs_modulus_pa, entry.poisson_ratio, *entry.extra.values()]
    if entry.thickness_m is not None:
        quantities.append(entry.thickness_m)
        assert entry.thickness_m.range[0] >= 1e-5 and entry.thickness_m.range[1] <= 0.02
    for quantity in quantities:
        assert quantity.range[0] <= quantity.value <= quantity.range[1]
        assert quantity.needs_review == (quantity.quality == "C")
        assert len(quantity.source) > 10
    youngs, poisson = entry.youngs_modulus_pa.value, entry.poisson_ratio.value
    shear = youngs / (2 * (1 + poisson))
    p_wave = youngs * (1 - poisson) / ((1 + poisson) * (1 - 2 * poisson))
    assert 0 < shear < p_wave


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.name)
def test_laws_are_known_and_have_their_parameters(entry):
    assert entry.law in KNOWN_LAWS
    assert LAW_PARAMETERS.get(entry.law, set()) <= set(entry.extra)
    # ~500 m/s in P waves at 1 kg/l is out of reach for explicit steps on a small computer
    assert entry.rigid_candidate == (entry.youngs_modulus_pa.value >= 4e8)


def test_names_and_aliases_are_unique_and_found():
    words = [word for entry in ENTRIES for word in (entry.name, *entry.aliases)]
    assert [word for word, count in Counter(words).items() if count > 1] == []
    for entry in ENTRIES:
        assert all(find_entry(alias) is entry for alias in entry.aliases)


def test_sheet_materials_carry_the_thickness_of_the_contract():
    usual = {"leaf_blade": 8e-4, "petal": 3e-4, "cotton_fabric": 1e-3, "felt": 3e-3, "paper": 1.5e-4}
    assert {name: library_entries()[name].material().thickness_m for name in usual} == usual


@pytest.mark.parametrize("spelling", ["leaf", "Leaf Blade", "leaf-blade", " leaves "])
def test_lookup_forgives_spelling(spelling):
    found = material(spelling)
    assert found.name == "leaf_blade"
    assert found.source == "library"
    assert found.law == "neo_hookean"


def test_a_wrong_name_gets_a_suggestion():
    with pytest.raises(MaterialError, match=r"material 'seel': the library has no material of this name\. Did you mea"):
        material("seel")
    with pytest.raises(MaterialError, match="Known materials: natural_rubber, "):
        material("qqqqqq")


def test_importing_the_materials_does_not_read_the_library():
    code = "import phys4dgen.materials.library as l; print(l.library_entries.cache_info().currsize)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "0"
