"""The shadow that an object throws on the plane below it."""

import numpy as np
import pytest

from phys4dgen.render.ground import ShadowPlane
from phys4dgen.render.rasterise import rasterise
from phys4dgen.types import Camera

TURNS = [np.eye(3), np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])]


def ball(centre, *, turn, radius=0.2):
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(4000, 3))
    places = np.asarray(centre) + radius * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return places @ turn, np.tile(np.eye(3) * 0.015**2, (4000, 1, 1)), np.full(4000, 0.9)


def look_down(turn, *, azimuth=0.3, tilt=0.7):
    """A camera that looks obliquely down on the origin."""
    eye = 3.0 * np.array([np.cos(azimuth) * np.cos(tilt), np.sin(azimuth) * np.cos(tilt), np.sin(tilt)])
    forward = -eye / np.linalg.norm(eye)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(forward, right), forward])
    viewmat = np.eye(4)
    viewmat[:3, :3] = axes @ turn
    viewmat[:3, 3] = -axes @ eye
    K = np.array([[150.0, 0, 80], [0, 150, 60], [0, 0, 1]])
    return Camera(K=K, viewmat=viewmat, width=160, height=120)


def plane(turn):
    return ShadowPlane(lower=[-0.6, -0.6, 0], upper=[0.6, 0.6, 1], height=0.0, rotation=turn)


@pytest.mark.parametrize("turn", TURNS)
def test_the_shadow_lies_below_the_object(turn):
    """Where the camera sees the point of the plane under the ball, and nowhere far from it."""
    shape = ball([0.25, -0.3, 0.5], turn=turn)
    ground, camera = plane(turn), look_down(turn)
    picture = rasterise(*shape, camera=camera, colors=np.full((4000, 3), 0.3))
    shaded = ground.composite(picture, ground.darkness(*shape), camera=camera, background=(1, 1, 1))
    fall = (picture.rgb - shaded).sum(-1)
    below = camera.viewmat[:3, :3] @ (np.array([0.25, -0.3, 0]) @ turn) + camera.viewmat[:3, 3]
    column, row = (camera.K @ below)[:2] / below[2]
    rows, columns = np.mgrid[:120, :160] + 0.5
    assert fall[int(row), int(column)] > 0.05
    centre = np.average(columns.ravel(), weights=fall.ravel()), np.average(rows.ravel(), weights=fall.ravel())
    # The ball itself hides the far rim of its shadow: the centre of what is seen may move a little.
    assert np.hypot(centre[0] - column, centre[1] - row) < 6
    assert fall[np.hypot(columns - column, rows - row) > 60].max() < 1e-3


def test_a_shadow_is_darker_where_the_object_touches():
    ground = plane(np.eye(3))
    low, high = (ground.darkness(*ball([0, 0, z], turn=np.eye(3))) for z in (0.2, 0.7))
    assert low.max() > 2 * high.max() > 0
    assert low.max() <= 1


def test_the_object_is_never_covered_and_a_camera_below_sees_no_plane():
    shape = ball([0, 0, 0.25], turn=np.eye(3))
    ground, camera = plane(np.eye(3)), look_down(np.eye(3))
    picture = rasterise(*shape, camera=camera, colors=np.full((4000, 3), 0.3))
    darkness = ground.darkness(*shape)
    shaded = ground.composite(picture, darkness, camera=camera, background=(1, 1, 1))
    solid = picture.alpha > 0.999
    np.testing.assert_allclose(shaded[solid], picture.rgb[solid], atol=2e-3)
    below = look_down(np.eye(3), tilt=-0.4)
    picture = rasterise(*shape, camera=below, colors=np.full((4000, 3), 0.3))
    np.testing.assert_array_equal(ground.composite(picture, darkness, camera=below, background=(1, 1, 1)), picture.rgb)
