"""SAM2 grouping at the level of masks: a double with the truth and planted errors in the place of the network."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from phys4dgen.errors import StageError
from phys4dgen.grouping.sam2.group import (
    FOREGROUND,
    compared_surface,
    find_segments,
    on_path,
    parts_of_segments,
    segments_of_tracks,
)
from phys4dgen.grouping.sam2.merging import Surface, joined_ids
from phys4dgen.grouping.sam2.pointing import Pointing, cut_out_piece
from phys4dgen.grouping.sam2.proposals import Choice, chosen_proposals, disjoint_parts
from phys4dgen.grouping.sam2.segmenter import Proposal
from phys4dgen.grouping.sam2.tracks import Tracks, follow_things
from phys4dgen.grouping.sam2.view_path import key_places, smooth_path
from phys4dgen.grouping.seeds import gaussian_at
from phys4dgen.progress import SILENT
from phys4dgen.render.views import render_views
from phys4dgen.types import Frame, Parts, rotation_to_z_up
from phys4dgen.zoo.catalogue import bundled
from sam2_oracle import Oracle, random_cameras, true_maps


def box(left, top, right, bottom, *, shape=(60, 80)):
    mask = np.zeros(shape, np.bool_)
    mask[top:bottom, left:right] = True
    return mask


def accuracy(labels, truth, chosen):
    count = np.zeros((labels.max() + 1, truth.max() + 1))
    np.add.at(count, (labels[chosen], truth[chosen]), 1)
    return count[linear_sum_assignment(-count)].sum() / chosen.sum()


class Scenario:
    """An object, its random views in order, and the oracle's grouping of it."""

    def __init__(self, name, *, count, size_px, seed=0, **errors):
        self.object = bundled(name)
        gaussians, rotation = self.object.gaussians, rotation_to_z_up(self.object.up)
        cameras = random_cameras(gaussians, rotation, count=count, size_px=size_px, seed=seed)
        self.views = on_path(render_views(gaussians, cameras))
        self.frame = Frame(rotation, 1.0)
        self.truth = true_maps(gaussians, self.object.labels, self.views.cameras)
        self.oracle = Oracle(self.truth, seed=seed, **errors)

    def parts(self):
        """Parts as the product makes them, and the thing of each id in each view."""
        foreground = self.views.alpha > FOREGROUND
        surface, samples = compared_surface(self.object.gaussians, self.views)
        keys = key_places(len(self.views), 8)
        tracks = follow_things(self.oracle, foreground, samples, keys=keys, progress=SILENT)
        meaning = joined_ids(tracks, surface)
        segments = segments_of_tracks(tracks, meaning, foreground)
        parts = parts_of_segments(segments, self.object.gaussians, self.frame, self.views, backend="double")
        return parts, segments, meaning

    def merged_share(self, meaning):
        """Of the ids that a part has besides its main one, the share that became the same thing."""
        things = {}
        for number, part in enumerate(self.oracle.started):
            shown = [meaning[number, view] for view, p in self.oracle.followed[number].items() if p == part]
            shown = [thing for thing in shown if thing >= 0]
            if shown:
                things.setdefault(part, []).append(max(set(shown), key=shown.count))
        main = {part: max(set(found), key=found.count) for part, found in things.items()}
        assert len(set(main.values())) == len(main)  # and no two parts became one
        extra = sum(len(found) - 1 for found in things.values())
        joined = sum(found.count(main[part]) - 1 for part, found in things.items())
        return joined, extra


@pytest.fixture(scope="module")
def snowman():
    return Scenario("snowman", count=120, size_px=96)


# -------------------------------------------------------------------------------------------- the order of the views


def test_120_random_views_are_put_in_an_order_in_which_neighbours_look_alike(snowman):
    forward = np.array([camera.viewmat[2, :3] for camera in snowman.views.cameras])
    step_deg = np.degrees(np.arccos(np.clip((forward[1:] * forward[:-1]).sum(1), -1, 1)))
    assert step_deg.mean() < 17  # 120 views over 3/4 of the sphere lie about 15 deg apart
    assert step_deg.max() < 45
    shuffled = np.random.default_rng(0).permutation(forward)
    assert np.degrees(np.arccos((shuffled[1:] * shuffled[:-1]).sum(1).clip(-1, 1))).mean() > 60


def test_every_view_is_on_the_path_once_and_fewer_are_taken_evenly(snowman):
    assert sorted(smooth_path(snowman.views.cameras)) == list(range(120))
    assert len(on_path(snowman.views, 10)) == 10
    assert smooth_path(snowman.views.cameras[:2]).tolist() == [0, 1]


def test_key_views_begin_in_the_middle_and_spread():
    assert key_places(29, 4) == [14, 0, 28, 7]
    assert key_places(3, 8) == [1, 0, 2]


# ------------------------------------------------------------------------------------------------ masks of one view


