"""The thickness below the surface: that of a ball, a plate and a rod; its neighbours' where rays leave the object."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import KDTree

from phys4dgen.grouping.diameter import log_diameter
from phys4dgen.grouping.supervoxels import Supervoxels


def on_ball(count: int, radius: float) -> NDArray[np.float64]:
    """Points on a ball, evenly spread."""
    number = np.arange(count) + 0.5
    z, turn = 1 - 2 * number / count, np.pi * (1 + 5**0.5) * number
    across = np.sqrt(1 - z**2)
    return radius * np.stack([across * np.cos(turn), across * np.sin(turn), z], 1)


def patches_at(points: NDArray[np.float64], centre: NDArray[np.float64], normal: NDArray[np.float64]) -> Supervoxels:
    """Patches of a surface; each touches its three nearest. What their thickness does not ask for is empty."""
    count = len(centre)
    border = np.zeros((count, count))
    near = KDTree(centre).query(centre, min(4, count))[1].reshape(count, -1)
    np.put_along_axis(border, near, 1.0, 1)
    np.fill_diagonal(border, 0)
    nothing = np.zeros(0)
    return Supervoxels(
        core=np.arange(len(points)), patch=np.zeros(len(points), np.intp), color=nothing,
        neighbours=np.zeros(0, np.int32), mean=nothing, spread=nothing, area=nothing, centre=centre, normal=normal,
        flatness=nothing, thinness=nothing, openness=nothing, border=np.maximum(border, border.T),
    )  # fmt: skip


def test_a_ball_is_as_thick_everywhere_in_any_pose():
    points = on_ball(8000, 1.0)
    centre = points[::100]
    found = np.exp(log_diameter(patches_at(points, centre, centre), points)) * np.sqrt(3)
    # Chords at angle t to the inward normal are 2 cos(t) long; half of the cone of 50 degrees lies within 35 of it.
    np.testing.assert_allclose(found, 2 * np.cos(np.deg2rad(34.7)), rtol=0.08)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turned = patches_at(points @ turn.T, centre @ turn.T, centre @ turn.T)
    half = np.linalg.norm(np.ptp(points @ turn.T, axis=0)) / 2
    np.testing.assert_allclose(np.exp(log_diameter(turned, points @ turn.T)) * half, found, rtol=0.08)


def test_a_rod_and_the_ball_that_it_stands_on_are_told_apart():
    rng = np.random.default_rng(1)
    turn = rng.uniform(0, 2 * np.pi, 4000)
    round_rod = np.stack([np.cos(turn), np.sin(turn), np.zeros(4000)], 1)
    rod = 0.15 * round_rod + np.stack([np.zeros(4000), np.zeros(4000), rng.uniform(1, 2.5, 4000)], 1)
    ball = on_ball(8000, 1.0)
    points = np.concatenate([ball, rod])
    patches = patches_at(
        points, np.concatenate([ball[2000::100], rod[::100]]), np.concatenate([ball[2000::100], round_rod[::100]])
    )
    found = log_diameter(patches, points)
    assert found[60:].max() < found[:60].min() - 1


def test_where_rays_leave_the_object_neighbours_say_how_thick_it_is():
    points = on_ball(8000, 1.0)
    centre = points[::100]
    outwards = np.where(np.arange(80)[:, None] % 4 == 0, -centre, centre)  # a quarter looks the wrong way
    found = log_diameter(patches_at(points, centre, outwards), points)
    np.testing.assert_allclose(found, found.mean(), atol=0.06)


@pytest.mark.parametrize("points", [np.zeros((1, 3)), np.zeros((9, 3)), np.eye(3)])
def test_what_has_no_inside_gets_a_number_all_the_same(points: NDArray[np.float64]):
    found = log_diameter(patches_at(points, points[:1], np.array([[0.0, 0, 1]])), points)
    assert found.shape == (1,)
    assert np.isfinite(found).all()
