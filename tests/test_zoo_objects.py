"""Every bundled object: its truth against independent measurements, its looks against numbers, its variants."""

from __future__ import annotations

import time
from functools import cache

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial import KDTree

from phys4dgen.errors import SceneError
from phys4dgen.materials.library import find_entry, material
from phys4dgen.render.cameras import view_cameras
from phys4dgen.render.rasterise import Rasteriser
from phys4dgen.scene import Scene
from phys4dgen.types import Parts, rotation_from_quats, rotation_to_z_up
from phys4dgen.types.color import srgb_to_lab
from phys4dgen.zoo import BUNDLED, ZooObject, bundled

NAMES = [name for name in BUNDLED if name != "potted_flower"]  # which has a test file of its own
HEIGHTS_M = {
    "snowman": 0.91,
    "hammer": 0.31,
    "carnation": 0.35,
    "hamburger": 0.092,
    "basketball": 0.236,
    "rubber_duck": 0.088,
    "sandcastle": 0.301,
    "telephone": 0.138,
    "straw_hat": 0.119,
    "balloon": 0.737,
    "jelly_honey_water": 0.06,
    "cup": 0.088,
}
SHEETS = {"carnation": ("leaves", "petals"), "hamburger": ("lettuce",), "sandcastle": ("flag",)}
"""Parts with samples between two faces as well, by object."""
CLOSE_PAIRS = {"carnation": ("stem", "leaves"), "sandcastle": ("base", "castle"), "telephone": ("body", "handset")}
"""Neighbouring parts that colour alone can hardly tell apart, by object."""


@cache
def unlit(name: str) -> ZooObject:
    return bundled(name, light="unlit")


@pytest.fixture(params=NAMES)
def zoo(request) -> tuple[str, ZooObject]:
    return request.param, unlit(request.param)


def points_m(zoo: ZooObject, name: str) -> np.ndarray:
    chosen = zoo.labels == zoo.part_names.index(name)
    return zoo.gaussians.means[chosen].astype(np.float64) * zoo.metres_per_unit


def test_parts_are_complete_and_start_at_the_ground(zoo):
    name, it = zoo
    Parts(labels=it.labels, names=it.part_names, backend="zoo")
    assert 20_000 <= len(it.gaussians) <= 65_000
    assert np.bincount(it.labels).min() >= 300
    assert points_m(it, it.part_names[0])[:, 1].min() < 0.03 * it.height_m
    assert list(it.truth) == list(it.part_names)
    lower, upper = it.gaussians.robust_bounds(rotation=rotation_to_z_up(it.up))
    assert it.height_m / (upper[2] - lower[2]) == pytest.approx(it.metres_per_unit, rel=1e-6)
    assert it.height_m == pytest.approx(HEIGHTS_M[name], rel=0.02)
    assert it.gaussians.means[:, 1].min() * it.metres_per_unit == pytest.approx(0.0, abs=0.012 * it.height_m)


def test_gaussians_lie_on_the_surface_of_their_part(zoo):
    """A short step inwards ends in the part, a step outwards leaves it."""
    name, it = zoo
    g = it.gaussians
    normals = rotation_from_quats(g.quats_wxyz)[:, :, 2]
    for number, part in enumerate(it.part_names):
        chosen = np.flatnonzero(it.labels == number)[::5]
        means = g.means[chosen].astype(np.float64)
        spacing = np.median(KDTree(means).query(means, 2)[0][:, 1])
        thickness = (it.truth[part].thickness_m or np.inf) / it.metres_per_unit
        step = min(0.2 * spacing, 0.4 * thickness) * normals[chosen]
        assert (it.inside(means - step) == number).mean() > 0.95, part
        if part not in SHEETS.get(name, ()):
            assert (it.inside(means + step) == number).mean() < 0.05, part


def test_volumes_agree_with_the_inside_test(zoo):
    """Stratified Monte Carlo in the box of each part, which a coarse lattice finds first (roots are buried)."""
    _, it = zoo
    rng = np.random.default_rng(0)
    everything = it.gaussians.means.astype(np.float64) * it.metres_per_unit
    lattice, coarse = strata(everything.min(0), everything.max(0), 40, rng)
    owner = it.inside(lattice / it.metres_per_unit)
    for number, part in enumerate(it.part_names):
        points = np.concatenate([points_m(it, part), lattice[owner == number]])
        samples, cell = strata(points.min(0) - coarse, points.max(0) + coarse, 40, rng)
        hits = np.count_nonzero(it.inside(samples / it.metres_per_unit) == number)
        volume = hits * cell.prod()
        assert it.truth[part].volume_m3 == pytest.approx(volume, rel=0.015 + 1.5 / np.sqrt(hits)), part


