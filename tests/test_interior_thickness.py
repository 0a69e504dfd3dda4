"""Thickness of sheets and rods: read from clouds of known thickness, and set where it is known from elsewhere."""

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from phys4dgen.interior.measure import (
    GaussianCloud,
    is_stout,
    measure_rods,
    measure_sheets,
    sheet_thickness_from_moments,
)
from phys4dgen.interior.seed import join_seeds, seed_rods, seed_sheets, seed_solid
from phys4dgen.interior.sites import Sites
from phys4dgen.interior.thickness import with_thickness
from phys4dgen.types import ROD, SHEET, SOLID, Continuum, Frame

TILT = Rotation.from_euler("xyz", [25, -40, 15], degrees=True).as_matrix()


def _cloud(means, covariance=None, opacity=0.9):
    covariance = np.eye(3) * 0.01 if covariance is None else covariance
    return GaussianCloud(
        means, np.broadcast_to(covariance, (len(means), 3, 3)).copy(), np.full(len(means), float(opacity))
    )


def _sites(position, direction):
    s = len(position)
    zero = np.zeros((s, 3))
    return Sites(
        position,
        np.broadcast_to(direction, (s, 3)).copy(),
        np.ones(s),
        zero,
        zero,
        np.zeros(s, bool),
        np.zeros(s, bool),
    )


# ------------------------------------------------------------------------------------------------ from moments


@pytest.mark.parametrize("face_share", [0.0, 0.3, 0.6, 1.0])
def test_moments_tell_a_filled_sheet_from_two_faces(face_share):
    """The second moment alone would read two faces 1.7 times as thick as the same sheet filled evenly."""
    rng = np.random.default_rng(1)
    t, k = 0.8, 4000
    inside = rng.uniform(-t / 2, t / 2, (5, k))
    faces = rng.choice([-t / 2, t / 2], (5, k))
    offsets = np.where(rng.random((5, k)) < face_share, faces, inside)
    found = np.median(sheet_thickness_from_moments(offsets, np.full((5, k), 1 / k)))
    np.testing.assert_allclose(found, t, rtol=0.05)


def test_moments_obey_weights_and_stray_points():
    rng = np.random.default_rng(2)
    offsets = rng.uniform(-0.5, 0.5, (1, 3000))
    stray = np.concatenate([offsets, np.full((1, 10), 4.0)], 1)
    clean = sheet_thickness_from_moments(offsets, np.full(offsets.shape, 1 / offsets.size))
    even = np.full(stray.shape, 1 / stray.size)
    np.testing.assert_allclose(sheet_thickness_from_moments(stray, even), clean, rtol=1e-6)
    ignored = np.where(stray == 4.0, 0, 1 / offsets.size)
    np.testing.assert_allclose(sheet_thickness_from_moments(stray, ignored), clean, rtol=1e-9)


# ------------------------------------------------------------------------------------------------ sheets


def _curved_leaf(thickness, *, faces_only, seed=3):
    """Points of a leaf curved along and across (radii 20 and 40 voxels), and sites beside its mid-surface."""
    rng = np.random.default_rng(seed)
    uv = rng.uniform([-9, -5], [9, 5], (700, 2))
    half = thickness / 2
    w = rng.choice([-half, half], len(uv)) if faces_only else rng.uniform(-half, half, len(uv))

    def surface(uv):
        slope = np.stack([uv[:, 0] / 20, -uv[:, 1] / 40, -np.ones(len(uv))], 1)
        normal = -slope / np.linalg.norm(slope, axis=1, keepdims=True)
        height = uv[:, 0] ** 2 / 40 - uv[:, 1] ** 2 / 80
        return np.column_stack([uv, height]), normal

    point, normal = surface(uv)
    site_uv = rng.uniform([-6, -2.5], [6, 2.5], (150, 2))
    site, site_normal = surface(site_uv)
    beside = site + 0.4 * site_normal
    sites = Sites(
        beside @ TILT.T,
        site_normal @ TILT.T,
        np.ones(150),
        np.zeros((150, 3)),
        np.zeros((150, 3)),
        np.zeros(150, bool),
        np.zeros(150, bool),
    )
    return _cloud((point + w[:, None] * normal) @ TILT.T), sites, site @ TILT.T, site_normal @ TILT.T