def test_duplicates_specks_and_what_lies_outside_are_dropped():
    region = box(10, 10, 70, 50)
    masks = [box(10, 10, 40, 50), box(10, 10, 41, 50), box(45, 20, 70, 40), box(50, 30, 52, 32), box(0, 0, 12, 12)]
    found = chosen_proposals(masks, [0.9, 0.95, 0.8, 0.99, 0.7], region, choice=Choice(min_area=0.005))
    assert [(proposal.quality, int(proposal.mask.sum())) for proposal in found] == [(0.95, 31 * 40), (0.8, 25 * 20)]


def test_masks_that_lie_in_each_other_become_parts():
    whole, head, eye = box(10, 10, 70, 50), box(10, 10, 30, 50), box(14, 14, 22, 22)
    found = disjoint_parts([Proposal(m, 0.9) for m in (whole, head, eye)], whole, min_px=20)
    assert [int(mask.sum()) for mask in found] == [64, head.sum() - 64, whole.sum() - head.sum()]
    assert (np.sum(found, 0) <= 1).all()


def test_the_seam_that_is_left_of_a_whole_and_what_is_claimed_already_are_no_parts():
    whole, left, right = box(10, 10, 70, 50), box(10, 10, 39, 50), box(41, 10, 70, 50)
    assert len(disjoint_parts([Proposal(m, 0.9) for m in (whole, left, right)], whole, min_px=20)) == 2
    free = whole & ~left
    assert len(disjoint_parts([Proposal(left, 0.9)], free, min_px=20)) == 0


def test_prompts_lie_on_the_foreground_alone():
    region = box(10, 10, 70, 50)
    xy = Choice(points_per_side=8).grid(region)
    assert len(xy) and all(region[int(y), int(x)] for x, y in xy)


# ----------------------------------------------------------------------------------------- ids through all the views


class Moving:
    """A square that wanders to the right, and a bar that appears in view 3."""

    def __init__(self, *, tracks=True):
        self.tracks, self.calls = tracks, []
        self.square = [box(5 + 4 * v, 10, 25 + 4 * v, 30) for v in range(6)]
        self.bar = [box(10, 45, 70, 55) if v >= 3 else box(0, 0, 0, 0) for v in range(6)]
        self.foreground = np.array([a | b for a, b in zip(self.square, self.bar, strict=True)])

    def propose(self, view, region):
        masks = [m for m in (self.square[view] & region, self.bar[view] & region) if m.any()]
        return [Proposal(mask, 0.9) for mask in masks]

    def segment(self, view, *, points, box):
        raise AssertionError

    def track(self, view, masks):
        self.calls.append((view, len(masks)))
        for other in range(6):
            logits = []
            for mask in masks:
                is_bar = bool((mask & self.bar[view]).any())
                shown = (self.bar if is_bar else self.square)[other if self.tracks else view]
                logits.append(np.where(shown, 4.0, -4.0))
            yield other, np.array(logits, np.float32)


def test_late_things_get_new_ids_and_moved_things_move_their_masks():
    double = Moving()
    samples = [(np.array([20]), np.array([20]))] * 6
    tracks = follow_things(double, double.foreground, samples, keys=[0, 5, 3], progress=SILENT)
    assert double.calls == [(0, 1), (5, 1)]  # nothing is left for view 3
    assert [(labels == 0).sum() for labels in tracks.labels] == [400] * 6
    assert [(labels == 1).sum() for labels in tracks.labels] == [0, 0, 0, 600, 600, 600]
    columns = [np.flatnonzero((labels == 0).any(0))[0] for labels in tracks.labels]
    assert columns == [5, 9, 13, 17, 21, 25]
    assert tracks.claims[0][0] is not None and tracks.claims[1][0] is None


def test_what_no_id_claims_abstains():
    double = Moving(tracks=False)
    tracks = follow_things(double, double.foreground, [(np.array([0]), np.array([0]))] * 6, keys=[0], progress=SILENT)
    assert (tracks.labels[5][double.bar[5]] == -1).all()
    assert (tracks.labels[5][~double.foreground[5]] == -1).all()


# ------------------------------------------------------------------------------------------------- ids joined in 3D


def strip(claimed, shown):
    """Tracks over a row of 200 Gaussians; ``claimed[id][view]`` and ``shown[view]`` are ranges of them."""
    points = np.stack([np.linspace(0, 1, 200), *np.random.default_rng(0).normal(0, 0.005, (2, 200))], 1)
    seen = [np.arange(*view) for view in shown]
    claims = [
        [None if part is None else (s >= part[0]) & (s < part[1]) for part, s in zip(row, seen, strict=True)]
        for row in claimed
    ]
    lab = np.zeros((200, 3))
    return Tracks(np.zeros((len(shown), 1, 1), np.int16), claims), Surface(points, lab, seen)


def test_an_id_that_goes_over_to_another_thing_is_cut_and_the_pieces_find_their_own():
    a, b = (0, 100), (100, 200)
    tracks, surface = strip([[a, a, b, b], [b, b, a, a]], [(0, 200)] * 4)
    meaning = joined_ids(tracks, surface)
    assert meaning[0, 0] == meaning[0, 1] == meaning[1, 2] == meaning[1, 3]
    assert meaning[1, 0] == meaning[1, 1] == meaning[0, 2] == meaning[0, 3] != meaning[0, 0]


