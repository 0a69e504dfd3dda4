"""SAM2's real code path on a tiny random checkpoint: no network, no torchvision, and every trap of its API."""

from __future__ import annotations

import importlib.util
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from phys4dgen.errors import StageError
from phys4dgen.grouping.sam2.cost import predicted_cost
from phys4dgen.grouping.sam2.proposals import Choice
from phys4dgen.grouping.sam2.tracks import follow_things
from phys4dgen.progress import SILENT
from tiny_checkpoints import tiny_sam2

torch = pytest.importorskip("torch", reason="SAM2 needs torch: pip install 'phys4dgen[models]'")
pytest.importorskip("transformers", reason="SAM2 needs transformers: pip install 'phys4dgen[models]'")

from phys4dgen.grouping.sam2.network import Sam2Network, Sam2Segmenter  # noqa: E402  needs torch
from phys4dgen.grouping.sam2.preprocess import network_mask, network_picture  # noqa: E402

REFERENCE = Path(__file__).parent / "data" / "sam2_reference.npz"
V, SIZE = 6, 96


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory):
    return tiny_sam2(tmp_path_factory.mktemp("sam2"))


@pytest.fixture(scope="module")
def network(checkpoint):
    return Sam2Network(checkpoint)


def scene(*, moves=True):
    """A red disc that wanders to the right, a blue box, and a green disc from view 3 on."""
    y, x = np.mgrid[:SIZE, :SIZE]
    frames = np.full((V, SIZE, SIZE, 3), 255, np.uint8)
    masks = np.zeros((3, V, SIZE, SIZE), np.bool_)
    for v in range(V):
        masks[0, v] = (x - 26 - (5 * v if moves else 0)) ** 2 + (y - 40) ** 2 < 15**2
        masks[1, v] = (abs(x - 70) < 12) & (abs(y - 60) < 20) & ~masks[0, v]
        if v >= 3:
            masks[2, v] = (x - 30) ** 2 + (y - 80) ** 2 < 100
        for mask, color in zip(masks[:, v], ((200, 30, 30), (30, 60, 200), (40, 180, 40)), strict=True):
            frames[v][mask] = color
    return frames, masks


@pytest.fixture(scope="module")
def moving(network):
    frames, masks = scene()
    return Sam2Segmenter(network, frames), frames, masks


@pytest.fixture(scope="module")
def followed(moving):
    """Logits of two objects by view, followed both ways from view 2."""
    segmenter, _, masks = moving
    return dict(segmenter.track(2, [masks[0, 2], masks[1, 2]]))


# --------------------------------------------------------------------------------------------------- preprocessing


def test_pictures_and_masks_are_prepared_as_by_the_official_processor():
    with np.load(REFERENCE) as reference:
        pixels = network_picture(reference["rgb"], reference["pixels"].shape[-1])[0].numpy()
        one_grey_level = 1 / 255 / 0.224
        assert np.abs(pixels - reference["pixels"].astype(np.float32)).max() < 1.1 * one_grey_level
        assert (
            np.abs(pixels - reference["pixels"].astype(np.float32)).mean() < 0.2 * one_grey_level
        )  # it rounds halves otherwise
        prompt = network_mask(reference["mask"], reference["prompt"].shape[-1])[0, 0].numpy() > 0
        np.testing.assert_array_equal(prompt, reference["prompt"])


def test_torchvision_is_not_needed():
    if importlib.util.find_spec("torchvision") is not None:
        pytest.skip("torchvision is installed here")
    assert network_picture(np.zeros((8, 8, 3), np.uint8), 16).shape == (1, 3, 16, 16)


# -------------------------------------------------------------------------------------------------------- tracking


def test_every_view_is_followed_and_its_logits_vary(followed):
    assert sorted(followed) == list(range(V))
    tracked = np.array([followed[v] for v in (0, 1, 3, 4, 5)])
    assert tracked.shape == (5, 2, SIZE, SIZE)
    assert tracked.std(axis=(2, 3)).min() > 0.5  # an untrained head says -1024 everywhere
    assert np.abs(np.diff(tracked, axis=0)).mean() > 0.05


def test_the_view_of_the_prompt_gives_the_prompt_back(followed, moving):
    masks = moving[2]
    for number in range(2):
        found = followed[2][number] > 0
        assert (found & masks[number, 2]).sum() / (found | masks[number, 2]).sum() > 0.9


def test_a_moved_object_moves_its_mask(network, moving, followed):
    frames, masks = scene(moves=False)
    resting = dict(Sam2Segmenter(network, frames).track(2, [masks[0, 2], masks[1, 2]]))
    frames_moved = moving[1]
    np.testing.assert_array_equal(frames[0] != frames_moved[0], False)  # where it starts, both are alike
    for view in (3, 4, 5):
        assert np.abs(resting[view][0] - followed[view][0]).max() > 0.5


def test_objects_do_not_depend_on_each_other_nor_on_their_list(moving, followed):
    segmenter, _, masks = moving
    alone = dict(segmenter.track(2, [masks[1, 2]]))
    for view in range(V):
        np.testing.assert_allclose(alone[view][0], followed[view][1], rtol=1e-4, atol=1e-3)