@pytest.mark.parametrize("faces_only", [False, True])
@pytest.mark.parametrize("thickness", [0.4, 1.0])
def test_a_curved_leaf_is_measured_and_its_middle_found(thickness, faces_only):
    cloud, sites, middle, normal = _curved_leaf(thickness, faces_only=faces_only)
    moved, found, trusted = measure_sheets(sites, cloud, radius=4.0)
    assert trusted.mean() > 0.9
    np.testing.assert_allclose(np.median(found[trusted]), thickness, rtol=0.10)
    off = np.abs(((moved.position - middle) * normal).sum(1))
    assert np.median(off) < 0.1  # they started 0.4 beside it
    np.testing.assert_array_equal(moved.extent, sites.extent)


def test_too_few_or_too_round_a_neighbourhood_is_not_trusted():
    rng = np.random.default_rng(4)
    ball = rng.normal(0, 1, (2000, 3))
    sites = _sites(np.zeros((3, 3)), [0.0, 0, 1])
    _, thickness, trusted = measure_sheets(sites, _cloud(ball), radius=3.0)
    assert not trusted.any()
    assert np.isnan(thickness).all()
    flat = rng.uniform([-3, -3, -0.1], [3, 3, 0.1], (15, 3))
    moved, _, trusted = measure_sheets(sites, _cloud(flat), radius=3.0)
    assert not trusted.any()
    np.testing.assert_array_equal(moved.position, sites.position)
    faint = _cloud(rng.uniform([-3, -3, -0.1], [3, 3, 0.1], (2000, 3)), opacity=0.05)
    assert not measure_sheets(sites, faint, radius=3.0)[2].any()


def test_a_stem_is_stout_and_a_leaf_is_not():
    rng = np.random.default_rng(5)
    turn = rng.uniform(0, 2 * np.pi, 1500)
    stem = np.stack([np.cos(turn), np.sin(turn), rng.uniform(-8, 8, 1500)], 1)
    leaf = rng.uniform([-8, -8, -0.3], [8, 8, 0.3], (6000, 3))
    points = np.array([[0.0, 0, z] for z in (-3, 0, 3)])
    assert is_stout(points, _cloud(stem)).all()
    assert not is_stout(points * [0, 0, 0.05], _cloud(leaf)).any()
    assert not is_stout(points, _cloud(stem[:20])).any()  # too few to say


# ------------------------------------------------------------------------------------------------ rods


def _rod(points_xyz, width, *, covariance=None):
    """Read a rod along z, turned into general position, with sites half a voxel beside its axis."""
    position = np.column_stack([np.full(17, 0.4), np.full(17, -0.3), np.arange(-8, 9)]).astype(float)
    cloud = _cloud(points_xyz @ TILT.T, None if covariance is None else TILT @ covariance @ TILT.T)
    section = np.full(17, np.pi * (width / 2 + 0.8) ** 2)
    return measure_rods(_sites(position @ TILT.T, TILT[:, 2]), section, cloud)


@pytest.mark.parametrize("diameter", [0.8, 2.0, 3.5])
@pytest.mark.parametrize("filled", [False, True])
def test_a_densely_captured_rod_is_read_whether_hollow_or_filled(diameter, filled):
    rng = np.random.default_rng(6)
    n = 3000
    radius = diameter / 2 * (np.sqrt(rng.random(n)) if filled else np.ones(n))
    turn = rng.uniform(0, 2 * np.pi, n)
    points = np.stack([radius * np.cos(turn), radius * np.sin(turn), rng.uniform(-12, 12, n)], 1)
    reading = _rod(points, diameter)
    assert reading.trusted.all()
    assert not reading.is_ribbon.any()
    np.testing.assert_allclose(np.median(reading.width), diameter, rtol=0.10)
    beside = np.linalg.norm((reading.sites.position @ TILT)[:, :2], axis=1)
    assert np.median(beside) < 0.1 * diameter + 0.05


def test_a_rod_of_a_few_long_gaussians_is_read():
    """Six strands round a stem of diameter 2; in each slice fewer than a dozen Gaussians count."""
    turn = np.arange(6) * np.pi / 3
    z = np.arange(-14, 15, 7.0)
    points = np.array([[np.cos(t), np.sin(t), height + 0.5 * k] for k, t in enumerate(turn) for height in z])
    reading = _rod(points, 2.0, covariance=np.diag([0.1**2, 0.1**2, 3.0**2]))
    assert reading.trusted.all()
    assert not reading.is_ribbon.any()
    np.testing.assert_allclose(np.median(reading.width), 2.0, rtol=0.15)


