"""Several objects put together: poses, colours, names, particles, overlap and the grid that they share."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from balls import RADIUS_M, ball
from phys4dgen.errors import SceneError
from phys4dgen.interior import Interior
from phys4dgen.interior.bridge import BridgeReport
from phys4dgen.progress import SILENT
from phys4dgen.scene import PlacedObject, Scene
from phys4dgen.stages.asset import Asset, load
from phys4dgen.stages.overlap import overlap_m
from phys4dgen.stages.reconstruct import Source
from phys4dgen.stages.several import (
    ReadyObject,
    join_interiors,
    join_parts,
    pose_of,
    put_together,
    shared_cell_m,
)
from phys4dgen.types import Continuum, Frame, Gaussians, Parts, rotation_to_z_up

SH_1 = 0.48860251


class Told:
    """Keeps what it is told."""

    def __init__(self):
        self.warnings = []

    def stage(self, name): ...

    def update(self, done, total, text=""): ...

    def note(self, text): ...

    def warn(self, text):
        self.warnings.append(text)


def asset_of(gaussians, up, metres_per_unit):
    rotation = rotation_to_z_up(np.array(up))
    lower, upper = gaussians.robust_bounds(rotation=rotation)
    return Asset(gaussians, Frame(rotation, metres_per_unit), lower, upper, 0.25)


def placed(**told):
    return PlacedObject.model_validate({"input": "a.ply", **told})


def seen_from(gaussians, direction):
    """Colours of degree 1 seen along unit vectors [N, 3]: the formula of INRIA's 3DGS, written down here."""
    x, y, z = direction.T
    basis = [np.full(len(x), 0.28209479), -SH_1 * y, SH_1 * z, -SH_1 * x]
    return np.einsum("kn,nkc->nc", basis, gaussians.sh[:, :4].astype(np.float64))


