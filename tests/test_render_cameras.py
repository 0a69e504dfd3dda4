"""Cameras: geometry, the view table, framing and the path of a video."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phys4dgen.errors import SceneError
from phys4dgen.render.cameras import intrinsics, look_at, orbit_camera, video_path, view_cameras
from phys4dgen.render.rasterise import rasterise
from phys4dgen.render.view_table import view_directions
from phys4dgen.types import Camera, rotation_to_z_up

UPS = [[0, 0, 1], [0, 0, -1], [0, 1, 0], [0, -1, 0], [1, 0, 0], [-1, 0, 0], [0.3, -0.9, 0.2]]
LOWER, UPPER = np.array([-0.2, 0.4, -1.0]), np.array([0.3, 0.7, 0.5])
CORNERS = np.array([[x, y, z] for x in (-0.2, 0.3) for y in (0.4, 0.7) for z in (-1.0, 0.5)])


def vectors(low=-5.0):
    return st.tuples(*[st.floats(low, -low)] * 3).map(np.array)


def is_rigid(viewmat):
    rotation = viewmat[:3, :3]
    return np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-9) and np.linalg.det(rotation) > 0


@settings(max_examples=200)
@given(eye=vectors(), target=vectors(), up=vectors())
def test_look_at_puts_target_on_axis_and_up_up(eye, target, up):
    distance = np.linalg.norm(target - eye)
    if distance < 1e-3 or np.linalg.norm(up) < 1e-3:
        return
    viewmat = look_at(eye, target, up)
    assert is_rigid(viewmat)
    np.testing.assert_allclose(viewmat @ [*eye, 1], [0, 0, 0, 1], atol=1e-9)
    np.testing.assert_allclose(viewmat @ [*target, 1], [0, 0, distance, 1], atol=1e-9)
    assert viewmat[1, :3] @ up <= 1e-6  # y points down
    assert abs(viewmat[0, :3] @ up) < 1e-6 * np.linalg.norm(up) or np.linalg.norm(np.cross(target - eye, up)) < 1e-6


def test_look_at_along_up_is_still_a_camera():
    viewmat = look_at([0, 0, 2], [0, 0, 0], [0, 0, 1])
    assert is_rigid(viewmat)
    with pytest.raises(ValueError, match="expected two different points"):
        look_at([1, 2, 3], [1, 2, 3], [0, 0, 1])


def test_intrinsics_map_the_field_of_view_to_the_border():
    K = intrinsics(50, 300, 200)
    camera = Camera(np.eye(4), K, 300, 200)
    top = [[0, -np.tan(np.radians(25)), 1.0]]
    np.testing.assert_allclose(camera.project(np.array(top))[0], [[150, 0]], atol=1e-9)
    with pytest.raises(ValueError, match="fovy_deg: expected an angle between 0 and 180"):
        intrinsics(180, 300, 200)


@settings(max_examples=50)
@given(azimuth_deg=st.floats(-400, 400), elevation_deg=st.floats(-90, 90), up=st.sampled_from(UPS), point=vectors(-1))
def test_projection_and_unprojection_agree(azimuth_deg, elevation_deg, up, point):
    camera = orbit_camera(
        azimuth_deg=azimuth_deg, elevation_deg=elevation_deg, target=[0.1, 0.2, 0.3], rotation=rotation_to_z_up(up),
        radius=4, fovy_deg=49.1, width=200, height=100,
    )  # fmt: skip
    assert is_rigid(camera.viewmat)
    (pixel,), (depth,) = camera.project(point[None])
    ray = np.linalg.inv(camera.K) @ [*pixel, 1]
    back = camera.viewmat[:3, :3].T @ (ray * depth - camera.viewmat[:3, 3])
    np.testing.assert_allclose(back, point, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(camera.position - [0.1, 0.2, 0.3]), 4)
    np.testing.assert_allclose(camera.project(np.array([[0.1, 0.2, 0.3]]))[0], [[100, 50]], atol=1e-9)


@pytest.mark.parametrize("up", UPS)
def test_azimuth_and_elevation_mean_what_the_table_says(up):
    rotation = rotation_to_z_up(up)
    expected = {(0, 0): [0, -1, 0], (90, 0): [1, 0, 0], (180, 0): [0, 1, 0], (30, 90): [0, 0, 1], (0, -90): [0, 0, -1]}
    for (azimuth_deg, elevation_deg), direction in expected.items():
        camera = orbit_camera(
            azimuth_deg=azimuth_deg, elevation_deg=elevation_deg, target=np.zeros(3), rotation=rotation, radius=2,
            fovy_deg=40, width=10, height=10,
        )  # fmt: skip
        np.testing.assert_allclose(rotation @ camera.position, 2 * np.array(direction), atol=1e-9)
        same = look_at(camera.position, np.zeros(3), rotation.T @ [0, 0, 1])
        if abs(elevation_deg) < 90:
            np.testing.assert_allclose(camera.viewmat, same, atol=1e-9)


@pytest.mark.parametrize("up", UPS)
def test_picture_is_neither_mirrored_nor_upside_down(up):
    """From the front, +x of the z-up frame is on the right and +z is high; seen from above, +y is high."""
    rotation = rotation_to_z_up(up)
    marks = np.array([[0.5, 0, 0], [0, 0, 0.5], [0, 0.5, 0]])  # red right, green high, blue far
    means = marks @ rotation  # z up -> input
    for elevation_deg, right, high in ((0, 0, 1), (90, 0, 2)):
        camera = orbit_camera(
            azimuth_deg=0, elevation_deg=elevation_deg, target=np.zeros(3), rotation=rotation, radius=2, fovy_deg=49.1,
            width=64, height=64,
        )  # fmt: skip
        picture = rasterise(
            means, np.eye(3)[None].repeat(3, 0) * 1e-3, [0.9] * 3, colors=np.eye(3), camera=camera, background=(0, 0, 0)
        ).rgb
        rows, columns = np.mgrid[:64, :64]
        weight = picture.sum(axis=(0, 1))
        x, y = (picture * columns[..., None]).sum((0, 1)) / weight, (picture * rows[..., None]).sum((0, 1)) / weight
        assert x[right] > 40 and abs(y[right] - 31.5) < 1
        assert y[high] < 24 and abs(x[high] - 31.5) < 1


def test_view_table_has_the_documented_counts_and_rings():
    assert [len(view_directions(preset)) for preset in ("object", "carve", "scene")] == [29, 49, 120]
    for preset, rings in (
        ("object", {-20: 8, 10: 8, 40: 8, 70: 4, 90: 1}),
        ("carve", {-30: 12, -5: 12, 20: 12, 50: 12, 90: 1}),
    ):
        elevations, counts = np.unique(view_directions(preset)[:, 1], return_counts=True)
        assert dict(zip(elevations.tolist(), counts.tolist(), strict=True)) == rings
        assert len(np.unique(view_directions(preset), axis=0)) == len(view_directions(preset))
    with pytest.raises(SceneError, match=r"expected one of object, carve, scene, got 'objekt'\. Did you mean 'object'"):
        view_directions("objekt")


def test_scene_views_cover_the_cap_evenly_along_a_short_path():
    azimuth, elevation = np.radians(view_directions("scene")).T
    assert np.degrees(elevation.min()) > -30 and np.degrees(elevation.max()) > 80
    points = np.column_stack(
        [np.cos(elevation) * np.sin(azimuth), -np.cos(elevation) * np.cos(azimuth), np.sin(elevation)]
    )
    angles = np.degrees(np.arccos(np.clip(points @ points.T, -1, 1)))
    nearest = np.sort(angles, axis=1)[:, 1]
    assert nearest.min() > 0.6 * nearest.max()
    steps = np.degrees(np.arccos(np.clip((points * np.roll(points, -1, axis=0)).sum(1), -1, 1)))
    assert steps.mean() < 1.25 * nearest.mean() and steps.max() < 3 * nearest.mean()
    assert not view_directions("scene").flags.writeable


@pytest.mark.parametrize("preset", ["object", "carve", "scene"])
@pytest.mark.parametrize("up", [UPS[0], UPS[3], UPS[6]])
def test_every_view_frames_the_box(preset, up):
    rotation = rotation_to_z_up(up)
    cameras = view_cameras(preset, lower=LOWER, upper=UPPER, rotation=rotation, size_px=256)
    assert len(cameras) == len(view_directions(preset))
    for camera, (azimuth_deg, elevation_deg) in zip(cameras, view_directions(preset), strict=True):
        assert is_rigid(camera.viewmat)
        pixels, depth = camera.project(CORNERS @ rotation)
        assert (depth > 0).all()
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        assert (low >= 0).all() and (high <= 256).all()
        np.testing.assert_allclose((high - low).max(), 0.9 * 256, rtol=1e-6)
        forward = rotation @ camera.viewmat[2, :3]
        azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
        back = [np.cos(elevation) * np.sin(azimuth), -np.cos(elevation) * np.cos(azimuth), np.sin(elevation)]
        np.testing.assert_allclose(-forward, back, atol=1e-9)
        # The wider direction is centred; the other one has room on both sides.
        np.testing.assert_allclose((low + high)[np.argmax(high - low)], 256, atol=1e-6)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
@pytest.mark.parametrize("extent", [[0, 0, 0], [1, 0, 0], [1, 1, 0]])
def test_flat_and_pointlike_boxes_can_be_viewed(extent, scale):
    centre = np.array([3.0, -2.0, 1.0]) * scale
    half = 0.5 * np.array(extent) * scale
    for camera in view_cameras("object", lower=centre - half, upper=centre + half, rotation=np.eye(3), size_px=64):
        pixels, depth = camera.project(np.stack([centre, centre + half, centre - half]))
        assert (depth > 0).all() and (pixels >= 0).all() and (pixels <= 64).all()
    with pytest.raises(ValueError, match="lower <= upper"):
        view_cameras("object", lower=[0, 0, 1], upper=[1, 1, 0], rotation=np.eye(3), size_px=64)


@pytest.mark.parametrize("size", [(320, 180), (180, 320)])
def test_video_path_orbits_smoothly_at_one_distance(size):
    width, height = size
    rotation = rotation_to_z_up([0, -1, 0])
    path = video_path(
        49, lower=LOWER, upper=UPPER, rotation=rotation, width=width, height=height, orbit_deg=60, elevation_deg=15,
        azimuth_deg=20,
    )  # fmt: skip
    assert len(path) == 49
    centre = 0.5 * (LOWER + UPPER)
    offsets = np.array([rotation @ camera.position - centre for camera in path])
    distances = np.linalg.norm(offsets, axis=1)
    np.testing.assert_allclose(distances, distances[0])
    azimuths_deg = np.degrees(np.arctan2(offsets[:, 0], -offsets[:, 1]))
    np.testing.assert_allclose(azimuths_deg[[0, 24, 48]], [-10, 20, 50], atol=1e-9)
    steps = np.diff(azimuths_deg)
    assert (steps > 0).all() and steps[0] < 0.05 * steps.max() and steps[-1] < 0.05 * steps.max()
    fills = []
    for camera in path:
        pixels, _ = camera.project(CORNERS @ rotation)
        assert (pixels >= 0).all() and (pixels <= [width, height]).all()
        fills.append(np.abs(pixels / [width, height] - 0.5).max() * 2)
    np.testing.assert_allclose(max(fills), 0.9)


def test_video_path_of_one_frame_shows_the_middle():
    path = video_path(1, lower=LOWER, upper=UPPER, rotation=np.eye(3), width=64, height=64, azimuth_deg=0)
    offset = path[0].position - 0.5 * (LOWER + UPPER)
    assert offset[1] < 0 and abs(offset[0]) < 1e-9
    with pytest.raises(ValueError, match="frame_count: expected at least 1, got 0"):
        video_path(0, lower=LOWER, upper=UPPER, rotation=np.eye(3), width=64, height=64)
