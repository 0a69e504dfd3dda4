"""The bundled potted flower: its truth against independent measurements, and its looks against numbers."""

from __future__ import annotations

import time

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial import KDTree

from phys4dgen.materials.library import material
from phys4dgen.render.cameras import view_cameras
from phys4dgen.render.rasterise import Rasteriser
from phys4dgen.scene import Scene
from phys4dgen.types import Parts, rotation_from_quats, rotation_to_z_up
from phys4dgen.zoo import ZooObject, potted_flower
from phys4dgen.zoo.flower_shapes import FlowerShapes


@pytest.fixture(scope="module")
def flower() -> ZooObject:
    return potted_flower()


def part_points_m(flower: ZooObject, name: str) -> np.ndarray:
    chosen = flower.labels == flower.part_names.index(name)
    return flower.gaussians.means[chosen].astype(np.float64) * flower.metres_per_unit


def test_same_seed_gives_the_same_arrays_and_another_seed_does_not(flower):
    start = time.process_time()
    again = potted_flower()
    assert time.process_time() - start < 3.0  # seconds of one core
    other = potted_flower(seed=1)
    for name in ("means", "quats_wxyz", "scales", "opacities", "sh"):
        np.testing.assert_array_equal(getattr(again.gaussians, name), getattr(flower.gaussians, name))
    np.testing.assert_array_equal(again.labels, flower.labels)
    assert again.truth == flower.truth
    n = min(len(other.gaussians), len(flower.gaussians))
    assert not np.array_equal(other.gaussians.means[:n], flower.gaussians.means[:n])


def test_parts_are_complete_and_numbered_from_the_ground_up(flower):
    parts = Parts(labels=flower.labels, names=flower.part_names, backend="zoo")
    assert flower.part_names == ("pot", "soil", "stem", "leaves", "petals", "heart")
    assert 60_000 <= len(flower.gaussians) <= 90_000
    counts = np.bincount(flower.labels)
    assert counts.min() > 1000 and parts.count == 6
    lowest = [part_points_m(flower, name)[:, 1].min() for name in flower.part_names]
    assert lowest[:5] == sorted(lowest[:5])


def test_height_is_what_the_product_measures(flower):
    lower, upper = flower.gaussians.robust_bounds(rotation=rotation_to_z_up(flower.up))
    assert flower.height_m / (upper[2] - lower[2]) == pytest.approx(flower.metres_per_unit, rel=1e-6)
    assert flower.height_m == pytest.approx(0.35, abs=0.01)
    assert flower.gaussians.means[:, 1].min() == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("name", ["pot", "soil", "stem", "leaves", "petals", "heart"])
def test_volume_agrees_with_the_inside_test(flower, name):
    """Stratified Monte Carlo: cells near the part, or all cells of its box where it is massive."""
    points = part_points_m(flower, name)
    massive = name in ("pot", "soil", "heart")
    cells = {"pot": 0.004, "soil": 0.004, "heart": 0.002, "stem": 0.004, "leaves": 0.002, "petals": 0.0015}
    cell, k = cells[name], 4 if name == "stem" else 2
    lower, upper = points.min(0) - 2 * cell, points.max(0) + 2 * cell
    if name == "soil":
        lower[1] = 0.0  # the soil's Gaussians cover its surface only
    near = np.ones(np.ceil((upper - lower) / cell).astype(int), bool)
    if not massive:
        near[:] = False
        near[tuple(((points - lower) / cell).astype(int).T)] = True
        near = ndimage.binary_dilation(near, np.ones((3, 3, 3)))
    corner = np.argwhere(near) * cell + lower
    sub = np.argwhere(np.ones((k, k, k)))
    rng = np.random.default_rng(0)
    samples = corner[:, None] + (sub + rng.uniform(size=(len(corner), k**3, 3))) * (cell / k)
    part = flower.inside(samples.reshape(-1, 3) / flower.metres_per_unit)
    volume = np.count_nonzero(part == flower.part_names.index(name)) * (cell / k) ** 3
    assert flower.truth[name].volume_m3 == pytest.approx(volume, rel=0.02)


def test_inside_at_places_known_by_eye(flower):
    metres = np.array(
        [
            [0.0, 0.004, 0.0],  # the floor of the pot
            [0.060, 0.098, 0.0],  # its lip
            [0.0, 0.05, 0.0],  # the soil
            [0.0, 0.104, 0.045],  # the air above the soil, below the lip
            [0.2, 0.2, 0.2],  # far away
        ]
    )
    names = [*flower.part_names, "air"]
    found = [names[k] for k in flower.inside(metres / flower.metres_per_unit)]
    assert found == ["pot", "pot", "soil", "air", "air"]


def test_gaussians_lie_on_the_surface_of_their_part(flower):
    """A step of 0.3 mm inwards from the surface of a part ends in that part, a step outwards leaves it."""
    g, mpu = flower.gaussians, flower.metres_per_unit
    normals = rotation_from_quats(g.quats_wxyz)[:, :, 2]
    step = 0.0003 / mpu
    for name in ("pot", "stem", "leaves", "petals", "heart"):
        chosen = np.flatnonzero(flower.labels == flower.part_names.index(name))[::7]
        means, out = g.means[chosen].astype(np.float64), normals[chosen]
        inward = flower.inside(means - step * out) == flower.part_names.index(name)
        outward = flower.inside(means + step * out) == flower.part_names.index(name)
        assert inward.mean() > 0.93, name
        if name in ("pot", "stem", "heart"):  # sheets also have Gaussians between their faces
            assert outward.mean() < 0.07, name


