"""From patches to Gaussians: the vote at the borders, and which part Gaussians follow that no view sees."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from grouping_objects import disc, from_points, ring
from phys4dgen.grouping.attach import attach
from phys4dgen.types import SH_C0, Gaussians
from phys4dgen.types.color import lab_to_srgb

BUN = (60.0, 17.0, 37.0)
COAL = (14.0, 2.0, 2.0)


def _between_two_plates(
    lab_below: tuple[float, float, float],
    lab_above: tuple[float, float, float],
    hidden_lab: NDArray[np.float64],
    *,
    height: float = 0.1,
) -> NDArray[np.int64]:
    """Parts (0 below, 1 above) of hidden Gaussians between two visible plates of noisy colour at heights 0 and 0.3."""
    rng = np.random.default_rng(0)
    count = len(hidden_lab)
    plate = np.stack(np.meshgrid(np.linspace(-1, 1, 20), np.linspace(-1, 1, 20)), -1).reshape(-1, 2)
    below, above = (np.concatenate([plate, np.full((400, 1), level)], 1) for level in (0.0, 0.3))
    hidden = np.concatenate([rng.uniform(-0.8, 0.8, (count, 2)), np.full((count, 1), height)], 1)
    noise = rng.normal(0, 6, (800, 3)) * [1, 0.5, 0.5]
    lab = np.concatenate([np.repeat([lab_below, lab_above], 400, axis=0) + noise, hidden_lab])
    n = len(lab)
    gaussians = Gaussians(
        means=np.concatenate([below, above, hidden]).astype(np.float32),
        quats_wxyz=np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)),
        scales=np.full((n, 3), 0.05, np.float32),
        opacities=np.full(n, 0.5, np.float32),
        sh=((lab_to_srgb(lab) - 0.5) / SH_C0).astype(np.float32)[:, None],
    )
    patch = np.repeat(np.array([0, 1, -1], np.int32), (400, 400, count))
    color = (lab * [0.5, 1, 1]).astype(np.float32)
    return attach(gaussians, patch, np.array([0, 1]), color=color, radius=1.4)[800:]


def _in_the_shade(lab: tuple[float, float, float], light: float, count: int = 100) -> NDArray[np.float64]:
    """A colour under less light: L + 16, a and b shrink by one factor."""
    noise = np.random.default_rng(1).normal(0, 2, (count, 3))
    black = np.array([-16, 0, 0])
    return black + (np.array(lab) - black) * light + noise


@pytest.mark.parametrize("light", [1.0, 0.5, 0.35])
def test_shade_does_not_give_a_hidden_gaussian_to_the_darkest_part(light: float):
    part = _between_two_plates(BUN, COAL, _in_the_shade(BUN, light))
    assert (part == 0).mean() > 0.95


def test_half_way_between_white_and_black_the_dark_are_of_the_black_part():
    part = _between_two_plates((90.0, 0.0, 0.0), COAL, _in_the_shade(COAL, 1.0), height=0.15)
    assert (part == 1).mean() > 0.95


def test_hue_decides_against_the_nearer_part():
    part = _between_two_plates(BUN, (60.0, -35.0, 33.0), _in_the_shade((60.0, -35.0, 33.0), 0.6))
    assert (part == 1).mean() > 0.95


def test_an_underside_goes_on_into_the_rim_though_what_stands_above_is_nearer():
    """A tower of sand on a mound of the same sand: under the tower lies the mound's underside."""
    rng = np.random.default_rng(2)
    mound = ring(2000, (1.0, 0.45), (0.0, 0.25), rng)
    tower = ring(1000, (0.4, 0.35), (0.25, 0.9), rng)
    underside = disc(500, 0.9, 0.0, rng)
    points = np.concatenate([mound, tower, underside])
    lab = rng.normal(0, 3, (len(points), 3)) * [1, 0.5, 0.5] + [70, 5, 25]
    gaussians = from_points(points, lab_to_srgb(lab), size=0.02, seed=0)
    patch = np.repeat(np.array([0, 1, -1], np.int32), (2000, 1000, 500))
    part = attach(gaussians, patch, np.array([0, 1]), color=(lab * [0.5, 1, 1]).astype(np.float32), radius=1.5)
    inner = np.hypot(*underside[:, :2].T) < 0.5
    assert inner.sum() > 100
    assert (part[3000:][inner] == 0).mean() > 0.95


@pytest.mark.parametrize("thing_width", [0.12, 0.3])
def test_a_patch_that_lies_across_the_border_of_a_part_does_not_take_what_is_beyond(thing_width: float):
    """Red and green stripes; every second red patch reaches over a quarter of the green stripe beside it."""
    rng = np.random.default_rng(0)
    x, y = np.meshgrid(np.linspace(-1, 1, 80), np.linspace(-1, 1, 80))
    x, y = x.ravel() + rng.normal(0, 0.004, 6400), y.ravel() + rng.normal(0, 0.004, 6400)
    stripe = np.floor((x + 1.1) / thing_width).astype(int)
    truth = stripe % 2
    lab = np.where(truth[:, None] == 0, [45.0, 40.0, 20.0], [50.0, -25.0, 25.0]) + rng.normal(0, 5, (6400, 3))
    block = np.floor((y + 1.1) / thing_width).astype(int)
    beyond = (truth == 1) & (block % 2 == 0) & ((x + 1.1) / thing_width - stripe < 0.25)
    patch = np.unique((stripe - beyond) * 1000 + block, return_inverse=True)[1].astype(np.int32)
    of_patch = np.array([np.bincount(truth[patch == number]).argmax() for number in range(patch.max() + 1)])
    gaussians = from_points(np.stack([x, y, 0 * x], 1), lab_to_srgb(lab), size=0.02, seed=0)
    part = attach(gaussians, patch, of_patch, color=(lab * [0.5, 1, 1]).astype(np.float32), radius=1.4)
    assert (of_patch[patch] != truth).mean() > 0.05
    assert (part != truth).mean() < 0.01