def test_a_thing_that_was_lost_and_found_again_is_one():
    a, b = (0, 100), (100, 200)
    tracks, surface = strip([[a, a, None, None], [None, None, a, a], [b, b, b, b]], [(0, 200)] * 4)
    meaning = joined_ids(tracks, surface)
    assert meaning[0, 0] == meaning[1, 3] != meaning[2, 0]
    assert meaning[0, 2] == -1


def test_a_part_of_a_thing_stays_apart_from_it():
    tracks, surface = strip([[(0, 30)] * 4, [(0, 200)] * 4], [(0, 200)] * 4)
    meaning = joined_ids(tracks, surface)
    assert meaning[0, 0] != meaning[1, 0]


def test_what_no_view_shows_together_is_joined_by_touch_and_colour():
    tracks, surface = strip([[(0, 100), None], [None, (100, 200)]], [(0, 100), (100, 200)])
    assert len(np.unique(joined_ids(tracks, surface)[[0, 1], [0, 1]])) == 1
    painted = Surface(surface.means, np.where(np.arange(200)[:, None] < 100, 0.0, 30.0) * np.ones(3), surface.seen)
    assert len(np.unique(joined_ids(tracks, painted)[[0, 1], [0, 1]])) == 2


# ------------------------------------------------------------------------------------------------------ whole objects


def test_planted_switches_late_things_and_wrong_pixels_leave_95_percent_right(snowman):
    parts, segments, meaning = snowman.parts()
    truth, oracle = snowman.object.labels, snowman.oracle
    assert oracle.switched > 0
    assert oracle.lost > 0
    assert parts.visible is not None
    assert accuracy(parts.labels, truth, parts.visible & (truth >= 0)) >= 0.95
    assert segments.claimed > 0.9
    assert parts.votes is not None
    assert parts.votes.shape == (len(truth), parts.count)
    joined, extra = snowman.merged_share(meaning)
    assert extra >= 5
    assert joined >= 0.9 * extra


def test_the_views_of_a_run_do_as_well():
    scenario = Scenario("hammer", count=29, size_px=96)
    parts, segments, _ = scenario.parts()
    truth = scenario.object.labels
    assert parts.visible is not None
    assert accuracy(parts.labels, truth, parts.visible & (truth >= 0)) >= 0.95
    assert segments.id_count >= parts.count


def test_finding_nothing_is_an_error_in_one_sentence(snowman):
    class Blind(Oracle):
        def propose(self, view, region):
            return []

    with pytest.raises(StageError, match="found no mask"):
        find_segments(snowman.object.gaussians, snowman.views, Blind(snowman.truth))


# ---------------------------------------------------------------------------------------------------- clicks and boxes


def test_what_is_clicked_on_or_boxed_becomes_a_part_of_its_own(snowman):
    truth, gaussians = snowman.object.labels, snowman.object.gaussians
    hat = snowman.object.part_names.index("hat")
    whole = Parts(np.zeros(len(truth), np.int32), ("thing",), "none")
    rows, columns = np.nonzero(snowman.truth[0] == hat)
    frame_box = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]) / 96
    middle = np.argmin(np.abs(rows - rows.mean()) + np.abs(columns - columns.mean()))
    clicked = gaussian_at(gaussians, snowman.views.cameras[0], columns[middle] + 0.5, rows[middle] + 0.5)
    for pointing in (Pointing(view=0, box=frame_box), Pointing(points=gaussians.means[[clicked]].astype(np.float64))):
        parts = cut_out_piece(
            whole, "thing", "hat", pointing,
            gaussians=gaussians, frame=snowman.frame, views=snowman.views,
            make_segmenter=lambda frames: Oracle(snowman.truth, wrong=0.0, switches=0.0, lose_below=0.0),
        )  # fmt: skip
        assert set(parts.names) == {"hat", "thing"}
        found = parts.labels == parts.names.index("hat")
        assert (found & (truth == hat)).sum() / (found | (truth == hat)).sum() > 0.85


def test_pointing_at_nothing_or_everything_is_said(snowman):
    whole = Parts(np.zeros(len(snowman.object.labels), np.int32), ("thing",), "none")

    class All(Oracle):
        def track(self, view, masks):
            for other in range(len(self.truth)):
                yield other, np.ones((1, *self.truth.shape[1:]), np.float32)

    def cut(pointing, name="thing", piece="hat", segmenter=All):
        cut_out_piece(
            whole, name, piece, pointing, gaussians=snowman.object.gaussians, frame=snowman.frame, views=snowman.views,
            make_segmenter=lambda frames: segmenter(snowman.truth),
        )  # fmt: skip

    with pytest.raises(StageError, match="holds all of 'thing'"):
        cut(Pointing(view=0, box=np.array([0.4, 0.4, 0.6, 0.6])))
    with pytest.raises(StageError, match="no view shows"):
        cut(Pointing(points=np.full((1, 3), 1e3)))
    with pytest.raises(StageError, match=r"no part 'thin'.*Did you mean 'thing'"):
        cut(Pointing(view=0, box=np.zeros(4)), name="thin")
    with pytest.raises(StageError, match="there is such a part"):
        cut(Pointing(view=0, box=np.zeros(4)), piece="thing")
