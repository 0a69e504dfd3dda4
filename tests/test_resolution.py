"""The grid that is chosen where the user leaves it open."""

import numpy as np
import pytest

from phys4dgen.stages.resolution import FINE_GRID, MOST_PARTICLES_OF_A_GUESS, automatic_grid, estimated_particles
from phys4dgen.types import Gaussians


def shell(points):
    n = len(points)
    return Gaussians(
        means=points.astype(np.float32),
        scales=np.full((n, 3), 0.004, np.float32),
        quats_wxyz=np.tile(np.float32([1, 0, 0, 0]), (n, 1)),
        opacities=np.full(n, 0.9, np.float32),
        sh=np.zeros((n, 1, 3), np.float32),
    )


def sphere(n=150_000, radius=0.5):
    d = np.random.default_rng(0).normal(size=(n, 3))
    return radius * d / np.linalg.norm(d, axis=1, keepdims=True)


def test_a_ball_is_estimated_about_right_and_given_a_coarser_grid():
    ball = shell(sphere())
    truth = 8 * np.pi / 6 * 64**3
    found = estimated_particles(ball, rotation=np.eye(3), grid=64)
    assert found == pytest.approx(truth, rel=0.15)
    grid = automatic_grid(ball, rotation=np.eye(3))
    assert grid < FINE_GRID
    assert estimated_particles(ball, rotation=np.eye(3), grid=grid) <= 120_000
    quick = automatic_grid(ball, rotation=np.eye(3), most_particles=MOST_PARTICLES_OF_A_GUESS)
    assert quick < grid
    assert estimated_particles(ball, rotation=np.eye(3), grid=quick) <= MOST_PARTICLES_OF_A_GUESS


def test_an_open_underside_does_not_empty_the_estimate():
    points = sphere()
    points[:, 2] *= 1.2
    whole, open_below = shell(points), shell(points[points[:, 2] > -0.45])
    a, b = (estimated_particles(g, rotation=np.eye(3), grid=64) for g in (whole, open_below))
    assert b == pytest.approx(a * (1.2 / 1.05) ** 3, rel=0.15)  # the cut one is lower, so its cells are smaller


def test_a_thin_thing_keeps_the_fine_grid():
    plane = np.column_stack([np.random.default_rng(0).uniform(-0.5, 0.5, (20_000, 2)), np.zeros(20_000)])
    plane[:, 2] = 0.02 * np.sin(6 * plane[:, 0])
    assert automatic_grid(shell(plane), rotation=np.eye(3)) == FINE_GRID
