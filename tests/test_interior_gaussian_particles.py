"""The paper's particles: the Gaussians and the interior cells, with the volume of the solid that was found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from phys4dgen.animate import skin
from phys4dgen.interior.gaussian_particles import as_lumps, gaussians_as_particles
from phys4dgen.interior.labels import label_cells
from phys4dgen.interior.voxels import VoxelGrid
from phys4dgen.types import SHEET, SOLID, Continuum, Frame, Gaussians

CELL = 0.1
RADIUS = 1.0


def ball(count: int = 5000) -> tuple[Gaussians, np.ndarray]:
    """A ball of two halves, seen from outside, and a floater far off."""
    points = np.random.default_rng(0).normal(size=(count, 3))
    points = RADIUS * points / np.linalg.norm(points, axis=1, keepdims=True)
    points = np.concatenate([points, [[0.0, 0.0, 3.0]]])
    n = len(points)
    gaussians = Gaussians(
        means=points.astype(np.float32),
        quats_wxyz=np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)),
        scales=np.full((n, 3), 0.02, np.float32),
        opacities=np.where(np.arange(n) % 3 == 0, 0.01, 0.9).astype(np.float32),
        sh=np.zeros((n, 1, 3), np.float32),
    )
    return gaussians, (points[:, 0] > 0).astype(np.int32)


def seeded() -> Continuum:
    """The same ball filled at half a cell."""
    axis = np.arange(-1.2, 1.2, CELL / 2) + CELL / 4
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    points = points[np.linalg.norm(points, axis=1) < RADIUS]
    p = len(points)
    return Continuum(
        positions=points,
        part=(points[:, 0] > 0).astype(np.int32),
        is_interior=np.zeros(p, bool),
        volume_m3=np.full(p, (CELL / 2) ** 3),
        gaussian_index=np.full(p, -1, np.int32),
        piece=(points[:, 0] > 0).astype(np.int32),
        shape=np.full(p, SOLID, np.int8),
        thickness_m=np.full(p, np.nan),
        thickness_measured=np.zeros(p, bool),
        offset_m=np.zeros((p, 3)),
        site=np.arange(p),
        spacing_m=CELL / 2,
    )


@pytest.fixture(scope="module")
def paper() -> tuple[Gaussians, np.ndarray, Continuum]:
    gaussians, labels = ball()
    grid = VoxelGrid.around(np.full(3, -RADIUS), np.full(3, RADIUS), 2 * RADIUS / 32, padding=1)
    valid = np.linalg.norm(grid.all_centers().reshape(*grid.shape, 3), axis=-1) < RADIUS
    labelled = label_cells(gaussians, labels, grid, valid, np.eye(3))
    frame = Frame(np.eye(3), 1.0)
    return (
        gaussians,
        labels,
        gaussians_as_particles(gaussians, labels, seeded(), labelled=labelled, frame=frame, cell=CELL),
    )


def test_every_gaussian_of_the_body_is_a_particle_whatever_its_opacity(paper):
    gaussians, labels, continuum = paper
    surface = ~continuum.is_interior
    index = continuum.gaussian_index[surface]
    assert sorted(index) == list(range(len(gaussians) - 1))  # but not the floater
    np.testing.assert_array_equal(continuum.positions[surface], gaussians.means[index])
    np.testing.assert_array_equal(continuum.part[surface], labels[index])
    assert (continuum.gaussian_index[continuum.is_interior] == -1).all()
    assert (np.linalg.norm(continuum.positions[continuum.is_interior], axis=1) < RADIUS).all()
    assert continuum.is_interior.sum() > 5000


def test_the_volume_of_each_part_is_that_of_the_solid(paper):
    _, _, continuum = paper
    solid = seeded()
    for part in (0, 1):
        mine = continuum.volume_m3[continuum.part == part].sum()
        assert mine == pytest.approx(solid.volume_m3[solid.part == part].sum(), rel=1e-3)
    assert continuum.volume_m3.min() > 0
    np.testing.assert_array_equal(continuum.piece, continuum.part)


def test_a_gaussian_that_is_a_particle_follows_itself_alone(paper):
    gaussians, labels, continuum = paper
    hung = skin(gaussians, labels, continuum, frame=Frame(np.eye(3), 1.0))
    carried = continuum.gaussian_index[hung.particles[:-1, 0]]
    np.testing.assert_array_equal(carried, np.arange(len(gaussians) - 1))
    np.testing.assert_array_equal(hung.weights[:-1, 0], 1)
    assert np.abs(hung.arm[:-1]).max() == 0
    assert hung.rigidity[:-1].max() == 0
    assert hung.weights[-1, 0] < 1  # the floater is carried by several


def test_what_is_known_of_thin_parts_is_kept_for_the_materials_and_not_simulated():
    gaussians, labels = ball()
    grid = VoxelGrid.around(np.full(3, -RADIUS), np.full(3, RADIUS), 2 * RADIUS / 32, padding=1)
    labelled = label_cells(gaussians, labels, grid, np.zeros(grid.shape, bool), np.eye(3))
    solid = seeded()
    sheet = solid.positions[:, 0] > 0
    shell = replace(
        solid,
        shape=np.where(sheet, SHEET, SOLID).astype(np.int8),
        thickness_m=np.where(sheet, 0.004, np.nan),
        thickness_measured=sheet,
    )
    frame = Frame(np.eye(3), 1.0)
    found = gaussians_as_particles(gaussians, labels, shell, labelled=labelled, frame=frame, cell=CELL)
    np.testing.assert_array_equal(found.shape == SHEET, found.part == 1)
    np.testing.assert_array_equal(found.thickness_m[found.part == 1], 0.004)
    lumps = as_lumps(found)
    assert (lumps.shape == SOLID).all()
    assert not lumps.thickness_measured.any()
    np.testing.assert_array_equal(lumps.volume_m3, found.volume_m3)