def test_a_pose_turns_scales_and_moves_gaussians_with_their_colours():
    gaussians, _ = ball(sh_degree=1, up=1)
    asset = asset_of(gaussians, [0, 1, 0], 0.02)
    pose = pose_of(placed(position_m=[1, 2, 3], rotation_deg=[20, -35, 70]), asset)
    moved = pose.gaussians(gaussians)
    turn = Rotation.from_euler("xyz", [20, -35, 70], degrees=True).as_matrix() @ asset.frame.rotation
    expected = 0.02 * gaussians.means.astype(np.float64) @ turn.T
    away = moved.means - expected
    np.testing.assert_allclose(away, np.tile(away.mean(0), (len(away), 1)), atol=1e-5)
    low, high = moved.robust_bounds()
    np.testing.assert_allclose([(low + high)[0] / 2, (low + high)[1] / 2, low[2]], [1, 2, 3], atol=1e-5)
    covariances = 0.02**2 * turn @ gaussians.covariances() @ turn.T
    np.testing.assert_allclose(moved.covariances(), covariances, atol=1e-5 * covariances.max())
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(len(gaussians), 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    np.testing.assert_allclose(seen_from(moved, directions @ turn.T), seen_from(gaussians, directions), atol=1e-5)


def test_without_a_turn_up_becomes_z_and_nothing_else_turns():
    gaussians, labels = ball(up=1)
    pose = pose_of(placed(), asset_of(gaussians, [0, 1, 0], 0.02))
    moved = pose.gaussians(gaussians)
    assert moved.means[labels == 1, 2].min() > moved.means[labels == 0, 2].max()
    np.testing.assert_allclose(pose.rotation @ [1, 0, 0], [1, 0, 0], atol=1e-12)


def ready(name, *, up=2, sh_degree=0, seed=0, spacing_m=0.01):
    """A ball that was understood, with particles on a lattice."""
    gaussians, labels = ball(up=up, sh_degree=sh_degree, seed=seed)
    asset = asset_of(gaussians, np.eye(3)[up], 0.02)
    axis = np.arange(-2.5, 2.5, spacing_m / 0.02)
    lattice = np.stack(np.meshgrid(axis, axis, axis), -1).reshape(-1, 3)
    lattice = lattice[np.linalg.norm(lattice, axis=1) < 2.4] + [7, -3, 11]
    p = len(lattice)
    continuum = Continuum(
        positions=lattice,
        part=(lattice[:, up] > [7, -3, 11][up]).astype(np.int32),
        is_interior=np.zeros(p, bool),
        volume_m3=np.full(p, spacing_m**3),
        gaussian_index=np.arange(p, dtype=np.int32) % 5 - 1,
        piece=np.zeros(p, np.int32),
        shape=np.zeros(p, np.int8),
        thickness_m=np.full(p, np.nan),
        thickness_measured=np.zeros(p, bool),
        offset_m=np.tile([0, 0, 0.001], (p, 1)),
        site=np.arange(p) // 2,
        spacing_m=spacing_m,
    )
    interior = Interior(
        continuum, BridgeReport(1, 1, 1.0, 0), solid_voxels=p, agreement=1.0, density_threshold=1.0,
        loose_particles=0, backend="test",
    )  # fmt: skip
    return ReadyObject(name, asset, "test", Parts(labels, ("lower", "upper"), "file"), interior)


def scene_of(**objects):
    return Scene.model_validate({"objects": {name: {"input": f"{name}.ply", **told} for name, told in objects.items()}})


def test_gaussians_parts_and_particles_follow_each_other_in_the_order_of_the_scene():
    scene = scene_of(left={"position_m": [-1, 0, 0]}, right={"position_m": [1, 0, 0.5], "rotation_deg": [90, 0, 0]})
    objects = [ready("left"), ready("right", up=1, sh_degree=1, seed=1)]
    source = put_together(scene, objects, 0.02)
    asset = load(scene, source, SILENT)
    assert (len(asset.gaussians), asset.gaussians.sh_degree, asset.cell_m) == (1200, 1, 0.02)
    assert not asset.gaussians.sh[:600, 1:].any()
    parts = join_parts(objects)
    assert parts.names == ("left/lower", "left/upper", "right/lower", "right/upper")
    centre_m = [asset.gaussians.means[parts.labels // 2 == k].mean(0) for k in range(2)]
    np.testing.assert_allclose(centre_m, [[-1, 0, RADIUS_M], [1, 0, RADIUS_M + 0.5]], atol=0.003)
    interior = join_interiors(scene, objects, asset, SILENT)
    points = interior.continuum
    first = points.part < 2
    np.testing.assert_allclose(points.positions[first].mean(0), [-1, 0, RADIUS_M], atol=0.003)
    np.testing.assert_allclose(points.positions[~first].mean(0), [1, 0, RADIUS_M + 0.5], atol=0.003)
    # a quarter turn about x takes the offset along z to -y, in the second object alone
    np.testing.assert_allclose(points.offset_m[first], np.tile([0, 0, 0.001], (first.sum(), 1)), atol=1e-9)
    np.testing.assert_allclose(points.offset_m[~first], np.tile([0, -0.001, 0], ((~first).sum(), 1)), atol=1e-9)
    assert points.gaussian_index[first].min() == -1
    assert points.gaussian_index[first].max() == 3
    assert set(points.gaussian_index[~first].tolist()) == {-1, 600, 601, 602, 603}
    sites_of_both = sum(len(np.unique(own.interior.continuum.site)) for own in objects)
    assert len(np.unique(points.site)) == sites_of_both < len(points)
    alone = objects[1].interior.continuum.volume_m3.sum()
    assert points.volume_m3[~first].sum() == pytest.approx(alone)


@pytest.mark.parametrize(("apart_m", "up_m"), [(0.06, 0.0), (0.02, 0.0), (0.0, 0.05), (0.0, 0.0)])
def test_objects_that_overlap_are_refused_with_a_place_that_is_free(apart_m, up_m):
    scene = scene_of(left={}, right={"position_m": [apart_m, 0, up_m]})
    objects = [ready("left"), ready("right", seed=1)]
    asset = load(scene, put_together(scene, objects, 0.02), SILENT)
    with pytest.raises(SceneError, match=r"'left' and 'right' overlap by [\d.]+ mm at the start") as caught:
        join_interiors(scene, objects, asset, SILENT)
    place = [float(word) for word in str(caught.value).split("position_m: [")[1].split("]")[0].split(",")]
    moved = np.array(place) - [apart_m, 0, up_m]
    assert np.count_nonzero(np.abs(moved) > 1e-6) == 1
    # never farther than from centre to centre
    assert np.linalg.norm(moved) < 2 * RADIUS_M + 0.01
    free = scene_of(left={}, right={"position_m": place})
    told = Told()
    join_interiors(free, objects, load(free, put_together(free, objects, 0.02), SILENT), told)
    assert told.warnings == []


def test_a_small_overlap_is_a_warning():
    scene = scene_of(left={}, right={"position_m": [0.085, 0, 0]})
    objects, told = [ready("left"), ready("right", seed=1)], Told()
    join_interiors(scene, objects, load(scene, put_together(scene, objects, 0.02), SILENT), told)
    assert len(told.warnings) == 1
    assert "left and right overlap by" in told.warnings[0]


def test_the_overlap_is_the_shortest_way_out():
    rng = np.random.default_rng(0)
    block = np.stack(np.meshgrid(*[np.arange(0.005, 0.1, 0.01)] * 3), -1).reshape(-1, 3)
    shift = overlap_m(block, block + np.array([0.013, 0.07, 0.02]) + rng.normal(0, 1e-4, block.shape), spacing_m=0.01)
    np.testing.assert_allclose(shift, [0, 0.03, 0], atol=0.006)
    np.testing.assert_array_equal(overlap_m(block, block + np.array([0.1, 0, 0]), spacing_m=0.01), 0)


def test_the_shared_cell_suits_the_smallest_within_the_budget():
    sizes = {"small": 0.005, "large": 0.02}
    assets = {name: asset_of(ball()[0], [0, 0, 1], unit) for name, unit in sizes.items()}
    longest = {name: float((a.upper - a.lower).max()) * a.frame.metres_per_unit for name, a in assets.items()}
    told = Told()
    assert shared_cell_m(scene_of(small={}, large={}), assets, told) > longest["small"] / 64
    told_grid = scene_of(small={}, large={}).with_overrides({"simulation.grid": 20})
    assert shared_cell_m(told_grid, assets, told) == pytest.approx(longest["large"] / 20)
    assert "small is 5.0 grid cells" in told.warnings[-1]
    told_cell = scene_of(small={}, large={}).with_overrides({"simulation.cell_m": 0.001})
    assert shared_cell_m(told_cell, assets, SILENT) == 0.001


def test_one_object_understood_with_the_shared_cell_has_it():
    gaussians, _ = ball()
    scene = Scene.model_validate({"input": "a.ply", "up": "z", "height_m": 0.1, "simulation": {"cell_m": 0.004}})
    assert load(scene, Source(gaussians, "test"), SILENT).cell_m == pytest.approx(0.004)
    with pytest.raises(SceneError, match=r"simulation.cell_m: 0.0001 m would cut the object into \d+ cells"):
        load(scene.with_overrides({"simulation.cell_m": 0.0001}), Source(gaussians, "test"), SILENT)


def test_colours_of_different_degree_are_filled_up():
    gaussians = put_together(scene_of(a={}, b={"position_m": [1, 0, 0]}), [ready("a", sh_degree=1), ready("b")], 0.02)
    assert isinstance(gaussians.gaussians, Gaussians)
    assert gaussians.gaussians.sh.shape == (1200, 4, 3)