def test_sheet_areas_agree_with_a_triangulation(flower):
    shapes = FlowerShapes(0)
    for name, blades in (("leaves", shapes.leaves), ("petals", shapes.petals)):
        total = 0.0
        for blade in blades:
            u, v = np.meshgrid(np.linspace(0, 1, 301), np.linspace(-1, 1, 25), indexing="ij")
            grid = blade.mid_surface(u.ravel(), (v * blade.half_width(u)).ravel()).reshape(301, 25, 3)
            a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
            for first, second in ((b - a, c - a), (c - a, d - a)):
                total += 0.5 * np.linalg.norm(np.cross(first, second), axis=-1).sum()
        assert flower.truth[name].area_m2 == pytest.approx(total, rel=0.005)


@pytest.mark.parametrize("name", ["leaves", "petals"])
def test_thickness_measured_from_the_centres_along_the_normals(flower, name):
    """Second and fourth moment of a mixture of two faces (share p) and a uniform filling give p and t."""
    g, mpu = flower.gaussians, flower.metres_per_unit
    chosen = np.flatnonzero(flower.labels == flower.part_names.index(name))
    points = g.means[chosen].astype(np.float64) * mpu
    normals = rotation_from_quats(g.quats_wxyz[chosen])[:, :, 2]
    tree = KDTree(points)
    rng = np.random.default_rng(0)
    p = np.linspace(1, 0, 200)
    spread, peak = (1 + 2 * p) / 3, (1 + 4 * p) / 5
    measured = []
    for k in rng.choice(len(points), 400, replace=False):
        near = tree.query_ball_point(points[k], 0.003)
        height = (points[near] - points[k]) @ normals[k]
        height -= height.mean()
        m2, m4 = (height**2).mean(), (height**4).mean()
        a = np.interp(m4 / m2**2, peak / spread**2, spread)
        measured.append(2 * np.sqrt(m2 / a))
    t = flower.truth[name].thickness_m
    assert t is not None
    assert np.median(measured) == pytest.approx(t, rel=0.08)
    assert np.percentile(measured, 80) < 1.25 * t
    own = np.sort(g.scales[chosen], axis=1)[:, 0] * mpu
    assert own.max() <= t / 7.9


def test_leaves_stand_clear_of_each_other_and_of_the_pot(flower):
    """Surfaces closer than 2 dx would weld in the simulation (dx = height / 64)."""
    two_dx = 2 * flower.height_m / 64
    leaves, pot = part_points_m(flower, "leaves"), part_points_m(flower, "pot")
    assert KDTree(pot).query(leaves)[0].min() > two_dx
    # Leaves are the connected pieces at a reach of 3 mm; there are eight, and no two come closer than 2 dx.
    pairs = KDTree(leaves).query_pairs(0.003, output_type="ndarray")
    label = np.arange(len(leaves))
    while True:
        merged = label.copy()
        np.minimum.at(merged, pairs[:, 0], label[pairs[:, 1]])
        np.minimum.at(merged, pairs[:, 1], label[pairs[:, 0]])
        merged = merged[merged]
        if np.array_equal(merged, label):
            break
        label = merged
    pieces = [leaves[label == piece] for piece in np.unique(label)]
    assert len(pieces) == 8
    for i, piece in enumerate(pieces):
        others = KDTree(np.concatenate(pieces[:i] + pieces[i + 1 :]))
        assert others.query(piece)[0].min() > two_dx


def test_parts_touch_where_they_grow(flower):
    reach = 0.0035
    for low, high in (("soil", "stem"), ("stem", "leaves"), ("stem", "heart"), ("heart", "petals")):
        assert KDTree(part_points_m(flower, low)).query(part_points_m(flower, high))[0].min() < reach, (low, high)


def test_surfaces_are_closed_in_all_object_views(flower):
    g = flower.gaussians
    lower, upper = g.robust_bounds(rotation=rotation_to_z_up(flower.up))
    rotation = rotation_to_z_up(flower.up)
    rasteriser = Rasteriser()
    for camera in view_cameras("object", lower=lower, upper=upper, rotation=rotation, size_px=256):
        picture = rasteriser.render(g.means, g.covariances(), g.opacities, camera=camera, sh=g.sh)
        pixels, _ = camera.project(g.means)
        hit = np.zeros((camera.height, camera.width), bool)
        column, row = np.clip(pixels.astype(int), 0, 255).T
        hit[row, column] = True
        core = ndimage.binary_erosion(hit, np.ones((3, 3)))
        assert core.sum() > 2500
        assert picture.alpha[core].min() > 0.98


def test_no_needles_and_colours_in_range(flower):
    g = flower.gaussians
    middle, longest = np.sort(g.scales, axis=1)[:, 1:].T
    assert (longest / middle).max() < 6
    assert longest.max() * flower.metres_per_unit < 0.003
    colour = 0.5 + 0.28209479 * g.sh[:, 0]
    assert colour.min() >= 0 and colour.max() <= 1
    assert np.abs(g.sh[:, 1:]).max() * 0.4886 < 0.11


def test_default_scene_is_a_scene(flower, tmp_path):
    scene = Scene(input=tmp_path / "flower.ply", **flower.default_scene)
    assert set(scene.parts) == set(flower.part_names)
    assert [name for name, part in scene.parts.items() if part.hold == "fixed"] == ["pot", "soil"]
    chosen = {name: material(str(part.material)).name for name, part in scene.parts.items()}
    assert (chosen["leaves"], chosen["petals"], chosen["stem"]) == ("leaf_blade", "petal", "herbaceous_stem")
