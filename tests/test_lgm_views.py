"""Cameras and rays of LGM: the same geometry as our renderer's; pictures: what reaches the network."""

import math

import numpy as np
import pytest
from PIL import Image

from phys4dgen.errors import FormatError
from phys4dgen.reconstruct.lgm.activations import gaussians_from_raw
from phys4dgen.reconstruct.lgm.four_views import FourViews, read_views
from phys4dgen.reconstruct.lgm.generator import network_input
from phys4dgen.reconstruct.lgm.rays import CAMERA_RADIUS, FOVY_DEG, pluecker_coordinates, view_cameras
from phys4dgen.render.views import render_views
from phys4dgen.types import SH_C0, Gaussians


def test_the_four_cameras_stand_where_lgm_has_them():
    assert (CAMERA_RADIUS, FOVY_DEG) == (1.5, 49.1)
    cameras = view_cameras(256)
    places = np.array([camera.position for camera in cameras])
    np.testing.assert_allclose(places, 1.5 * np.array([[0, 0, 1], [1, 0, 0], [0, 0, -1], [-1, 0, 0]]), atol=1e-12)
    for camera in cameras:
        pixel, depth = camera.project(np.array([[0.0, 0, 0], [0, 1.5 * math.tan(math.radians(49.1 / 2)), 0]]))
        np.testing.assert_allclose(pixel, [[128, 128], [128, 0]], atol=1e-9)
        np.testing.assert_allclose(depth, 1.5)
    # Seen from the viewer's right (+x), the object's front (+z) looks to the left.
    assert cameras[1].project(np.array([[0.0, 0, 0.5]]))[0][0, 0] < 128


def test_rays_against_the_published_formula_in_opengl_axes():
    size, azimuth = 16, math.radians(90)
    pose = np.array([[math.cos(azimuth), 0, math.sin(azimuth)], [0, 1, 0], [-math.sin(azimuth), 0, math.cos(azimuth)]])
    origin = pose @ [0, 0, 1.5]
    focal = 0.5 * size / math.tan(math.radians(49.1) / 2)
    got = pluecker_coordinates(view_cameras(size)[1])
    assert got.shape == (6, size, size)
    for row, column in ((0, 0), (3, 11), (15, 7)):
        ray = pose @ [(column + 0.5 - size / 2) / focal, -(row + 0.5 - size / 2) / focal, -1]
        ray /= np.linalg.norm(ray)
        np.testing.assert_allclose(got[3:, row, column], ray, atol=1e-6)
        np.testing.assert_allclose(got[:3, row, column], np.cross(origin, ray), atol=1e-6)


def test_rendered_gaussians_are_found_again_along_the_rays():
    """Render small opaque balls by our renderer, unproject their middles by LGM's rays: they are where they were."""
    rng = np.random.default_rng(4)
    means = rng.uniform(-0.45, 0.45, (6, 3))
    count = len(means)
    size = 512
    cameras = view_cameras(size)
    for index in range(count):
        one = Gaussians(
            means=means[index : index + 1],
            quats_wxyz=np.array([[1.0, 0, 0, 0]]),
            scales=np.full((1, 3), 0.01),
            opacities=np.ones(1),
            sh=np.zeros((1, 1, 3)),
        )
        views = render_views(one, cameras)
        moments, directions = [], []
        for camera, alpha in zip(cameras, views.alpha, strict=True):
            weight = alpha.astype(np.float64) ** 2
            ray = (pluecker_coordinates(camera) * weight).sum((1, 2)) / weight.sum()
            directions.append(ray[3:] / np.linalg.norm(ray[3:]))
            moments.append(np.cross(camera.position, directions[-1]))
        # The point p whose rays these are: p x d = m for every view, least squares.
        rows = np.concatenate([-_cross_matrix(direction) for direction in directions])
        found = np.linalg.lstsq(rows, np.concatenate(moments), rcond=None)[0]
        np.testing.assert_allclose(found, means[index], atol=1e-3)
        for camera, alpha, depth in zip(cameras, views.alpha, views.depth, strict=True):
            row, column = np.unravel_index(np.argmax(alpha), alpha.shape)
            direction = pluecker_coordinates(camera)[3:, row, column].astype(np.float64)
            along = depth[row, column] / (camera.viewmat[2, :3] @ direction)
            np.testing.assert_allclose(camera.position + along * direction, means[index], atol=5e-3)