@pytest.mark.parametrize("sparse", [False, True])
def test_a_blade_of_grass_is_a_ribbon_with_its_wide_direction(sparse):
    rng = np.random.default_rng(7)
    if sparse:  # three long Gaussians side by side, each seen to 1.1 standard deviations
        points = np.array([[x, 0.0, z] for x in (-0.7, 0, 0.7) for z in np.arange(-14, 15, 3.0)])
        reading = _rod(points, 2.0, covariance=np.diag([0.3**2, 0.05**2, 3.0**2]))
    else:
        points = rng.uniform([-1, -0.1, -12], [1, 0.1, 12], (2500, 3))
        reading = _rod(points, 2.0)
    assert reading.is_ribbon.mean() > 0.9
    np.testing.assert_allclose(np.median(reading.width[reading.is_ribbon]), 2.0, rtol=0.15)
    wide = np.abs(reading.across @ TILT[:, 0])
    assert np.median(wide) > np.cos(np.radians(8))


def test_the_next_blade_does_not_count():
    """Two blades of grass three voxels apart: the slice of one must not reach the other."""
    one = np.array([[0, 0.0, z] for z in np.arange(-14, 15, 1.0)])
    both = np.concatenate([one, one + np.array([3.0, 0, 0])])
    covariance = np.diag([0.2**2, 0.2**2, 2.0**2])
    alone, beside = _rod(one, 1.0, covariance=covariance), _rod(both, 1.0, covariance=covariance)
    np.testing.assert_allclose(beside.width, alone.width, rtol=1e-6)


def test_a_long_gaussian_that_crosses_the_rod_does_not_count():
    along = np.array([[0, 0.0, z] for z in np.arange(-14, 15, 0.5)])
    across = np.array([[0.2, 0.1, z] for z in np.arange(-8, 9, 2.0)])
    thin = np.array(
        [np.diag([0.2**2, 0.2**2, 1.0**2])] * len(along) + [np.diag([2.0**2, 0.1**2, 0.1**2])] * len(across)
    )
    sites = _sites(np.column_stack([np.zeros((9, 2)), np.arange(-4, 5)]), [0.0, 0, 1])
    both = GaussianCloud(np.concatenate([along, across]), thin, np.full(len(thin), 0.9))
    alone = GaussianCloud(along, thin[: len(along)], np.full(len(along), 0.9))
    section = np.full(9, 6.0)
    crossed, clean = measure_rods(sites, section, both), measure_rods(sites, section, alone)
    assert not crossed.is_ribbon.any()
    np.testing.assert_allclose(crossed.width, clean.width, rtol=1e-6)


# ------------------------------------------------------------------------------------------------ particles


def _second_moments(seeds, axes):
    """Volume-weighted second moments of the offsets along axes, over the whole volume."""
    return (seeds.volume[:, None] * (seeds.offset @ np.transpose(axes)) ** 2).sum(0) / seeds.volume.sum()


def test_layers_of_a_sheet_have_its_volume_and_second_moment():
    sites = _sites(np.zeros((4, 3)), TILT[:, 2])
    seeds = seed_sheets(sites.where(np.ones(4, bool), np.full(4, 0.7)), np.full(4, 0.3), np.ones(4, bool))
    assert seeds.volume.sum() == pytest.approx(4 * 0.7 * 0.3)
    np.testing.assert_allclose(_second_moments(seeds, TILT.T), [0, 0, 0.3**2 / 12], atol=1e-12)
    np.testing.assert_allclose(seeds.offset.reshape(4, -1, 3).sum(1), 0, atol=1e-12)
    assert (seeds.shape == SHEET).all()


@pytest.mark.parametrize("axis", [TILT[:, 2], np.array([0.0, 0, 1]), np.array([1.0, 0, 0])])
def test_strands_of_a_rod_have_its_volume_and_second_moments(axis):
    sites = _sites(np.zeros((4, 3)), axis)
    seeds = seed_rods(sites.where(np.ones(4, bool), np.full(4, 1.3)), np.full(4, 0.6), np.ones(4, bool))
    assert seeds.volume.sum() == pytest.approx(4 * 1.3 * np.pi * 0.6**2 / 4)
    across = np.linalg.svd(axis[None])[2][1:]
    np.testing.assert_allclose(_second_moments(seeds, [axis, *across]), [0, 0.6**2 / 16, 0.6**2 / 16], atol=1e-12)
    assert (seeds.shape == ROD).all()


