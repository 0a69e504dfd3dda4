"""What tells two things from one: a fold between them where they have one colour, none where one is painted in two."""

from __future__ import annotations

import numpy as np
import pytest

from grouping_objects import ball_on_ball, painted_ball
from phys4dgen.grouping.appearance import appearance_tree, group_by_appearance, parts_from_tree
from phys4dgen.grouping.cutting import cut_tree
from phys4dgen.grouping.detour import crease_detours
from phys4dgen.grouping.merging import MergeTree
from phys4dgen.types import Frame, Gaussians

Z_UP = Frame(np.eye(3), 1.0)
RED = (0.70, 0.15, 0.15)
CREAM, BLUE = (0.80, 0.75, 0.66), (0.56, 0.60, 0.66)


@pytest.fixture(scope="module")
def red_balls() -> tuple[Gaussians, np.ndarray, MergeTree]:
    gaussians, truth = ball_on_ball(RED, RED)
    return gaussians, truth, appearance_tree(gaussians, Z_UP)


def test_two_balls_of_one_colour_part_at_their_crease_when_two_parts_are_asked_for(red_balls):
    gaussians, truth, tree = red_balls
    labels = parts_from_tree(tree, gaussians, Z_UP, parts=2).labels  # numbered from the ground up
    for part in (0, 1):
        assert ((labels == part) & (truth == part)).sum() > 0.95 * ((labels == part) | (truth == part)).sum()


def test_two_balls_of_one_colour_are_one_part_by_default_as_a_statue_is(red_balls):
    gaussians, _, tree = red_balls
    assert parts_from_tree(tree, gaussians, Z_UP).count == 1


def test_paint_does_not_divide_a_ball_but_two_balls_of_its_colours_are_two_parts():
    assert group_by_appearance(painted_ball(CREAM, BLUE), Z_UP)[0].count == 1
    assert group_by_appearance(ball_on_ball(CREAM, BLUE)[0], Z_UP)[0].count == 2


def test_detours_are_long_across_the_crease_and_short_within_a_ball(red_balls):
    _, truth, tree = red_balls
    graph = tree.graph
    seen = graph.patch >= 0
    upper = np.bincount(graph.patch[seen], truth[seen]) / np.bincount(graph.patch[seen]) > 0.5
    detours = crease_detours(graph, cut_tree(tree, 60))
    np.testing.assert_allclose(detours, detours.T)
    np.testing.assert_array_equal(np.diag(detours), 0)
    assert np.median(detours[np.ix_(upper, ~upper)]) > 5 * np.median(detours[np.ix_(upper, upper)])
    assert np.median(detours[np.ix_(upper, ~upper)]) > 0.2