def test_shared_features_and_dropped_memories_equal_stock_tracking_to_1e_5(network, moving, followed):
    from transformers.models.sam2_video.modeling_sam2_video import Sam2VideoInferenceSession

    _, frames, masks = moving
    pixels = torch.cat([network_picture(frame, network.size) for frame in frames])
    stock = Sam2VideoInferenceSession(video=pixels, video_height=SIZE, video_width=SIZE, dtype=torch.float32)
    for number in range(2):
        stock.add_mask_inputs(stock.obj_id_to_idx(number), 2, network_mask(masks[number, 2], network.size))
    stock.obj_with_new_inputs = [0, 1]
    network.model(stock, frame_idx=2)
    compared = 0
    for reverse in (False, True):
        for out in network.model.propagate_in_video_iterator(stock, start_frame_idx=2, reverse=reverse):
            large = torch.nn.functional.interpolate(out.pred_masks, (SIZE, SIZE), mode="bilinear", align_corners=False)
            assert float(out.object_score_logits.min()) > 0
            np.testing.assert_allclose(followed[out.frame_idx], large[:, 0].numpy(), atol=1e-5 * large.abs().max())
            compared += 1
    assert compared == V + 1  # the view of the prompt comes twice


def test_memories_that_no_step_reads_are_dropped(network, moving):
    segmenter, _, masks = moving
    sessions = []
    make = segmenter._session
    segmenter._session = lambda: sessions.append(make()) or sessions[-1]
    reach = network.model.config.max_object_pointers_in_encoder
    try:
        network.model.config.max_object_pointers_in_encoder = 1
        list(segmenter.track(0, [masks[0, 0]]))
    finally:
        network.model.config.max_object_pointers_in_encoder = reach
        del segmenter._session
    kept = sessions[0].output_dict_per_obj[0]["non_cond_frame_outputs"]
    assert sorted(kept) == [1, 4, 5]
    assert not any("high_res_masks" in output for output in kept.values())


# -------------------------------------------------------------------------------------------- masks, prompts, ids


def test_automatic_masks_lie_in_the_region_and_come_best_first(moving):
    segmenter, _, masks = moving
    region = masks[:2, 0].any(0)
    found = segmenter.propose(0, region)
    assert found
    assert all((proposal.mask & ~region).sum() == 0 for proposal in found)
    assert all(a.quality >= b.quality for a, b in pairwise(found))


def test_clicks_and_boxes_give_different_masks(moving):
    segmenter = moving[0]
    one = segmenter.segment(0, points=np.array([[26.0, 40.0]]), box=None).mask
    several = segmenter.segment(0, points=np.array([[26.0, 40.0], [70.0, 60.0], [60.0, 50.0]]), box=None).mask
    boxed = segmenter.segment(0, points=None, box=np.array([10.0, 25.0, 42.0, 56.0])).mask
    assert one.shape == (SIZE, SIZE)
    assert (one != several).any()
    assert (one != boxed).any()


def test_late_objects_get_new_ids_and_every_view_is_encoded_once(network, monkeypatch):
    frames, masks = scene()
    calls, model = [], network.model
    stock = model.get_image_features
    monkeypatch.setattr(model, "get_image_features", lambda *a, **k: calls.append(1) or stock(*a, **k))
    segmenter = Sam2Segmenter(network, frames, choice=Choice(points_per_side=8))
    starts, track = [], segmenter.track
    monkeypatch.setattr(segmenter, "track", lambda view, found: starts.append((view, len(found))) or track(view, found))
    samples = [(np.array([40]), np.array([26]))] * V
    tracks = follow_things(segmenter, masks.any(0), samples, keys=[0, 5], progress=SILENT)
    assert len(calls) == V
    assert [view for view, _ in starts] == [0, 5]
    assert len(tracks.claims) == sum(count for _, count in starts)
    first_ids = starts[0][1]
    assert (tracks.labels[5] >= first_ids).any()
    assert all(row[5] is not None for row in tracks.claims[first_ids:])


def test_ctrl_c_stops_in_the_middle_and_nothing_is_left_behind(network):
    frames, masks = scene()

    def interrupt(done):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Sam2Segmenter(network, frames, on_view=interrupt)
    assert not torch.is_inference_mode_enabled()
    segmenter = Sam2Segmenter(network, frames[:3])
    steps = segmenter.track(0, [masks[0, 0]])
    next(steps)
    steps.close()
    assert len(dict(segmenter.track(0, [masks[0, 0]]))) == 3  # a new session starts clean


# ---------------------------------------------------------------------------------------------- checkpoints, cost


def test_checkpoints_of_others_and_broken_ones_are_refused(checkpoint, tmp_path):
    (tmp_path / "config.json").write_text('{"model_type": "sam2"}')
    with pytest.raises(StageError, match="expected a checkpoint of model_type sam2_video"):
        predicted_cost(tmp_path, "cpu")
    (tmp_path / "config.json").write_bytes((checkpoint / "config.json").read_bytes())
    (tmp_path / "model.safetensors").write_bytes(b"\0" * 64)
    with pytest.raises(StageError, match="cannot be read"):
        Sam2Network(tmp_path)


def test_weights_that_are_missing_are_not_made_up(checkpoint, tmp_path):
    from safetensors.torch import load_file, save_file

    weights = load_file(checkpoint / "model.safetensors")
    weights.pop("no_memory_embedding")
    (tmp_path / "config.json").write_bytes((checkpoint / "config.json").read_bytes())
    save_file(weights, tmp_path / "model.safetensors", metadata={"format": "pt"})
    with pytest.raises(StageError, match="lacks 1 weights, the first of them no_memory_embedding"):
        Sam2Network(tmp_path)


def test_larger_checkpoints_and_more_views_cost_more(checkpoint, tmp_path):
    small = predicted_cost(checkpoint, "cpu")
    config = (checkpoint / "config.json").read_text()
    (tmp_path / "config.json").write_text(config.replace('"image_size": 128', '"image_size": 1024'))
    large = predicted_cost(tmp_path, "cpu")
    assert large.view_s > small.view_s > 0
    assert large.total_s(120, 16) > large.total_s(29, 16) > predicted_cost(tmp_path, "cuda").total_s(29, 16)