def test_a_solid_particle_stands_for_the_solid_share_of_its_voxel():
    seeds = seed_solid(np.array([[1, 2, 3], [4, 5, 6]]), np.array([1.0, 0.25]))
    np.testing.assert_array_equal(seeds.volume, [1, 0.25])
    np.testing.assert_array_equal(seeds.middle + seeds.offset, [[1, 2, 3], [4, 5, 6]])
    joined = join_seeds([seeds, seed_solid(np.array([[7, 8, 9]]), np.ones(1))])
    np.testing.assert_array_equal(joined.middle[:, 0], [1, 4, 7])
    assert np.isnan(joined.thickness).all()


# ------------------------------------------------------------------------------------------------ known thickness


@pytest.fixture(scope="module")
def frame():
    return Frame(TILT, 0.25)


@pytest.fixture(scope="module")
def continuum(frame):
    """A measured leaf, an unmeasured leaf, an unmeasured stem and a solid, two particles each; parts 0 to 3."""
    shape = np.repeat([SHEET, SHEET, ROD, SOLID], 2).astype(np.int8)
    thickness_m = np.repeat([1e-3, 8e-4, 3e-3, np.nan], 2)
    rng = np.random.default_rng(8)
    normal = rng.normal(size=(4, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    half = np.repeat(np.where(np.isnan(thickness_m[::2]), 0, thickness_m[::2] / (2 * np.sqrt(3))), 2)
    offset = np.repeat(normal, 2, 0) * (half * np.tile([1, -1], 4))[:, None]
    middle = np.repeat(rng.uniform(-0.1, 0.1, (4, 3)), 2, 0)
    return Continuum(
        positions=frame.from_metres(middle + offset),
        part=np.repeat(np.arange(4), 2).astype(np.int32),
        is_interior=np.zeros(8, bool),
        volume_m3=rng.uniform(1e-9, 2e-9, 8),
        gaussian_index=np.full(8, -1, np.int32),
        piece=np.zeros(8, np.int32),
        shape=shape,
        thickness_m=thickness_m,
        thickness_measured=np.repeat([True, False, False, False], 2),
        offset_m=offset,
        site=np.repeat(np.arange(4, dtype=np.int32), 2),
        spacing_m=2e-3,
    )


def _middle_m(continuum, frame):
    return frame.to_metres(continuum.positions) - continuum.offset_m


def test_the_library_fills_only_what_was_not_measured(continuum, frame):
    found = with_thickness(continuum, frame=frame, given_m={}, library_m={0: 2e-4, 1: 2e-4, 2: 9e-3, 3: 1.0})
    np.testing.assert_array_equal(found.thickness_m[:6], [1e-3, 1e-3, 2e-4, 2e-4, 3e-3, 3e-3])
    changed = np.array([0, 0, 1, 1, 0, 0, 0, 0], bool)
    np.testing.assert_array_equal(found.positions[~changed], continuum.positions[~changed])
    np.testing.assert_allclose(found.volume_m3, continuum.volume_m3 * np.where(changed, 0.25, 1), rtol=1e-12)


def test_the_user_wins_over_what_was_measured_and_over_the_library(continuum, frame):
    given = {0: 5e-4, 1: 1.6e-3, 2: 6e-3, 3: 0.05}
    found = with_thickness(continuum, frame=frame, given_m=given, library_m={0: 1.0, 1: 1.0})
    np.testing.assert_allclose(found.thickness_m[:6], np.repeat([5e-4, 1.6e-3, 6e-3], 2))
    # A sheet keeps its area; a rod keeps its length; a solid has no thickness to be given.
    np.testing.assert_allclose(found.volume_m3 / continuum.volume_m3, np.repeat([0.5, 2, 4, 1], 2), rtol=1e-12)
    np.testing.assert_allclose(found.offset_m, continuum.offset_m * np.repeat([0.5, 2, 2, 1], 2)[:, None], atol=1e-15)
    np.testing.assert_allclose(_middle_m(found, frame), _middle_m(continuum, frame), atol=1e-12)
    np.testing.assert_array_equal(found.positions[6:], continuum.positions[6:])


def test_thickness_is_settled_once(continuum, frame):
    known = {"given_m": {0: 5e-4}, "library_m": {1: 3e-4}}
    once = with_thickness(continuum, frame=frame, **known)
    twice = with_thickness(once, frame=frame, **known)
    for field in fields(Continuum):
        np.testing.assert_allclose(getattr(twice, field.name), getattr(once, field.name), rtol=1e-12)
    assert with_thickness(continuum, frame=frame, given_m={}, library_m={}) is continuum
    solid = replace(continuum, shape=np.full(8, SOLID, np.int8), thickness_m=np.full(8, np.nan))
    assert with_thickness(solid, frame=frame, given_m={0: 1e-4}, library_m={1: 1e-4}) is solid
