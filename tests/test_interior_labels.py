"""The paper's label grid: surface cells by the chi-square test, inner cells by rays along the six axes."""

import numpy as np
import pytest

from phys4dgen.interior.labels import label_cells
from phys4dgen.interior.voxels import VoxelGrid
from phys4dgen.types import Gaussians, rotation_to_z_up

UP_TO_Z = rotation_to_z_up(np.array([0.0, 1, 0]))


def _gaussians(means, *, sigma, opacities=0.9):
    n = len(means)
    return Gaussians(
        means=np.asarray(means, np.float32),
        quats_wxyz=np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)),
        scales=np.full((n, 3), sigma, np.float32),
        opacities=np.broadcast_to(np.float32(opacities), n).copy(),
        sh=np.zeros((n, 1, 3), np.float32),
    )


def _sphere(radius, count, *, seed=0):
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return radius * points / np.linalg.norm(points, axis=1, keepdims=True)


def _ball_cells(cells=32, radius=1.0):
    side = 2 * radius / cells
    grid = VoxelGrid.around(np.full(3, -radius), np.full(3, radius), side, padding=1)
    center = grid.all_centers().reshape(*grid.shape, 3)
    return grid, center, np.linalg.norm(center, axis=-1) <= radius


# ------------------------------------------------------------------------------------------------ parts


def test_two_half_balls_are_told_apart_to_their_middle():
    """Only the skin is seen; the axes' rays carry its labels inwards. Up is +y in the input."""
    grid, center, valid = _ball_cells()
    skin = _sphere(1.0, 6000) @ UP_TO_Z  # z up -> input axes
    labels = (skin @ UP_TO_Z.T[:, 0] > 0).astype(np.int32)
    found = label_cells(_gaussians(skin, sigma=0.02), labels, grid, valid, UP_TO_Z)
    np.testing.assert_array_equal(found.part >= 0, valid)
    right = found.part[valid] == (center[valid][:, 0] > 0)
    assert right.mean() >= 0.95
    deep = found.is_interior & (np.abs(center[..., 0]) > 0.15)
    assert (found.part[deep] == (center[deep][:, 0] > 0)).mean() >= 0.98


def test_a_core_inside_a_shell_keeps_its_own():
    """Rays from the core meet the core first; rays from between meet the shell more often than not."""
    grid, center, valid = _ball_cells()
    distance = np.linalg.norm(center, axis=-1)
    shell, core = _sphere(1.0, 6000), _sphere(0.4, 2000, seed=1)
    gaussians = _gaussians(np.concatenate([shell, core]), sigma=0.02)
    labels = np.repeat([0, 1], [len(shell), len(core)]).astype(np.int32)
    found = label_cells(gaussians, labels, grid, valid, np.eye(3))
    inside_core = found.is_interior & (distance < 0.3)
    between = found.is_interior & (distance > 0.55) & valid
    assert inside_core.sum() > 300
    assert (found.part[inside_core] == 1).all()
    assert (found.part[between] == 0).mean() > 0.95
    assert not found.is_interior[np.abs(distance - 0.4) < 0.03].any()


def test_the_majority_of_the_six_axes_wins_and_a_tie_goes_to_the_nearest():
    """One cell of air-tight box whose six walls have parts that we choose."""
    n = 9
    grid = VoxelGrid(np.zeros(3), 1.0, (n, n, n))
    valid = np.ones((n, n, n), bool)
    walls = {(0, 0.0): 2, (0, 9.0): 2, (1, 0.0): 0, (1, 9.0): 0, (2, 0.0): 1, (2, 9.0): 0}
    means, labels = [], []
    for (axis, at), part in walls.items():
        plane = np.stack(np.meshgrid(np.arange(n) + 0.5, np.arange(n) + 0.5, indexing="ij"), -1).reshape(-1, 2)
        means.append(np.insert(plane, axis, at, axis=1))
        labels.append(np.full(len(plane), part))
    gaussians = _gaussians(np.concatenate(means), sigma=0.05)
    labels = np.concatenate(labels).astype(np.int32)
    found = label_cells(gaussians, labels, grid, valid, np.eye(3))
    assert found.is_interior[2:7, 2:7, 2:7].all()
    assert (found.part[2:7, 2:7, 2:7] == 0).all()  # three walls of six

    labels[(labels == 0) & (gaussians.means[:, 2] == 9.0)] = 1  # now two walls each
    tied = label_cells(gaussians, labels, grid, valid, np.eye(3))
    assert tied.part[4, 4, 2] == 1  # beside the wall z = 0
    assert tied.part[2, 4, 4] == 2
    assert tied.part[4, 6, 4] == 0


