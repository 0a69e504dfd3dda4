"""Label maps to labels: the depth test, the vote, ties, the never seen, and perfect masks on bundled objects."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from numpy.typing import NDArray

from phys4dgen.errors import StageError
from phys4dgen.grouping.lift import Lifted, lift
from phys4dgen.render.cameras import intrinsics, view_cameras
from phys4dgen.render.views import render_labels, render_views
from phys4dgen.types import Camera, Gaussians, Masks, rotation_to_z_up
from phys4dgen.zoo import ZooObject, bundled, potted_flower

Lifting = tuple[Gaussians, NDArray[np.int32], Masks, tuple[Camera, ...], NDArray[np.float32]]


def gaussians_at(points: list[list[float]], *, sigma: float = 0.02) -> Gaussians:
    n = len(points)
    return Gaussians(
        means=np.array(points, np.float32),
        quats_wxyz=np.tile([1, 0, 0, 0], (n, 1)).astype(np.float32),
        scales=np.full((n, 3), sigma, np.float32),
        opacities=np.full(n, 0.9, np.float32),
        sh=np.zeros((n, 1, 3), np.float32),
    )


def front_camera(*, distance: float = 4.0, size_px: int = 8) -> Camera:
    """Looks along +z at the origin."""
    viewmat = np.eye(4)
    viewmat[2, 3] = distance
    return Camera(viewmat=viewmat, K=intrinsics(60, size_px, size_px), width=size_px, height=size_px)


def lift_reference(
    gaussians: Gaussians, masks: NDArray[np.int32], cameras: list[Camera], depth: NDArray[np.float32], threshold: float
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Votes and visibility one Gaussian and one view at a time."""
    n = len(gaussians)
    votes, visible = np.zeros((n, masks.max() + 1)), np.zeros(n, bool)
    for k in range(n):
        for camera, labels, surface in zip(cameras, masks, depth, strict=True):
            x, y, z = camera.viewmat[:3, :3] @ gaussians.means[k].astype(float) + camera.viewmat[:3, 3]
            if z <= 0:
                continue
            column = int(np.floor(camera.K[0, 0] * x / z + camera.K[0, 2]))
            row = int(np.floor(camera.K[1, 1] * y / z + camera.K[1, 2]))
            if not (0 <= column < camera.width and 0 <= row < camera.height) or surface[row, column] == 0:
                continue
            difference, sigma = abs(z - surface[row, column]), float(gaussians.scales[k].max())
            if difference < min(threshold, 3 * sigma):
                visible[k] = True
                if labels[row, column] >= 0:
                    votes[k, labels[row, column]] += np.exp(-difference / sigma)
    return votes, visible


def test_votes_match_the_reference(random_gaussians):
    gaussians = random_gaussians(300, seed=3)
    lower, upper = gaussians.robust_bounds()
    cameras = list(view_cameras("object", lower=lower, upper=upper, rotation=np.eye(3), size_px=48))[::5]
    depth = render_views(gaussians, cameras).depth
    masks = np.random.default_rng(0).integers(-1, 4, depth.shape).astype(np.int32)
    lifted = lift(gaussians, Masks(masks), cameras=cameras, depth=depth, occlusion_threshold_rel=0.02)
    votes, visible = lift_reference(gaussians, masks, cameras, depth, 0.02 * float((upper - lower).max()))
    np.testing.assert_array_equal(lifted.visible, visible)
    np.testing.assert_allclose(lifted.votes, votes, rtol=1e-5, atol=1e-6)
    voted = votes.any(1)
    assert 30 < voted.sum() < 300
    np.testing.assert_array_equal(lifted.labels[voted], lifted.votes[voted].argmax(1))


