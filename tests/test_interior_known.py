"""The inside of an object whose maker knows it exactly."""

import numpy as np
import pytest

from phys4dgen.interior import discover_interior
from phys4dgen.types import Camera, Frame, Gaussians, Parts, Views

RADIUS = 0.5


@pytest.fixture(scope="module")
def found():
    rng = np.random.default_rng(0)
    direction = rng.normal(size=(20_000, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    count = len(direction)
    gaussians = Gaussians(
        means=(RADIUS * direction).astype(np.float32),
        quats_wxyz=np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
        scales=np.full((count, 3), 0.006, np.float32),
        opacities=np.full(count, 0.95, np.float32),
        sh=np.zeros((count, 1, 3), np.float32),
    )
    nothing = np.zeros((1, 8, 8), np.float32)  # no view is needed where the inside is known
    camera = Camera(viewmat=np.eye(4), K=np.diag([8.0, 8.0, 1.0]), width=8, height=8)
    views = Views((camera,), np.zeros((1, 8, 8, 3), np.float32), nothing, nothing)
    labels = (gaussians.means[:, 2] > 0).astype(np.int32)
    return discover_interior(
        gaussians,
        views,
        Parts(labels, ("low", "high"), "test"),
        frame=Frame(np.eye(3), 1.0),
        cell=1 / 24,
        known=lambda points: np.linalg.norm(points, axis=1) < RADIUS,
    )


def test_its_volume_is_exact(found):
    assert found.continuum.volume_m3.sum() == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=0.01)
    assert np.linalg.norm(found.continuum.positions, axis=1).max() < RADIUS + 1 / 24
    assert np.isnan(found.agreement)
    assert "exact" in found.backend


def test_its_particles_belong_to_the_part_around_them(found):
    upper = found.continuum.positions[:, 2] > 1 / 12
    lower = found.continuum.positions[:, 2] < -1 / 12
    assert (found.continuum.part[upper] == 1).mean() > 0.99
    assert (found.continuum.part[lower] == 0).mean() > 0.99
    assert found.continuum.is_interior.mean() > 0.5
