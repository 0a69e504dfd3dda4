"""Implicit solids against closed formulas: volumes, samples on the surface, joins, cuts and hollows."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import KDTree

from phys4dgen.zoo.forms import (
    ball,
    blended,
    carved,
    ellipsoid,
    hollow,
    lathe,
    placed,
    ring,
    rod,
    rounded_box,
    shaped,
    stretched,
    turned_deg,
    united,
)
from phys4dgen.zoo.solids import Revolved

PI = np.pi
TURN = turned_deg(20, 30, 40)
CONE = np.array([[0, 0], [0.05, 0], [0, 0.12]])

KNOWN = {
    "ball": (ball(0.1, (0.3, 0, 0)), 4 / 3 * PI * 0.1**3),
    "ellipsoid": (ellipsoid((0.1, 0.05, 0.03)), 4 / 3 * PI * 0.1 * 0.05 * 0.03),
    "turned ellipsoid": (placed(ellipsoid((0.1, 0.05, 0.03)), (1, 2, 3), TURN), 4 / 3 * PI * 0.1 * 0.05 * 0.03),
    # a box of sides a, b, c swollen by r: abc + 2 (ab + bc + ca) r + pi (a + b + c) r^2 + 4/3 pi r^3
    "rounded box": (
        rounded_box((0.05, 0.04, 0.03), 0.01),
        0.08 * 0.06 * 0.04
        + 2 * (0.08 * 0.06 + 0.06 * 0.04 + 0.04 * 0.08) * 0.01
        + PI * 0.18 * 0.01**2
        + 4 / 3 * PI * 0.01**3,
    ),
    "torus": (ring(0.1, (0.02, 0.02), 0.02), 2 * PI**2 * 0.1 * 0.02**2),
    "capsule": (rod([[0, 0, 0], [0.1, 0, 0]], 0.02), PI * 0.02**2 * 0.1 + 4 / 3 * PI * 0.02**3),
    "cone": (lathe(CONE), PI * 0.05**2 * 0.12 / 3),
    "stretched ball": (stretched(ball(0.1), (1, 0.5, 1)), 4 / 3 * PI * 0.1**3 / 2),
    "two balls apart": (united(ball(0.05), ball(0.03, (0.2, 0, 0))), 4 / 3 * PI * (0.05**3 + 0.03**3)),
    "half a ball": (carved(ball(0.1), rounded_box((0.2, 0.2, 0.2), 1e-6, (0, -0.2, 0))), 2 / 3 * PI * 0.1**3),
    "shell": (hollow(ball(0.1), 0.01), 4 / 3 * PI * (0.1**3 - 0.09**3)),
    "swollen ball": (shaped(ball(0.1), lambda p: np.full(len(p), 0.01), reach_m=0.01), 4 / 3 * PI * 0.11**3),
}


@pytest.mark.parametrize("name", KNOWN)
def test_volume_agrees_with_the_formula(name):
    solid, volume = KNOWN[name]
    assert solid.volume_m3 == pytest.approx(volume, rel=0.005)


@pytest.mark.parametrize("name", KNOWN)
def test_samples_lie_on_the_surface_and_leave_no_gap(name):
    solid, _ = KNOWN[name]
    spacing = float((solid.upper - solid.lower).max()) / 60
    patch = solid.sample(spacing, np.random.default_rng(0))
    assert (patch.points > solid.lower - 1e-3).all() and (patch.points < solid.upper + 1e-3).all()
    off = np.abs(solid.distance(patch.points))
    assert np.percentile(off, 98) < 0.02 * spacing and off.max() < 0.5 * spacing
    np.testing.assert_allclose(np.linalg.norm(patch.normals, axis=1), 1, atol=1e-9)
    np.testing.assert_allclose((patch.normals * patch.tangents).sum(1), 0, atol=1e-9)
    inward, outward = (solid.distance(patch.points + side * 0.3 * spacing * patch.normals) for side in (-1, 1))
    assert (inward < 0).mean() > 0.99 and (outward > 0).mean() > 0.99


def test_samples_cover_a_ball_evenly():
    patch = ball(0.1).sample(0.003, np.random.default_rng(0))
    directions = np.random.default_rng(1).normal(size=(2000, 3))
    directions *= 0.1 / np.linalg.norm(directions, axis=1, keepdims=True)
    assert KDTree(patch.points).query(directions)[0].max() < 1.2 * 0.003
    area_per_sample = 4 * PI * 0.1**2 / len(patch)
    assert 0.55 < area_per_sample / 0.003**2 < 1.0  # oblique cells are cut more often


def test_a_blend_only_adds_where_two_solids_are_near():
    apart = [ball(0.05), ball(0.05, (0.2, 0, 0))]
    assert blended(0.02, *apart).volume_m3 == pytest.approx(united(*apart).volume_m3, rel=1e-3)
    touching = [ball(0.05), ball(0.05, (0.08, 0, 0))]
    assert blended(0.02, *touching).volume_m3 > 1.005 * united(*touching).volume_m3


def test_a_hollow_solid_is_empty_inside():
    shell = hollow(ball(0.1), 0.01)
    points = np.array([[0, 0, 0], [0.095, 0, 0], [0.105, 0, 0], [0.089, 0, 0]])
    assert shell.contains(points).tolist() == [False, True, False, False]
    assert shell.cavity_m3 == pytest.approx(4 / 3 * PI * 0.09**3, rel=0.005)


def test_a_lathe_and_a_solid_of_revolution_are_the_same_solid():
    profile = np.array([[0, 0], [0.05, 0], [0.06, 0.04], [0.03, 0.07], [0.04, 0.12], [0, 0.12]])
    exact = Revolved(profile, np.zeros(3), np.eye(3))
    assert lathe(profile).volume_m3 == pytest.approx(exact.volume_m3, rel=0.005)
    points = np.random.default_rng(0).uniform([-0.07, -0.01, -0.07], [0.07, 0.13, 0.07], (20_000, 3))
    assert (lathe(profile).contains(points) == exact.contains(points)).mean() > 0.995
