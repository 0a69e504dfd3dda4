"""From the true body to the one that is simulated, and back."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from phys4dgen.body import assemble_body
from phys4dgen.mpm import LawId
from phys4dgen.types import ROD, SHEET, SOLID, Continuum, Frame, Material, MaterialBook, PartMaterials, Parts

FRAME = Frame(Rotation.from_euler("xyz", [20, 65, -30], degrees=True).as_matrix(), 0.35)
CELL_M = 5e-3
SHEET_P, ROD_P, SOLID_P, HELD_P = slice(0, 2), slice(2, 6), slice(6, 7), slice(7, 8)
NAMES = ("leaf", "stem", "lump", "pot")
PARTS = Parts(np.arange(4, dtype=np.int32), NAMES, "test")


def _material(**values):
    usual = {
        "name": "felt",
        "law": "neo_hookean",
        "density_kgm3": 800.0,
        "youngs_modulus_pa": 1e8,
        "poisson_ratio": 0.3,
        "source": "user",
    }
    return Material(**{**usual, **values})


def _book(**materials):
    chosen = {name: materials.get(name, _material()) for name in NAMES}
    return MaterialBook({name: PartMaterials(surface=m, interior=m) for name, m in chosen.items()})


@pytest.fixture(scope="module")
def continuum():
    """A site of a leaf 0.8 mm thick, one of a stem 3 mm thick, a solid particle and a held sheet particle."""
    rng = np.random.default_rng(0)
    middle = rng.uniform(-0.05, 0.05, (4, 3))[[0, 0, 1, 1, 1, 1, 2, 3]]
    half, quarter = 8e-4 / (2 * math.sqrt(3)), 3e-3 / 4
    offset = np.zeros((8, 3))
    offset[SHEET_P, 2] = [half, -half]
    offset[ROD_P, :2] = [[quarter, quarter], [quarter, -quarter], [-quarter, quarter], [-quarter, -quarter]]
    offset[HELD_P, 1] = half
    return Continuum(
        positions=FRAME.from_metres(middle + offset),
        part=np.array([0, 0, 1, 1, 1, 1, 2, 3], np.int32),
        is_interior=np.zeros(8, bool),
        volume_m3=rng.uniform(1e-9, 2e-9, 8),
        gaussian_index=np.full(8, -1, np.int32),
        piece=np.zeros(8, np.int32),
        shape=np.array([SHEET] * 2 + [ROD] * 4 + [SOLID, SHEET], np.int8),
        thickness_m=np.array([8e-4] * 2 + [3e-3] * 4 + [np.nan, 8e-4]),
        thickness_measured=np.ones(8, bool),
        offset_m=offset,
        site=np.array([0, 0, 1, 1, 1, 1, 2, 3], np.int32),
        spacing_m=CELL_M / 2,
    )


HELD = np.array([False] * 7 + [True])


def _assemble(continuum, book, *, speed_ms, cell_m=CELL_M, held=HELD, rigid=None, fps=24.0, rigid_ms=1e5):
    return assemble_body(
        continuum,
        PARTS,
        book,
        frame=FRAME,
        held=held,
        rigid=np.zeros(8, bool) if rigid is None else rigid,
        cell_m=cell_m,
        max_wave_speed_ms=speed_ms,
        rigid_wave_speed_ms=rigid_ms,
        fps=fps,
    )


def _wave_speed(modulus, density, poisson):
    return np.sqrt(modulus * (1 - poisson) / ((1 + poisson) * (1 - 2 * poisson)) / density)


def _simulated_over_true(assembly, continuum, some):
    """Ratio of the simulated to the true distance from the middle."""
    simulated = assembly.body.positions_m[some] - (FRAME.to_metres(continuum.positions) - continuum.offset_m)[some]
    return np.linalg.norm(simulated, axis=1) / np.linalg.norm(continuum.offset_m[some], axis=1)


# ------------------------------------------------------------------------------------------------ thickening


FINE_M = 8e-4
"""A cell as thick as the sheet: thin parts need no thickening to bend rightly."""


def test_a_slow_enough_body_on_a_fine_grid_is_simulated_as_it_is(continuum):
    book = _book(lump=_material(youngs_modulus_pa=2e5, density_kgm3=300.0, poisson_ratio=0.2))
    assembly = _assemble(continuum, book, speed_ms=1e4, cell_m=FINE_M)
    body = assembly.body
    np.testing.assert_allclose(body.positions_m, FRAME.to_metres(continuum.positions), atol=1e-12)
    np.testing.assert_array_equal(body.volume_m3, continuum.volume_m3)
    np.testing.assert_array_equal(body.youngs_modulus_pa, [1e8] * 6 + [2e5, 1e8])
    np.testing.assert_array_equal(body.density_kgm3, [800.0] * 6 + [300.0, 800.0])
    np.testing.assert_array_equal(body.poisson_ratio, [0.3] * 2 + [0.0] * 4 + [0.2, 0.3])  # a slender rod feels E
    assert not assembly.true_offset_m.any()
    assert (assembly.thickening, assembly.capped) == ((), ())
    np.testing.assert_allclose(assembly.mass_kg, body.mass_kg, rtol=1e-12)


def test_thickening_keeps_mass_and_bending_stiffness(continuum):
    """Sheets keep rho t and E t^3, rods rho d^2 and E d^4; both stand where the thicker body stands."""
    book = _book()
    assembly = _assemble(continuum, book, speed_ms=150.0, cell_m=2.5e-3)
    body = assembly.body
    for some, powers, wanted in (
        (SHEET_P, (1, 3), 2.5e-3 / 8e-4),
        (ROD_P, (2, 4), _wave_speed(1e8, 800.0, 0.0) / 150.0),
    ):
        ratio = _simulated_over_true(assembly, continuum, some)
        np.testing.assert_allclose(ratio, wanted, rtol=1e-6)
        np.testing.assert_allclose(body.density_kgm3[some] * ratio ** powers[0], 800.0, rtol=1e-6)
        np.testing.assert_allclose(body.youngs_modulus_pa[some] * ratio ** powers[1], 1e8, rtol=1e-6)
    thin = slice(0, 6)
    np.testing.assert_allclose(body.mass_kg[thin], 800.0 * continuum.volume_m3[thin], rtol=1e-9)
    np.testing.assert_allclose(assembly.mass_kg, 800.0 * continuum.volume_m3, rtol=1e-12)
    np.testing.assert_allclose(body.wave_speed_ms[ROD_P], 150.0, rtol=1e-6)


def test_thin_parts_are_a_cell_thick_where_that_does_not_stretch_them(continuum):
    """A sheet or rod much thinner than a cell bends too stiffly; a soft one would be drawn out by its own weight."""
    stiff = _assemble(continuum, _book(), speed_ms=1e4)
    np.testing.assert_allclose(_simulated_over_true(stiff, continuum, SHEET_P) * 8e-4, CELL_M, rtol=1e-6)
    np.testing.assert_allclose(_simulated_over_true(stiff, continuum, ROD_P) * 3e-3, CELL_M, rtol=1e-6)
    soft = _assemble(continuum, _book(leaf=_material(youngs_modulus_pa=1e6)), speed_ms=1e4)
    ratio = _simulated_over_true(soft, continuum, SHEET_P)
    extent_m = np.ptp(FRAME.to_metres(continuum.positions), axis=0).max()
    np.testing.assert_allclose(800.0 * 30.0 * extent_m / 1e6 * ratio**2, 0.05, rtol=1e-6)
    assert 1 < ratio.max() < CELL_M / 8e-4


def test_sheets_are_never_thicker_than_a_cell_and_rods_than_three(continuum):
    assembly = _assemble(continuum, _book(), speed_ms=1.0)
    np.testing.assert_allclose(_simulated_over_true(assembly, continuum, SHEET_P) * 8e-4, CELL_M, rtol=1e-6)
    np.testing.assert_allclose(_simulated_over_true(assembly, continuum, ROD_P) * 3e-3, 3 * CELL_M, rtol=1e-6)
    # What is thicker than the limit already is left alone.
    coarse = _assemble(continuum, _book(), speed_ms=1.0, cell_m=7e-4)
    np.testing.assert_allclose(_simulated_over_true(coarse, continuum, SHEET_P), 1, rtol=1e-9)
    np.testing.assert_allclose(_simulated_over_true(coarse, continuum, ROD_P), 1, rtol=1e-9)


def test_thickening_is_reported_in_millimetres(continuum):
    found = {entry.part: entry for entry in _assemble(continuum, _book(), speed_ms=1.0).thickening}
    assert set(found) == {"leaf", "stem"}
    leaf = found["leaf"]
    assert leaf.true_mm == pytest.approx(0.8)
    assert leaf.simulated_mm == pytest.approx(1e3 * CELL_M)
    ratio = leaf.simulated_mm / leaf.true_mm
    assert leaf.simulated_youngs_modulus_pa * ratio**3 == pytest.approx(leaf.true_youngs_modulus_pa) == 1e8
    assert leaf.simulated_density_kgm3 * ratio == pytest.approx(leaf.true_density_kgm3) == 800.0


def test_held_parts_are_left_as_they_are(continuum):
    body = _assemble(continuum, _book(), speed_ms=1.0).body
    np.testing.assert_allclose(body.positions_m[HELD_P], FRAME.to_metres(continuum.positions)[HELD_P], atol=1e-12)
    assert body.youngs_modulus_pa[HELD_P] == 1e8
    assert body.density_kgm3[HELD_P] == 800.0


# ------------------------------------------------------------------------------------------------ back to the truth


def test_the_true_rest_comes_back_exactly(continuum):
    assembly = _assemble(continuum, _book(), speed_ms=1.0)
    assert np.abs(assembly.true_offset_m).max() > 1e-3
    identity = np.tile(np.eye(3), (8, 1, 1))
    rest, gradients = assembly.true_motion(assembly.body.positions_m, identity)
    np.testing.assert_allclose(rest, FRAME.to_metres(continuum.positions), rtol=0, atol=1e-15)
    np.testing.assert_allclose(gradients, identity, rtol=0, atol=1e-15)


def test_a_turned_body_comes_back_turned(continuum):
    assembly = _assemble(continuum, _book(), speed_ms=1.0)
    turn, shift = Rotation.from_rotvec([0.3, -0.9, 0.4]).as_matrix(), np.array([0.01, 0.02, -0.03])
    turns = np.tile(turn, (8, 1, 1))
    moved, gradients = assembly.true_motion(assembly.body.positions_m @ turn.T + shift, turns)
    np.testing.assert_allclose(moved, FRAME.to_metres(continuum.positions) @ turn.T + shift, rtol=0, atol=1e-14)
    np.testing.assert_allclose(gradients, turns, rtol=0, atol=1e-14)


def test_what_bends_has_the_strain_of_its_true_thickness(continuum):
    """Stretch grows with the distance from the middle: in a stem simulated 3 times as thick it is 3 times too large."""
    assembly = _assemble(continuum, _book(), speed_ms=1.0)
    middle_m = FRAME.to_metres(continuum.positions) - continuum.offset_m
    simulated_m, true_m = assembly.body.positions_m - middle_m, continuum.offset_m
    assert (simulated_m[ROD_P, 0] / true_m[ROD_P, 0]).min() > 2
    assert (simulated_m[SHEET_P, 2] / true_m[SHEET_P, 2]).min() > 2
    curvature_per_m = 4.0

    def bent(offset_m):
        """F of a beam along z that bends about y, and of a sheet in x and y that does, each at one site."""
        gradient = np.tile(np.eye(3), (8, 1, 1))
        gradient[ROD_P, 2, 2] += curvature_per_m * offset_m[ROD_P, 0]
        gradient[SHEET_P, 0, 0] += curvature_per_m * offset_m[SHEET_P, 2]
        return gradient

    positions, gradients = assembly.true_motion(assembly.body.positions_m, bent(simulated_m))
    np.testing.assert_allclose(gradients, bent(true_m), rtol=0, atol=1e-12)
    np.testing.assert_allclose(positions, middle_m + true_m, rtol=0, atol=1e-12)


# ------------------------------------------------------------------------------------------------ thick and stiff


def test_a_thick_lump_is_softened_where_it_cannot_be_seen(continuum):
    """It takes the wave speed that the thin parts need anyway; held parts need none."""
    book = _book(lump=_material(youngs_modulus_pa=5e9, density_kgm3=700.0), pot=_material(youngs_modulus_pa=7e10))
    assembly = _assemble(continuum, book, speed_ms=60.0)
    body = assembly.body
    needed = max(60.0, body.wave_speed_ms[:6].max())
    np.testing.assert_allclose(body.wave_speed_ms[SOLID_P], needed, rtol=1e-9)
    assert body.density_kgm3[SOLID_P] == 700.0
    (cap,) = assembly.capped
    assert cap.part == "lump"
    assert cap.true_youngs_modulus_pa == 5e9
    assert cap.simulated_youngs_modulus_pa == pytest.approx(body.youngs_modulus_pa[6])
    extent_m = np.ptp(FRAME.to_metres(continuum.positions), axis=0).max()
    assert cap.largest_strain == pytest.approx(700.0 * (1 + 9.81 * extent_m) / cap.simulated_youngs_modulus_pa)
    assert cap.largest_strain < 0.01
    assert body.youngs_modulus_pa[7] == 7e10


def test_a_lump_that_would_visibly_give_way_stays_stiff(continuum):
    only_lump = np.array([True] * 6 + [False, True])
    book = _book(lump=_material(youngs_modulus_pa=5e9))
    assembly = _assemble(continuum, book, speed_ms=5.0, held=only_lump)  # rho c^2 / rho = 25: strain 0.06
    assert assembly.body.youngs_modulus_pa[6] == 5e9
    assert assembly.capped == ()
    enough = _assemble(continuum, book, speed_ms=20.0, held=only_lump)
    assert enough.body.youngs_modulus_pa[6] < 5e9
    assert enough.capped[0].largest_strain < 0.01


def test_a_long_lump_that_would_visibly_swing_stays_stiff(continuum):
    """The cap keeps the strain small, and yet a slender bar would wobble like rubber."""
    p = 40
    along = np.linspace(0, 0.2, p)[:, None] * FRAME.rotation[0] / FRAME.metres_per_unit
    bar = replace(
        continuum,
        positions=along,
        part=np.repeat(np.arange(4, dtype=np.int32), [1, 1, p - 3, 1]),
        is_interior=np.zeros(p, bool),
        volume_m3=np.full(p, 1e-9),
        gaussian_index=np.full(p, -1, np.int32),
        piece=np.zeros(p, np.int32),
        shape=np.full(p, SOLID, np.int8),
        thickness_m=np.full(p, np.nan),
        thickness_measured=np.zeros(p, bool),
        offset_m=np.zeros((p, 3)),
        site=np.arange(p),
    )
    still = np.zeros(p, bool)
    book = _book(lump=_material(youngs_modulus_pa=5e9))
    stiff = _assemble(bar, book, speed_ms=60.0, held=still, rigid=still)
    assert (stiff.body.youngs_modulus_pa[bar.part == 2] == 5e9).all()
    slow_film = _assemble(bar, book, speed_ms=60.0, held=still, rigid=still, fps=0.1)
    assert (slow_film.body.youngs_modulus_pa[bar.part == 2] < 5e9).all()


def test_a_solid_part_that_would_be_rigid_anyway_is_not_softened(continuum):
    book = _book(lump=_material(youngs_modulus_pa=2e11, density_kgm3=7860.0))
    assert _assemble(continuum, book, speed_ms=60.0).capped != ()
    assert _assemble(continuum, book, speed_ms=60.0, rigid_ms=500.0).body.youngs_modulus_pa[6] == 2e11


def test_rigid_parts_are_left_as_they_are(continuum):
    everything = np.ones(8, bool)
    assembly = _assemble(continuum, _book(), speed_ms=1.0, held=~everything, rigid=everything)
    np.testing.assert_allclose(assembly.body.positions_m, FRAME.to_metres(continuum.positions), atol=1e-12)
    assert (assembly.body.youngs_modulus_pa == 1e8).all()
    assert (assembly.thickening, assembly.capped) == ((), ())


def test_true_strain_and_yield_are_known(continuum):
    """A sheet simulated n times as thick bends with n times the strain of the true one."""
    book = _book(lump=_material(extra={"yield_stress_pa": 1e6}))
    assembly = _assemble(continuum, book, speed_ms=150.0)
    ratio = _simulated_over_true(assembly, continuum, SHEET_P)
    np.testing.assert_allclose(assembly.strain_ratio[SHEET_P] * ratio, 1, rtol=1e-9)
    assert assembly.strain_ratio[6] == 1
    np.testing.assert_allclose(assembly.yield_strain[SOLID_P], 0.01)
    assert np.isinf(assembly.yield_strain[:6]).all()


# ------------------------------------------------------------------------------------------------ materials


def test_inside_and_outside_take_their_own_material(continuum):
    inside = continuum.is_interior.copy()
    inside[6] = True
    two = PartMaterials(surface=_material(), interior=_material(density_kgm3=50.0, youngs_modulus_pa=1e5))
    book = MaterialBook({**_book().parts, "lump": two, "leaf": two})
    body = _assemble(replace(continuum, is_interior=inside), book, speed_ms=1e4, cell_m=FINE_M).body
    assert (body.density_kgm3[6], body.youngs_modulus_pa[6]) == (50.0, 1e5)
    np.testing.assert_array_equal(body.density_kgm3[SHEET_P], 800.0)


def test_every_particle_runs_the_law_of_its_material(continuum):
    """Surface and interior apart; a yield stress keeps the bending moment of what is thickened."""
    book = _book(
        leaf=_material(law="von_mises", extra={"yield_stress_pa": 1e6, "hardening_modulus_pa": 2e6}),
        stem=_material(law="viscoplastic", extra={"yield_stress_pa": 1e6, "viscosity_pas": 50.0}),
        pot=_material(name="sand", law="drucker_prager", extra={"friction_angle_deg": 33.0}),
    )
    assembly = _assemble(continuum, book, speed_ms=150.0, cell_m=2.5e-3)
    body = assembly.body
    assert (body.law[SHEET_P] == LawId.VON_MISES).all()
    assert (body.law[ROD_P] == LawId.VISCOPLASTIC).all()
    sheet, rod = (_simulated_over_true(assembly, continuum, some) for some in (SHEET_P, ROD_P))
    assert sheet.min() > 1.5 and rod.min() > 1.5
    np.testing.assert_allclose(body.law_numbers["yield_stress_pa"][SHEET_P] * sheet**2, 1e6)
    np.testing.assert_allclose(body.law_numbers["hardening_modulus_pa"][SHEET_P] * sheet**3, 2e6)
    np.testing.assert_allclose(body.law_numbers["yield_stress_pa"][ROD_P] * rod**3, 1e6)
    np.testing.assert_allclose(body.law_numbers["viscosity_pas"][ROD_P] * rod**4, 50.0)
    of_pot = body.law == LawId.DRUCKER_PRAGER
    assert of_pot.any()
    np.testing.assert_allclose(body.law_numbers["friction_angle_deg"][of_pot], 33.0)
    np.testing.assert_allclose(body.law_numbers["cohesion_pa"][of_pot], 0.0)


def test_a_thin_layer_of_what_keeps_no_shape_is_not_thickened(continuum):
    sand = _material(law="drucker_prager", extra={"friction_angle_deg": 33.0})
    assembly = _assemble(continuum, _book(leaf=sand, stem=sand), speed_ms=150.0, cell_m=2.5e-3)
    assert assembly.thickening == ()
    np.testing.assert_allclose(assembly.body.poisson_ratio[ROD_P], _material().poisson_ratio)