# ------------------------------------------------------------------------------------------------ surface


@pytest.mark.parametrize(
    "sigma, max_cells, expected",
    [
        (0.35, 10, 7),  # sqrt(7.81 (0.35^2 + 0.25^2)) = 1.20 cells: the cell and its six neighbours
        (0.60, 27, 27),  # 1.82 cells: all 26 neighbours (sqrt 3), not the next ones (2)
        (0.60, 10, 10),  # the same, but no more than ten cells
        (0.02, 10, 1),  # 0.70 cells
    ],
)
def test_a_gaussian_claims_the_cells_in_its_confidence_ellipsoid(sigma, max_cells, expected):
    grid = VoxelGrid(np.zeros(3), 1.0, (15, 15, 15))
    valid = np.ones(grid.shape, bool)
    found = label_cells(
        _gaussians([[7.5, 7.5, 7.5]], sigma=sigma),
        np.zeros(1, np.int32),
        grid,
        valid,
        np.eye(3),
        max_cells_per_gaussian=max_cells,
    )
    inner = valid & ~found.is_interior
    inner[[0, -1]] = inner[:, [0, -1]] = inner[:, :, [0, -1]] = False
    assert inner.sum() == expected
    assert inner[7, 7, 7]


def test_less_confidence_is_a_smaller_ellipsoid():
    grid = VoxelGrid(np.zeros(3), 1.0, (15, 15, 15))
    valid = np.ones(grid.shape, bool)
    gaussians, labels = _gaussians([[7.5, 7.5, 7.5]], sigma=0.6), np.zeros(1, np.int32)

    def interior(confidence):
        return label_cells(gaussians, labels, grid, valid, np.eye(3), confidence=confidence, max_cells_per_gaussian=27)

    # chi-square with 3 degrees of freedom: 60 % of the mass lies within 2.95 sigma^2: 1.1 cells, 7 cells of 27.
    assert interior(0.95).is_interior.sum() + 20 == interior(0.6).is_interior.sum()


def test_the_outermost_layer_closes_the_surface_where_nothing_was_seen():
    grid, center, valid = _ball_cells(16)
    front = _sphere(1.0, 3000)
    front = front[front[:, 2] > 0]
    found = label_cells(_gaussians(front, sigma=0.01), np.zeros(len(front), np.int32), grid, valid, np.eye(3))
    outside = np.pad(~valid, 1, constant_values=True)
    touches_air = np.zeros_like(valid)
    for axis in range(3):
        for step in (-1, 1):
            touches_air |= np.roll(outside, step, axis)[1:-1, 1:-1, 1:-1]
    assert not (found.is_interior & touches_air).any()
    assert found.is_interior[np.linalg.norm(center, axis=-1) < 0.5].all()
    assert (found.part[valid] == 0).all()


def test_faint_gaussians_claim_nothing():
    grid = VoxelGrid(np.zeros(3), 1.0, (15, 15, 15))
    valid = np.ones(grid.shape, bool)
    faint = _gaussians([[7.5, 7.5, 7.5], [0.5, 7.5, 7.5]], sigma=0.3, opacities=[0.01, 0.9])
    found = label_cells(faint, np.array([1, 0], np.int32), grid, valid, np.eye(3))
    assert found.is_interior[7, 7, 7]
    assert (found.part == 0).all()
