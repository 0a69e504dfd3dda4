"""Sheets one or two sites wide: told apart, seeded in four strands, and elastic when they swing."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from phys4dgen.interior.ribbons import measure_width
from phys4dgen.interior.seed import seed_sheets
from phys4dgen.interior.sites import Sites
from phys4dgen.motion import damped_frequency
from phys4dgen.mpm import Body, Settings, Simulator

TILT = Rotation.from_euler("xyz", [30, 40, 20], degrees=True).as_matrix()


def _strip(width, length=40, turn=TILT):
    """Sites of a flat strip, one voxel apart, long side along the first axis of ``turn``."""
    along, across = np.meshgrid(np.arange(length), np.arange(width) - (width - 1) / 2, indexing="ij")
    s = along.size
    flat = np.column_stack([along.ravel(), across.ravel(), np.zeros(s)])
    step = np.ones((s, 1))
    return Sites(
        position=flat @ turn.T,
        direction=step * turn[:, 2],
        extent=np.ones(s),
        edge_a=step * turn[:, 0],
        edge_b=step * turn[:, 1],
        is_bridge=np.zeros(s, bool),
        is_odd=np.add.outer(np.arange(length), np.arange(width)).ravel() % 2 > 0,
    )


@pytest.mark.parametrize("width", [1, 2])
def test_narrow_strips_are_ribbons_and_their_axis_lies_across(width):
    found = measure_width(_strip(width))
    assert found.is_narrow.all()
    assert not found.is_inner.any()
    np.testing.assert_allclose(np.abs(found.across @ TILT), np.tile([0, 1, 0], (len(found.across), 1)), atol=1e-6)


def test_wide_sheets_are_not_ribbons_but_the_strip_that_grows_out_of_one_is():
    assert not measure_width(_strip(4)).is_narrow.any()
    strip, sheet = _strip(1), _strip(12, length=12)
    joined = Sites(
        *(
            np.concatenate([getattr(sheet, name), getattr(strip, name) + shift])
            for name, shift in (
                ("position", 12 * TILT[:, 0]),
                ("direction", 0),
                ("extent", 0),
                ("edge_a", 0),
                ("edge_b", 0),
                ("is_bridge", False),
                ("is_odd", False),
            )
        )
    )
    narrow = measure_width(joined).is_narrow
    assert not narrow[: len(sheet)].any()
    assert narrow[-30:].all()


def test_strips_that_cross_in_the_air_are_two_ribbons():
    one, other = _strip(1), _strip(1, turn=TILT @ Rotation.from_euler("z", 90, degrees=True).as_matrix())
    over = np.array([20.0, -20, 2]) @ TILT.T
    joined = Sites(
        np.concatenate([one.position, other.position + over]),
        *(np.concatenate([getattr(one, n), getattr(other, n)]) for n in ("direction", "extent", "edge_a", "edge_b")),
        is_bridge=np.zeros(80, bool),
        is_odd=np.concatenate([one.is_odd, other.is_odd]),
    )
    assert measure_width(joined).is_narrow.all()


@pytest.mark.parametrize("width", [1, 2, 4])
def test_ribbons_have_the_volume_and_the_second_moments_of_their_cross_section(width):
    sites = _strip(width)
    seeds = seed_sheets(sites, np.full(len(sites), 0.3), np.ones(len(sites), bool))
    assert len(seeds.volume) == len(sites) * (2 if width == 4 else 4)
    np.testing.assert_array_equal(seeds.site, np.repeat(np.arange(len(sites)), 2 if width == 4 else 4))
    assert seeds.volume.sum() == pytest.approx(len(sites) * 0.3)
    middle = sites.position.mean(0)
    across, normal = (seeds.middle - middle) @ TILT[:, 1], seeds.offset @ TILT[:, 2]
    share = seeds.volume / seeds.volume.sum()
    assert share @ normal**2 == pytest.approx(0.3**2 / 12)
    rows = (width**2 - 1) / 12
    assert share @ across**2 == pytest.approx(rows + (0 if width == 4 else 1 / 12))


def test_a_wide_sheet_has_both_layers_at_its_rim_and_one_by_turns_inside():
    sites = _strip(12, length=20)
    seeds = seed_sheets(sites, np.full(len(sites), 0.3), np.ones(len(sites), bool))
    per_site = np.bincount(seeds.site).reshape(20, 12)
    np.testing.assert_array_equal(per_site[2:-2, 2:-2], 1)
    np.testing.assert_array_equal(np.concatenate([per_site[[0, -1]].ravel(), per_site[:, [0, -1]].ravel()]), 2)
    assert seeds.volume.sum() == pytest.approx(len(sites) * 0.3)
    normal = seeds.offset @ TILT[:, 2]
    assert seeds.volume @ normal**2 / seeds.volume.sum() == pytest.approx(0.3**2 / 12)
    coarse = seed_sheets(sites, np.full(len(sites), 0.3), np.ones(len(sites), bool), spacing_cells=0.75)
    np.testing.assert_array_equal(np.bincount(coarse.site), 2)
    faces = np.sign(normal[per_site.ravel()[seeds.site] == 1])
    np.testing.assert_array_equal(faces, np.where(sites.is_odd[per_site.ravel() == 1], 1, -1))


def _disc_of_columns(normal, radius=12.0):
    """Sites of a round sheet, one per voxel column as ``sheet_sites`` makes them, and how far they are out."""
    normal = np.array(normal) / np.linalg.norm(normal)
    axis = np.abs(normal).argmax()
    others = [(axis + 1) % 3, (axis + 2) % 3]
    columns = np.stack(np.meshgrid(np.arange(-30, 31), np.arange(-30, 31), indexing="ij"), -1).reshape(-1, 2)
    edges = np.zeros((2, 3))
    edges[[0, 1], others] = 1
    edges[:, axis] = -normal[others] / normal[axis]
    position = columns @ edges
    away = np.linalg.norm(position, axis=1)
    s = int((away < radius).sum())
    return Sites(
        position[away < radius],
        np.tile(normal, (s, 1)),
        np.full(s, 1 / np.abs(normal[axis])),
        np.tile(edges[0], (s, 1)),
        np.tile(edges[1], (s, 1)),
        np.zeros(s, bool),
        columns[away < radius].sum(1) % 2 > 0,
    ), away[away < radius]


@pytest.mark.parametrize("normal", [(0, 0, 1), (0.3, 0.5, 0.8), (1, 0, 0.85), (-0.4, 1, 0.4), (0.7, 0.2, -1)])
def test_a_sheet_is_inner_where_it_goes_on_whatever_its_normal(normal):
    sites, away = _disc_of_columns(normal)
    inner = measure_width(sites).is_inner
    assert inner[away < 7].all()
    assert not inner[away > 10.8].any()


@pytest.mark.parametrize("seed", range(12))
def test_inside_begins_two_rows_from_the_edge_whatever_the_normal(seed):
    """The edge runs along a row of columns, here the first axis of them."""
    rng = np.random.default_rng(seed)
    normal = np.append(rng.uniform(-0.7, 0.7, 2), 1.0)
    normal[:2] *= min(1, 0.85 / np.linalg.norm(normal[:2]))  # not too oblique
    sites, _ = _disc_of_columns(normal, radius=14)
    row = np.rint(sites.position[:, 0]).astype(int)
    cut = row <= 0
    half = sites.where(cut, sites.extent)
    from_edge, middle = -row[cut], np.abs(half.position[:, 1]) < 4
    inner = measure_width(half).is_inner
    assert not inner[(from_edge < 2) & middle].any()
    assert inner[(from_edge >= 2) & (from_edge < 6) & middle].all()


@pytest.mark.parametrize("normal", [(1, 1, 1), (-1, 0.8, 0.9)])
def test_where_columns_make_a_triangular_lattice_both_faces_stay(normal):
    """There by turns is by rows: such a strip swings at .77 of its frequency, with a damping ratio of .085."""
    sites, _ = _disc_of_columns(normal)
    assert not measure_width(sites).is_inner.any()


@pytest.mark.parametrize(("width", "largest_ratio"), [(1, 0.18), (2, 0.06), (8, 0.04)])
def test_a_ribbon_oblique_to_the_grid_swings_and_comes_back(width, largest_ratio):
    """Two layers alone: a ribbon of two sites has a damping ratio of 0.30 and stays bent, one of one site is limp."""
    cell_m, thickness, youngs_modulus_pa, density_kgm3 = 5e-3, 2.0, 2e4, 60.0  # as thickened: one cell, two voxels
    voxel_m = cell_m / 2
    sites = _strip(width, length=60)
    seeds = seed_sheets(sites, np.full(len(sites), thickness), np.ones(len(sites), bool))
    points = (seeds.middle + seeds.offset) * voxel_m
    p = len(points)
    along = (points @ TILT)[:, 0]
    held = along < 6 * voxel_m
    length_m = 54 * voxel_m
    frequency_hz = 0.1615 * thickness * voxel_m / length_m**2 * math.sqrt(youngs_modulus_pa / density_kgm3)
    speed = np.clip((along - 6 * voxel_m) / length_m, 0, 1) ** 2 * 2 * math.pi * frequency_hz * 0.1 * length_m
    body = Body(
        positions_m=points - points.min(0) + 0.3 * cell_m,
        volume_m3=seeds.volume * voxel_m**3,
        density_kgm3=np.full(p, density_kgm3),
        youngs_modulus_pa=np.full(p, youngs_modulus_pa),
        poisson_ratio=np.zeros(p),
        law=np.zeros(p, np.int32),
        part=np.zeros(p, np.int32),
        held=held,
        part_names=("ribbon",),
        velocities_ms=speed[:, None] * TILT[:, 2],
    )
    step_s = 1 / (20 * frequency_hz)
    simulator = Simulator(body, Settings(dx_m=cell_m, frame_time_s=step_s, cfl=0.6, chunks=1))
    tip = np.flatnonzero(along > along.max() - 2 * voxel_m)
    rest = body.positions_m[tip]
    swing = np.array([((simulator.advance().positions_m[tip] - rest) @ TILT[:, 2]).mean() for _ in range(44)])
    found_hz, ratio = damped_frequency(swing, step_s)
    assert found_hz == pytest.approx(frequency_hz, rel=0.25)
    assert ratio < largest_ratio
    assert swing.min() < -0.3 * swing.max()  # it swings through