def test_what_is_hidden_does_not_vote_and_follows_its_nearest_neighbour():
    # in front of the camera: a at the left, b at the right, c behind a and nearer to b than to a
    gaussians = gaussians_at([[-0.5, 0, 0], [0.5, 0, 0], [-0.55, 0, 1.6], [0.5, 0, 1.5]])
    camera = front_camera()
    depth = np.full((1, 8, 8), 4.0, np.float32)
    masks = np.zeros((1, 8, 8), np.int32)
    masks[:, :, 4:] = 1
    lifted = lift(gaussians, Masks(masks), cameras=[camera], depth=depth)
    np.testing.assert_array_equal(lifted.visible, [True, True, False, False])
    np.testing.assert_array_equal(lifted.labels, [0, 1, 0, 1])
    assert not lifted.votes[2:].any()


def test_ties_go_to_the_lowest_label_and_minus_one_abstains():
    gaussians = gaussians_at([[0.0, 0, 0]])
    cameras = [front_camera()] * 3
    depth = np.full((3, 8, 8), 4.0, np.float32)
    masks = np.stack([np.full((8, 8), label, np.int32) for label in (2, 1, -1)])
    lifted = lift(gaussians, Masks(masks), cameras=cameras, depth=depth, occlusion_threshold_rel=1e9)
    np.testing.assert_array_equal(lifted.votes, [[0, 1, 1]])
    np.testing.assert_array_equal(lifted.labels, [1])


def test_maps_of_nothing_are_refused():
    gaussians = gaussians_at([[0.0, 0, 0], [0.3, 0.1, 0]])
    depth = np.full((1, 8, 8), 4.0, np.float32)
    with pytest.raises(StageError, match="no visible Gaussian falls on a labelled pixel"):
        lift(gaussians, Masks(np.full((1, 8, 8), -1, np.int32)), cameras=[front_camera()], depth=depth)
    with pytest.raises(StageError, match=r"label maps of shape \(1, 4, 8\) need one camera and one depth map each"):
        lift(gaussians, Masks(np.zeros((1, 4, 8), np.int32)), cameras=[front_camera()], depth=depth)


def with_perfect_masks(it: ZooObject) -> Lifting:
    """A bundled object and its perfect masks in the ``object`` views."""
    rotation = rotation_to_z_up(it.up)
    lower, upper = it.gaussians.robust_bounds(rotation=rotation)
    cameras = view_cameras("object", lower=lower, upper=upper, rotation=rotation, size_px=512)
    masks = np.stack([render_labels(it.gaussians, it.labels, camera) for camera in cameras])
    return it.gaussians, it.labels, Masks(masks), cameras, render_views(it.gaussians, cameras).depth


@pytest.fixture(scope="module")
def flower() -> Lifting:
    return with_perfect_masks(potted_flower())


@pytest.mark.parametrize("name", ["snowman", "hammer"])
def test_perfect_masks_give_the_parts_of_bundled_objects(name):
    gaussians, truth, masks, cameras, depth = with_perfect_masks(bundled(name))
    lifted = lift(gaussians, masks, cameras=cameras, depth=depth)
    right = lifted.labels == truth
    assert lifted.visible.mean() > 0.9
    assert right[lifted.visible].mean() >= 0.97
    assert right.mean() >= 0.95


def test_perfect_masks_give_the_parts_of_the_flower(flower):
    gaussians, truth, masks, cameras, depth = flower
    lifted = lift(gaussians, masks, cameras=cameras, depth=depth)
    right = lifted.labels == truth
    assert lifted.visible.mean() > 0.9
    assert right[lifted.visible].mean() >= 0.97
    assert right.mean() >= 0.95
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        alone = lift(gaussians, masks, cameras=cameras, depth=depth)
    finally:
        numba.set_num_threads(threads)
    for name, array in vars(lifted).items():
        np.testing.assert_array_equal(array, getattr(alone, name))


def test_one_pixel_in_ten_may_be_wrong(flower):
    gaussians, truth, masks, cameras, depth = flower
    rng = np.random.default_rng(1)
    wrong = rng.uniform(size=masks.labels.shape) < 0.1
    noisy = np.where(wrong & (masks.labels >= 0), rng.integers(0, 6, wrong.shape), masks.labels)
    lifted: Lifted = lift(gaussians, Masks(noisy.astype(np.int32)), cameras=cameras, depth=depth)
    assert (lifted.labels == truth).mean() >= 0.95
