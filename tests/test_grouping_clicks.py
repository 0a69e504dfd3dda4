"""Clicks and splits: a pixel means what it shows, parts are those that were pointed at, nothing else changes."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from grouping_objects import potted_plant
from phys4dgen.errors import StageError
from phys4dgen.grouping.appearance import group_by_appearance, parts_from_seeds
from phys4dgen.grouping.merging import MergeTree, tree_from_arrays
from phys4dgen.grouping.seeds import gaussian_at
from phys4dgen.grouping.split import split_part
from phys4dgen.render.cameras import view_cameras
from phys4dgen.render.views import render_labels
from phys4dgen.types import Camera, Frame, Gaussians, Parts

Z_UP = Frame(np.eye(3), 1.0)
Plant = tuple[Gaussians, NDArray[np.int32], MergeTree, tuple[Camera, ...]]


@pytest.fixture(scope="module")
def plant() -> Plant:
    gaussians, truth = potted_plant()
    lower, upper = gaussians.robust_bounds()
    cameras = view_cameras("object", lower=lower, upper=upper, rotation=np.eye(3), size_px=128)
    return gaussians, truth, group_by_appearance(gaussians, Z_UP)[1], cameras


def clicked(plant: Plant, part: int) -> int:
    """The Gaussian under a click well inside what a true part shows in the view from above."""
    gaussians, truth, _, cameras = plant
    camera = cameras[-5]
    room = distance_transform_edt(render_labels(gaussians, truth, camera) == part)
    y_px, x_px = np.unravel_index(int(np.argmax(room)), (camera.height, camera.width))
    return gaussian_at(gaussians, camera, float(x_px), float(y_px))


def test_a_click_means_the_part_that_the_pixel_shows(plant):
    truth = plant[1]
    assert [truth[clicked(plant, part)] for part in range(3)] == [0, 1, 2]


def test_clicks_beside_the_object_are_refused(plant):
    gaussians, _, _, cameras = plant
    with pytest.raises(StageError, match="beside the object"):
        gaussian_at(gaussians, cameras[0], 1, 1)
    with pytest.raises(StageError, match=r"128, 3 lies outside the view of 128 x 128 px"):
        gaussian_at(gaussians, cameras[0], 128, 3)


def test_one_click_per_part_gives_those_parts_by_name(plant):
    gaussians, truth, tree, _ = plant
    seeds = {"leaves": [clicked(plant, 2)], "pot": [clicked(plant, 0)], "soil": [clicked(plant, 1)]}
    parts = parts_from_seeds(tree.graph, gaussians, Z_UP, seeds)
    assert parts.names == ("pot", "soil", "leaves")
    assert (parts.labels == truth).mean() > 0.93
    # two clicks may mean one part: leaves and soil against the pot
    both = parts_from_seeds(tree.graph, gaussians, Z_UP, {"pot": seeds["pot"], "rest": seeds["leaves"] + seeds["soil"]})
    assert both.names == ("pot", "rest")
    assert ((both.labels == 1) == (truth > 0)).mean() > 0.93


def test_two_parts_in_one_place_are_refused(plant):
    gaussians, _, tree, _ = plant
    spot = clicked(plant, 0)
    with pytest.raises(StageError, match="clicks for 'a' and 'b' fall on one spot"):
        parts_from_seeds(tree.graph, gaussians, Z_UP, {"a": [spot], "b": [spot]})


def test_a_split_divides_one_part_and_no_other(plant):
    gaussians, truth, tree, _ = plant
    # pot and soil as one part, leaves as another
    parts = Parts(labels=(truth == 2).astype(np.int32), names=("below", "leaves"), backend="file")
    halves = split_part(parts, "below", tree.graph, gaussians=gaussians, frame=Z_UP)
    assert halves.names == ("below_1", "below_2", "leaves")
    np.testing.assert_array_equal(halves.labels == 2, truth == 2)
    assert (halves.labels == truth).mean() > 0.93
    named = split_part(
        parts, "below", tree.graph, gaussians=gaussians, frame=Z_UP,
        seeds={"soil": [clicked(plant, 1)], "pot": [clicked(plant, 0)]},
    )  # fmt: skip
    assert named.names == ("pot", "soil", "leaves")
    assert (named.labels == truth).mean() > 0.93
    one = split_part(
        parts, "below", tree.graph, gaussians=gaussians, frame=Z_UP, seeds={"soil": [clicked(plant, 1)]}
    )  # fmt: skip
    assert one.names == ("below", "soil", "leaves")
    assert (one.labels == truth).mean() > 0.93


@pytest.mark.parametrize(
    ("name", "seed_part", "message"),
    [("stem", None, "there is no part 'stem' to split"), ("leaves", 0, "the click for 'a' falls on another part")],
)
def test_impossible_splits_are_refused(plant, name: str, seed_part: int | None, message: str):
    gaussians, truth, tree, _ = plant
    parts = Parts(labels=truth, names=("pot", "soil", "leaves"), backend="file")
    seeds = None if seed_part is None else {"a": [clicked(plant, seed_part)]}
    with pytest.raises(StageError, match=message):
        split_part(parts, name, tree.graph, gaussians=gaussians, frame=Z_UP, seeds=seeds)


def test_a_tree_of_other_gaussians_is_refused(plant):
    gaussians, _, tree, _ = plant
    arrays = tree.arrays()
    with pytest.raises(StageError, match="expected the merge tree of these 7 Gaussians"):
        tree_from_arrays(arrays, 7)
    with pytest.raises(StageError, match="expected an array called cost"):
        tree_from_arrays({name: array for name, array in arrays.items() if name != "cost"}, len(gaussians))
    beyond = arrays | {"kept": arrays["kept"] + 10**6}
    with pytest.raises(StageError, match="run grouping again"):
        tree_from_arrays(beyond, len(gaussians))