def strata(lower, upper, side: int, rng) -> tuple[np.ndarray, np.ndarray]:
    """One random point per cell of a lattice of about ``side``^3 nearly cubic cells, and the size of a cell."""
    edge = np.prod(upper - lower) ** (1 / 3) / side
    cells = np.ceil((upper - lower) / edge).astype(int)
    size = (upper - lower) / cells
    index = np.argwhere(np.ones(cells))
    return lower + (index + rng.uniform(size=index.shape)) * size, size


def test_every_part_has_texture(zoo):
    """Luminance of the plain albedo, 5 % to 95 % quantile over its mean."""
    _, it = zoo
    color = it.gaussians.base_colors.astype(np.float64)
    linear = np.where(color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4)
    luminance = linear @ [0.2126, 0.7152, 0.0722]
    for number, part in enumerate(it.part_names):
        low, high = np.percentile(luminance[it.labels == number], [5, 95])
        assert (high - low) / luminance[it.labels == number].mean() >= 0.15, part


def test_no_needles_and_colours_in_range(zoo):
    _, it = zoo
    middle, longest = np.sort(it.gaussians.scales, axis=1)[:, 1:].T
    assert (longest / middle).max() < 6
    assert longest.max() * it.metres_per_unit < 0.02 * it.height_m
    color = 0.5 + 0.28209479 * it.gaussians.sh[:, 0]
    assert color.min() > -1e-6 and color.max() < 1 + 1e-6


def test_surfaces_are_closed_in_the_object_views(zoo):
    _, it = zoo
    g, rotation = it.gaussians, rotation_to_z_up(it.up)
    lower, upper = g.robust_bounds(rotation=rotation)
    rasteriser = Rasteriser()
    cameras = view_cameras("object", lower=lower, upper=upper, rotation=rotation, size_px=192)
    for camera in cameras[::5]:
        picture = rasteriser.render(g.means, g.covariances(), g.opacities, camera=camera, sh=g.sh)
        pixels, _ = camera.project(g.means)
        hit = np.zeros((camera.height, camera.width), bool)
        column, row = np.clip(pixels.astype(int), 0, 191).T
        hit[row, column] = True
        core = ndimage.binary_erosion(hit, np.ones((3, 3)))
        assert core.sum() > 1000
        assert np.percentile(picture.alpha[core], 0.5) > 0.95


def test_default_scene_is_a_scene(zoo, tmp_path):
    _, it = zoo
    scene = Scene(input=tmp_path / "object.ply", **it.default_scene).with_overrides({"motion.preset": it.motion})
    assert set(scene.parts) == set(it.part_names)
    assert scene.height_m == it.height_m
    for name, part in it.truth.items():
        assert material(part.material).name == part.material
        assert scene.parts[name].material == part.material
        filling = scene.parts[name].interior_material
        assert filling is None or find_entry(filling) is not None
    held = [name for name, part in scene.parts.items() if part.hold == "fixed"]
    assert bool(held) == (it.motion == "sway")


@pytest.mark.parametrize("name", CLOSE_PAIRS)
def test_some_neighbours_are_close_in_colour(name):
    it = unlit(name)
    lab = srgb_to_lab(it.gaussians.base_colors)
    first, second = (it.part_names.index(part) for part in CLOSE_PAIRS[name])
    apart = [np.median(lab[it.labels == number], axis=0) for number in (first, second)]
    assert np.linalg.norm(apart[0] - apart[1]) < 10
    assert KDTree(points_m(it, it.part_names[first])).query(points_m(it, it.part_names[second]))[0].min() < 0.01


@pytest.mark.parametrize("name", ["snowman", "carnation", "sandcastle"])  # ordinary, all sheets, and the slowest
def test_same_seed_gives_the_same_arrays_quickly(name):
    it = unlit(name)
    start = time.process_time()
    again = bundled(name, light="unlit")
    assert time.process_time() - start < 3.0  # seconds of one core; about half of it where nothing else runs
    for field in ("means", "quats_wxyz", "scales", "opacities", "sh"):
        np.testing.assert_array_equal(getattr(again.gaussians, field), getattr(it.gaussians, field))
    np.testing.assert_array_equal(again.labels, it.labels)


def test_light_changes_colours_only():
    plain, studio, evening = (bundled("snowman", light=light) for light in ("unlit", "studio", "evening"))
    for other in (studio, evening):
        np.testing.assert_array_equal(other.gaussians.means, plain.gaussians.means)
        np.testing.assert_array_equal(other.labels, plain.labels)
    snow = plain.labels == plain.part_names.index("body")
    lit, low = studio.gaussians.base_colors[snow].mean(1), evening.gaussians.base_colors[snow].mean(1)
    assert np.corrcoef(lit, low)[0, 1] < 0.8
    assert lit.std() > 1.5 * plain.gaussians.base_colors[snow].mean(1).std()


@pytest.mark.parametrize(("name", "light"), [("snowmann", "studio"), ("snowman", "stdio")])
def test_unknown_names_are_told_with_a_suggestion(name, light):
    with pytest.raises(SceneError, match=r"Did you mean '(snowman|studio)'"):
        bundled(name, light=light)
