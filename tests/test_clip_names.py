"""Names from a picture to parts, and materials by CLIP: the stand-in on bundled objects, CLIP on a tiny checkpoint."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from phys4dgen.clip import ClipEncoder, masked_sub_image
from phys4dgen.errors import FormatError, SceneError, StageError
from phys4dgen.grouping.correspondence import NamedSegments, name_parts_by_picture, read_segments
from phys4dgen.grouping.correspondence.assignment import best_matches
from phys4dgen.materials import library_entries, material
from phys4dgen.materials.clip_names import identify_by_clip
from phys4dgen.render.cameras import orbit_camera, view_cameras
from phys4dgen.render.views import render_gaussians, render_views
from phys4dgen.scene import Scene
from phys4dgen.types import MaterialBook, PartMaterials, rotation_to_z_up
from phys4dgen.weights import weights_folder
from phys4dgen.zoo.catalogue import bundled
from sam2_oracle import true_maps
from tiny_checkpoints import tiny_clip


@pytest.fixture(scope="module")
def encoder(tmp_path_factory):
    pytest.importorskip("torch", reason="CLIP needs torch: pip install 'phys4dgen[models]'")
    pytest.importorskip("transformers", reason="CLIP needs transformers: pip install 'phys4dgen[models]'")
    return ClipEncoder(tiny_clip(tmp_path_factory.mktemp("clip")), name="tiny")


def eight_bit(rgb):
    return np.rint(np.clip(rgb, 0, 1) * 255).astype(np.uint8)


class Correspondence:
    """Views of an object, and a picture of it in other light from elsewhere, with its segments."""

    def __init__(self, name, light, azimuth_deg, elevation_deg):
        studio, other = bundled(name), bundled(name, light=light)
        rotation = rotation_to_z_up(studio.up)
        lower, upper = studio.gaussians.robust_bounds(rotation=rotation)
        cameras = view_cameras("object", lower=lower, upper=upper, rotation=rotation, size_px=96)[8:16]
        self.views = list(eight_bit(render_views(studio.gaussians, cameras).rgb))
        self.part_maps = list(true_maps(studio.gaussians, studio.labels, cameras))
        camera = orbit_camera(
            azimuth_deg=azimuth_deg, elevation_deg=elevation_deg, target=(lower + upper) / 2 @ rotation,
            rotation=rotation, radius=1.2 * float(np.linalg.norm(upper - lower)), fovy_deg=49.1, width=120, height=120,
        )  # fmt: skip
        picture = eight_bit(render_gaussians(other.gaussians, camera).rgb)
        segments = true_maps(other.gaussians, other.labels, [camera])[0]
        numbers, counts = np.unique(segments[segments >= 0], return_counts=True)
        self.names = {int(n): studio.part_names[n] for n in numbers[counts >= 0.004 * counts.sum()]}
        self.part_names = studio.part_names
        # The numbers on the picture are the user's own.
        own = np.where(segments >= 0, 10 * segments + 3, -1).astype(np.int32)
        self.named = NamedSegments(picture, own, {10 * n + 3: name for n, name in self.names.items()})


@pytest.fixture(scope="module")
def flower():
    return Correspondence("potted_flower", "backlit", 18.0, 26.0)


@pytest.mark.parametrize(
    ("name", "light", "azimuth_deg", "elevation_deg"),
    [("snowman", "evening", -20.0, 0.0), ("hamburger", "overcast", 20.0, 28.0), ("telephone", "backlit", 12.0, -10.0)],
)
def test_names_reach_the_right_parts_in_other_light_and_from_elsewhere(name, light, azimuth_deg, elevation_deg):
    case = Correspondence(name, light, azimuth_deg, elevation_deg)
    found, _ = name_parts_by_picture(case.named, case.views, case.part_maps)
    right = [naming.part is not None and case.part_names[naming.part] == naming.name for naming in found]
    assert np.mean(right) >= 0.9
    assert all(naming.margin > 0 for naming in found)


def test_a_name_whose_segment_looks_like_nothing_is_left_over(flower):
    rgb, segments = flower.named.rgb.copy(), flower.named.segments.copy()
    segments[:, :4], rgb[:, :4] = 99, (255, 0, 255)
    named = NamedSegments(rgb, segments, {**flower.named.names, 99: "curtain"})
    found, _ = name_parts_by_picture(named, flower.views, flower.part_maps)
    assert found[-1].name == "curtain"
    assert found[-1].part is None
    assert all(naming.part is not None for naming in found[:-1])


def test_a_named_segment_without_pixels_is_an_error(flower):
    named = NamedSegments(flower.named.rgb, flower.named.segments, {77: "pot"})
    with pytest.raises(StageError, match=r"segment 77 \('pot'\) has no pixel"):
        name_parts_by_picture(named, flower.views, flower.part_maps)


def test_assignment_takes_the_best_for_all_and_respects_the_floor():
    similarity = np.array([[0.9, 0.8], [0.85, 0.1]])
    matches = best_matches(similarity, floor=0.2)  # the greedy choice, 0.9, would leave 0.1 for the second row
    assert [(match.row, match.column) for match in matches] == [(0, 1), (1, 0)]
    assert matches[1].margin == pytest.approx(0.75)
    assert matches[0].margin == pytest.approx(-0.1)
    assert [(m.row, m.column) for m in best_matches(np.array([[0.9, 0.8], [0.1, 0.1]]), floor=0.2)] == [(0, 0)]
    assert best_matches(np.array([[0.7]]), floor=0.2)[0].margin == 1


def test_segments_are_read_at_the_size_of_their_picture(tmp_path):
    values = np.zeros((40, 60), np.uint8)
    values[10:20, 30:] = 7
    Image.fromarray(values).save(tmp_path / "s.png")
    found = read_segments(tmp_path / "s.png", 20, 30)
    assert np.unique(found).tolist() == [-1, 7]
    assert (found[5:10, 15:] == 7).all()
    with pytest.raises(FormatError, match="shape of their picture"):
        read_segments(tmp_path / "s.png", 30, 30)
    Image.fromarray(np.zeros((4, 4, 3), np.uint8)).save(tmp_path / "rgb.png")
    with pytest.raises(FormatError, match="grey or indexed"):
        read_segments(tmp_path / "rgb.png", 4, 4)


def test_a_sub_image_holds_the_segment_alone_in_a_square():
    rgb = np.full((50, 80, 3), 200, np.uint8)
    mask = np.zeros((50, 80), np.bool_)
    mask[10:20, 5:45] = True
    square = masked_sub_image(rgb, mask)
    assert square.shape[0] == square.shape[1] >= 44
    assert (square == 200).all(-1).sum() == mask.sum()
    assert (square[0] == 128).all()


# ------------------------------------------------------------------------------------------------------------ CLIP


def test_embeddings_are_unit_vectors_that_depend_on_what_is_shown(encoder):
    rng = np.random.default_rng(0)
    pictures = [rng.integers(0, 256, (40, 30, 3), np.uint8), np.full((64, 64, 3), 250, np.uint8)]
    found = encoder.pictures([*pictures, pictures[0]])
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, atol=1e-5)
    np.testing.assert_allclose(found[0], found[2], atol=1e-5)
    assert found[0] @ found[1] < 0.999
    sentences = encoder.sentences(["a photo of rubber", "wood", "x " * 200])
    assert sentences.shape == (3, found.shape[1])
    assert sentences[0] @ sentences[1] < 0.999
    assert 0 < encoder.temperature < 1


def test_names_by_clip_run_on_the_tiny_checkpoint(encoder, flower):
    same = NamedSegments(flower.views[0], flower.part_maps[0], {int(n): f"p{n}" for n in range(6)})
    same = NamedSegments(same.rgb, same.segments, {n: s for n, s in same.names.items() if (same.segments == n).any()})
    found, view = name_parts_by_picture(same, flower.views, flower.part_maps, encoder=encoder)
    assert view == 0  # the picture itself
    assert [naming.part for naming in found] == list(same.names)
    assert all(naming.similarity == pytest.approx(1, abs=1e-4) for naming in found)


def test_materials_by_clip_are_of_the_library_with_how_sure_it_is(encoder):
    rules = MaterialBook({name: PartMaterials(material("felt"), material("felt")) for name in ("pot", "leaf", "heart")})
    rng = np.random.default_rng(0)
    pictures = {0: rng.integers(0, 256, (40, 40, 3), np.uint8), 1: np.full((30, 50, 3), (30, 160, 40), np.uint8)}
    book = identify_by_clip(("pot", "leaf", "heart"), rules, pictures, encoder)
    for name in ("pot", "leaf"):
        surface = book.parts[name].surface
        assert surface.source == "clip"
        assert surface.name in library_entries()
        assert surface.evidence.startswith(f"tiny: {surface.name} 0.")
        assert book.parts[name].interior == surface
    assert book.parts["heart"].surface.name == "felt"
    assert "no view shows enough" in book.parts["heart"].surface.warnings[0]


# -------------------------------------------------------------------------------------------- weights and settings


def test_absent_weights_are_said_with_the_command_that_gets_them(tmp_path, monkeypatch):
    pytest.importorskip("transformers", reason="weights are looked for only where transformers is")
    monkeypatch.setenv("HF_HUB_CACHE", str(tmp_path))
    with pytest.raises(StageError, match=r"never fetched unasked; 'hf download nobody/nothing' gets them"):
        weights_folder("nobody/nothing", model="CLIP")
    with pytest.raises(StageError, match=r"expected config\.json"):
        weights_folder(str(tmp_path), model="CLIP")


def test_absent_packages_are_said_with_the_extra(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(StageError, match=r"CLIP needs torch and transformers.*pip install 'phys4dgen\[models\]'"):
        weights_folder("openai/clip-vit-base-patch16", model="CLIP")


def test_a_folder_with_another_model_is_refused(encoder, tmp_path):
    (tmp_path / "config.json").write_text('{"model_type": "bert"}')
    (tmp_path / "model.safetensors").write_bytes(b"x" * 100)
    with pytest.raises(StageError, match=r"expected a checkpoint of model_type clip .* got bert"):
        ClipEncoder(tmp_path, name="other")
    (tmp_path / "config.json").write_text('{"model_type": "clip"}')
    with pytest.raises(StageError, match="cannot be read"):
        ClipEncoder(tmp_path, name="other")


def test_a_named_picture_in_a_scene():
    picture = {"picture": "a.png", "segments": "s.png", "names": {1: "pot", 2: "leaves"}}
    scene = Scene(input="a.ply").with_overrides({"grouping.named_picture": picture})
    assert scene.grouping.named_picture is not None
    assert scene.grouping.named_picture.compare == "auto"
    with pytest.raises(SceneError, match="own name"):
        Scene(input="a.ply").with_overrides({"grouping.named_picture": {**picture, "names": {1: "pot", 2: "pot"}}})
