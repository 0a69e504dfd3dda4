"""The mean over the thickness: of a field that is linear across it, the value in the middle."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from phys4dgen.interior import cross_section_means
from phys4dgen.interior.seed import join_seeds, seed_rods, seed_sheets, seed_solid
from phys4dgen.interior.sites import Sites
from phys4dgen.types import ROD, SHEET, SOLID, Continuum, Frame

TILT = Rotation.from_euler("xyz", [30, 40, 20], degrees=True).as_matrix()
FRAME = Frame(Rotation.from_euler("xyz", [-15, 5, 60], degrees=True).as_matrix(), 0.25)
SPACING_M = 2e-3


def _sheet_sites(length, width):
    along, across = np.meshgrid(np.arange(length), np.arange(width), indexing="ij")
    s = along.size
    zero = np.zeros((s, 3))
    position = np.column_stack([along.ravel(), across.ravel(), np.zeros(s)]) @ TILT.T
    normal = np.tile(TILT[:, 2], (s, 1))
    return Sites(position, normal, np.ones(s), zero, zero, zero[:, 0] > 0, (along + across).ravel() % 2 > 0)


def _continuum(seeds):
    p = len(seeds.volume)
    return Continuum(
        positions=FRAME.from_metres((seeds.middle + seeds.offset) * SPACING_M),
        part=np.zeros(p, np.int32),
        is_interior=np.zeros(p, bool),
        volume_m3=seeds.volume * SPACING_M**3,
        gaussian_index=np.full(p, -1),
        piece=np.zeros(p, np.int32),
        shape=seeds.shape,
        thickness_m=seeds.thickness * SPACING_M,
        thickness_measured=seeds.measured,
        offset_m=seeds.offset * SPACING_M,
        site=seeds.site,
        spacing_m=SPACING_M,
    )


@pytest.fixture(scope="module")
def continuum():
    """A sheet of 12 by 20 sites, wide enough for single particles inside, a rod of 15 sites and a few solids."""
    sheet = _sheet_sites(20, 12)
    axis = np.tile(TILT[:, 1], (15, 1))
    zero = np.zeros((15, 3))
    rod = Sites(
        axis * np.arange(15)[:, None] + [0, 0, 40], axis, np.ones(15), zero, zero, axis[:, 0] > 9, zero[:, 0] > 0
    )
    return _continuum(
        join_seeds(
            [
                seed_solid(np.array([[60, 0, 0], [61, 0, 0]]), np.ones(2)),
                seed_sheets(sheet, np.full(len(sheet), 0.8), np.ones(len(sheet), bool)),
                seed_rods(rod, np.full(15, 1.4), np.ones(15, bool)),
            ]
        )
    )


def _means(continuum, values):
    means = cross_section_means(continuum, frame=FRAME)
    np.testing.assert_allclose(np.asarray(means.sum(1)).ravel(), 1, rtol=1e-12)
    return means @ values


def test_what_is_linear_across_the_thickness_is_taken_to_the_middle(continuum):
    middle_m = FRAME.to_metres(continuum.positions) - continuum.offset_m
    linear = 3.0 + 40 * middle_m @ TILT[:, 0] + 700 * continuum.offset_m @ [0.3, -0.8, 0.5]
    found = _means(continuum, linear)
    expected = 3.0 + 40 * middle_m @ TILT[:, 0]
    solid, single = continuum.shape == SOLID, np.bincount(continuum.site)[continuum.site] == 1
    np.testing.assert_array_equal(found[solid], linear[solid])
    np.testing.assert_allclose(found[~single], expected[~single], rtol=0, atol=1e-9)
    assert (single & (continuum.shape == SHEET)).sum() > 60
    np.testing.assert_allclose(found[single & ~solid], expected[single & ~solid], rtol=0, atol=0.02)
    assert np.abs(linear - expected)[single & ~solid].min() > 0.1


def test_a_constant_stays_and_solids_keep_their_own(continuum):
    np.testing.assert_allclose(_means(continuum, np.full(len(continuum), 2.5)), 2.5, rtol=1e-12)
    values = np.random.default_rng(0).normal(size=len(continuum))
    found = _means(continuum, values)
    solid, rods = continuum.shape == SOLID, continuum.shape == ROD
    np.testing.assert_array_equal(found[solid], values[solid])
    expected = np.repeat(values[rods].reshape(15, 9).mean(1), 9)
    np.testing.assert_allclose(found[rods], expected, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(_means(continuum.subset(solid), values[solid]), values[solid])


def test_a_particle_whose_other_side_is_missing_keeps_its_own(continuum):
    one = np.flatnonzero(continuum.shape == SHEET)[[100]]
    alone = continuum.subset(np.isin(np.arange(len(continuum)), one))
    np.testing.assert_array_equal(_means(alone, np.array([4.0])), [4.0])


def test_sheets_of_two_pieces_do_not_mix(continuum):
    faces = np.sign(continuum.offset_m @ TILT[:, 2])
    torn = replace(continuum, piece=(faces > 0).astype(np.int32))
    values = np.where(faces > 0, 5.0, -5.0)
    sheet = continuum.shape == SHEET
    np.testing.assert_array_equal(_means(torn, values)[sheet], values[sheet])
    np.testing.assert_allclose(_means(continuum, values)[sheet], 0, atol=1e-12)


def test_a_leaf_right_above_another_is_not_its_other_face():
    lower = _sheet_sites(20, 12)
    upper = replace(lower, position=lower.position + 0.9 * TILT[:, 2], is_odd=~lower.is_odd)
    thick, known = np.full(len(lower), 0.4), np.ones(len(lower), bool)
    leaves = _continuum(join_seeds([seed_sheets(lower, thick, known), seed_sheets(upper, thick, known)]))
    values = (leaves.site < len(lower)).astype(float)
    np.testing.assert_array_equal(_means(leaves, values), values)


@pytest.mark.parametrize("seed", range(20))
def test_all_nine_strands_have_one_mean_whatever_the_axis(seed):
    """The middle strand's own offset is zero, and that of all nine is zero but for rounding."""
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    axes = np.tile(axis / np.linalg.norm(axis), (5, 1))
    zero = np.zeros((5, 3))
    none = np.zeros(5, bool)
    rod = Sites(axes * np.arange(5)[:, None], axes, np.ones(5), zero, zero, none, none)
    stalk = _continuum(seed_rods(rod, rng.uniform(0.3, 3, 5), ~none))
    values = rng.normal(size=45)
    expected = np.repeat(values.reshape(5, 9).mean(1), 9)
    np.testing.assert_allclose(_means(stalk, values), expected, rtol=0, atol=1e-12)