def _cross_matrix(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def test_activations_and_what_is_dropped():
    raw = np.zeros((4, 14))
    raw[0, :3] = (-3, 0.25, 2)
    raw[0, 3:] = [2, 1, -1, 0, 3, 0, 0, 4, 1, -1, 0]
    raw[1, 3] = -5.2  # opacity 0.0055
    raw[2, 3] = -5.4  # 0.0045
    raw[3, 3] = 9
    made = gaussians_from_raw(raw)
    assert len(made) == 3
    np.testing.assert_allclose(made.means[0], [-1, 0.25, 1])
    np.testing.assert_allclose(made.opacities, 1 / (1 + np.exp(-raw[[0, 1, 3], 3])), rtol=1e-6)
    np.testing.assert_allclose(made.scales[0], 0.1 * np.log1p(np.exp([1, -1, 0])), rtol=1e-6)
    np.testing.assert_allclose(made.quats_wxyz[0], [0.6, 0, 0, 0.8], atol=1e-7)
    np.testing.assert_allclose(made.quats_wxyz[1], [1, 0, 0, 0])
    rgb = 0.5 * np.tanh([1, -1, 0]) + 0.5
    np.testing.assert_allclose(0.5 + SH_C0 * made.sh[0, 0], rgb, atol=1e-6)
    assert made.sh.shape == (3, 1, 3)


def save(path, rgba):
    Image.fromarray(np.rint(255 * rgba).astype(np.uint8)).save(path)


def disc(size, color, *, background=None):
    y, x = np.mgrid[:size, :size] - size / 2 + 0.5
    inside = (np.hypot(x, y) < size / 3).astype(float)[..., None]
    if background is None:
        return np.concatenate([inside * color + (1 - inside) * [0, 1, 0], inside], -1)
    return inside * color + (1 - inside) * background


def test_transparent_and_white_views_are_the_same_to_the_network(tmp_path):
    paths = []
    for view in range(4):
        color = np.eye(3)[view % 3] * 0.8
        paths += [tmp_path / f"clear{view}.png", tmp_path / f"white{view}.png"]
        save(paths[-2], disc(60, color))
        save(paths[-1], disc(60, color, background=np.ones(3)))
    clear, white = read_views(paths[::2], size_px=32), read_views(paths[1::2], size_px=32)
    assert clear.warnings == white.warnings == ()
    np.testing.assert_allclose(clear.on_white(), white.on_white(), atol=0.01)
    assert clear.alpha.min() == 0
    assert white.alpha.min() == 1
    given = network_input(clear, 32)
    assert given.shape == (4, 9, 32, 32)
    np.testing.assert_allclose(
        given[1, :3, 16, 16], (np.array([0, 0.8, 0]) - [0.485, 0.456, 0.406]) / [0.229, 0.224, 0.225], atol=0.01
    )
    np.testing.assert_allclose(
        given[:, :3, 0, 0], np.tile((1 - np.array([0.485, 0.456, 0.406])) / [0.229, 0.224, 0.225], (4, 1)), atol=1e-5
    )
    np.testing.assert_allclose(given[2, 3:], pluecker_coordinates(view_cameras(32)[2]))


def test_a_dark_background_is_named_and_a_long_view_refused(tmp_path):
    paths = [tmp_path / f"{view}.png" for view in range(4)]
    for view, path in enumerate(paths):
        save(path, disc(48, np.ones(3), background=np.full(3, 0.2 if view == 2 else 1.0)))
    assert "background of 2.png" in read_views(paths, size_px=32).warnings[0]
    Image.new("RGB", (48, 64), "white").save(paths[3])
    with pytest.raises(FormatError, match="square view, got 48 x 64"):
        read_views(paths, size_px=32)


def test_views_of_another_shape_are_refused():
    with pytest.raises(ValueError, match="rgb: expected shape"):
        FourViews(np.zeros((3, 8, 8, 3), np.float32), np.zeros((3, 8, 8), np.float32), "test")
    views = FourViews(np.zeros((4, 8, 8, 3), np.float32), np.ones((4, 8, 8), np.float32), "test")
    with pytest.raises(ValueError, match="expected 16 pixels, got 8"):
        network_input(views, 16)
