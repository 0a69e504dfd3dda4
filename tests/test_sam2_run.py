"""SAM2 in whole runs, on a tiny random checkpoint: which backend and why, kept masks, clicks and boxes, Ctrl-C."""

from __future__ import annotations

import re

import numpy as np
import pytest
from PIL import Image

from lollipop import lollipop
from phys4dgen.cli import main
from phys4dgen.errors import SceneError, StageError
from phys4dgen.formats import save_gaussians
from phys4dgen.progress import SilentProgress
from phys4dgen.run.artefacts import read_groups
from phys4dgen.run.folder import RunFolder
from phys4dgen.run.generate import continue_run, generate, scene_of_run
from phys4dgen.run.part_flags import Clicks
from phys4dgen.run.regroup import regroup
from phys4dgen.scene import PartEdit, Scene, load_scene
from phys4dgen.stages.segmentation import AUTO_LIMIT_S, decide
from tiny_checkpoints import tiny_sam2

pytest.importorskip("torch", reason="SAM2 needs torch: pip install 'phys4dgen[models]'")
pytest.importorskip("transformers", reason="SAM2 needs transformers: pip install 'phys4dgen[models]'")


class Listener(SilentProgress):
    """Remembers what is said; may interrupt."""

    def __init__(self, interrupt_at=None):
        self.notes, self.works, self.interrupt_at = [], [], interrupt_at

    def note(self, text):
        self.notes.append(text)

    def warn(self, text):
        self.notes.append(text)

    def update(self, done, total, text=""):
        self.works.append(text)
        if self.interrupt_at is not None and self.interrupt_at in text:
            raise KeyboardInterrupt

    def said(self, words):
        return any(words in note for note in self.notes)


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory):
    return tiny_sam2(tmp_path_factory.mktemp("sam2"), size=64)


@pytest.fixture(scope="module")
def scene(checkpoint, tmp_path_factory):
    path = tmp_path_factory.mktemp("input") / "lollipop.ply"
    save_gaussians(lollipop()[0], path)
    return Scene(input=path).with_overrides(
        {
            "up": "z",
            "height_m": 0.2,
            "views.size_px": 64,
            "grouping.sam2.weights": str(checkpoint),
            "grouping.sam2.views": 5,
            "grouping.sam2.key_views": 2,
            "grouping.sam2.points_per_side": 8,
        }
    )


@pytest.fixture(scope="module")
def run(scene, tmp_path_factory):
    """A finished run, and what was said in it."""
    listener = Listener()
    folder = tmp_path_factory.mktemp("runs") / "run"
    return generate(scene, folder, until="grouping", progress=listener), listener


# ------------------------------------------------------------------------------------------------ which backend, why


def test_auto_takes_sam2_where_its_weights_are_and_it_is_quick(run):
    made, listener = run
    assert made.report["backends"]["grouping"].startswith("sam2 (")
    assert any(
        re.fullmatch(r"Parts by SAM2: its weights are here and about \d+ s are predicted\.", note)
        for note in made.report["notes"]
    )
    assert {"views encoded", "key views searched for parts"} <= set(listener.works)
    assert any("views followed for" in work for work in listener.works)
    assert (made.root / "segments/sam2.npz").is_file()
    parts = read_groups(RunFolder(made.root))
    assert parts.votes is not None


def test_auto_leaves_it_where_it_would_take_long_unless_it_is_asked_for(scene, monkeypatch):
    monkeypatch.setattr("phys4dgen.grouping.sam2.cost.Cost.total_s", lambda *_: AUTO_LIMIT_S + 300)
    left = decide(scene, 29)
    assert left.folder is None
    assert left.why == "it would take about 8 min on this cpu; --grouping.backend sam2 asks for it"
    asked = decide(scene.with_overrides({"grouping.backend": "sam2"}), 29)
    assert asked.folder is not None
    assert asked.why == "it was asked for"


def test_auto_leaves_it_where_a_number_of_parts_is_given_or_the_weights_are_absent(scene, monkeypatch, tmp_path):
    assert "a number of parts is given" in decide(scene.with_overrides({"grouping.parts": 2}), 29).why
    monkeypatch.setenv("HF_HUB_CACHE", str(tmp_path))
    absent = {"grouping.sam2.weights": "nobody/nothing"}
    assert "'hf download nobody/nothing' gets them" in decide(scene.with_overrides(absent), 29).why
    with pytest.raises(StageError, match="never fetched unasked"):
        decide(scene.with_overrides({**absent, "grouping.backend": "sam2"}), 29)


def test_relative_weights_are_taken_from_the_folder_of_the_scene(checkpoint, tmp_path):
    (tmp_path / "weights").symlink_to(checkpoint)
    (tmp_path / "scene.yaml").write_text("input: a.ply\ngrouping: {sam2: {weights: weights}}\n")
    assert load_scene(tmp_path / "scene.yaml").grouping.sam2.weights == (tmp_path / "weights").as_posix()
    (tmp_path / "scene.yaml").write_text("input: a.ply\ngrouping: {sam2: {weights: facebook/sam2.1-hiera-small}}\n")
    assert load_scene(tmp_path / "scene.yaml").grouping.sam2.weights == "facebook/sam2.1-hiera-small"


def test_a_number_of_parts_and_sam2_by_name_contradict_each_other():
    with pytest.raises(SceneError, match="parts is a choice of the appearance backend"):
        Scene(input="a.ply").with_overrides({"grouping.backend": "sam2", "grouping.parts": 3})


# ------------------------------------------------------------------------------------------- edits, clicks and boxes


def test_an_edit_uses_the_masks_of_the_last_time(run):
    made, _ = run
    listener = Listener()
    before = read_groups(RunFolder(made.root))
    regroup(made.root, [("rename", "0=foot")], progress=listener)
    assert listener.said("The masks of SAM2 are those of the last time")
    assert "views encoded" not in listener.works
    after = read_groups(RunFolder(made.root))
    np.testing.assert_array_equal(before.labels, after.labels)
    assert after.names[0] == "foot"
    regroup(made.root, undo=True)


def test_split_at_a_place_asks_sam2_and_keeps_where_it_was(run, scene):
    made, _ = run
    folder = RunFolder(made.root)
    clicks = Clicks(folder, scene_of_run(made.root))
    assert clicks.front_view() == "view_08"  # azimuth 0, 10 deg above the horizon
    labels = np.array(Image.open(made.root / "views/view_08_parts.png")).astype(int) - 1
    number = np.bincount(labels[labels >= 0]).argmax()
    rows, columns = np.nonzero(labels == number)
    name = read_groups(folder).names[number]
    corners = (columns.min(), rows.min(), (columns.min() + columns.max()) // 2, rows.max() + 1)
    try:
        regroup(made.root, [("split", f"{name}@{','.join(map(str, corners))}=piece")])
    except StageError as error:  # what random weights find may be all or nothing of the part, and that is said
        assert "SAM2" in str(error)
        return
    edit = scene_of_run(made.root).grouping.edits[-1]
    assert (edit.split, edit.by, edit.boxes["piece"].view) == (name, "sam2", "view_08")
    np.testing.assert_allclose(edit.boxes["piece"].corners, np.array(corners) / 64)
    assert set(read_groups(folder).names) >= {name, "piece"}
    regroup(made.root, undo=True)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("part_0@1", "expected NAME@X,Y or NAME@LEFT,TOP,RIGHT,BOTTOM in pixels of view_08"),
        ("part_0@a,b", "expected NAME@X,Y"),
        ("part_0@30,30,20,40", "expected a box inside the 64 x 64 px of view_08"),
        ("part_0@view_99,1,2", "there is no view 'view_99'"),
        ("part_0@1,1", "beside the object"),
        ("nothing@1,1", "no part 'nothing'"),
    ],
)
def test_a_place_that_makes_no_sense_is_one_sentence(run, text, says):
    made, _ = run
    before = scene_of_run(made.root)
    with pytest.raises((SceneError, StageError), match=says):
        regroup(made.root, [("split", text)])
    assert scene_of_run(made.root) == before


def test_edits_by_sam2_in_a_scene():
    box = {"view": "view_08", "corners": [0.1, 0.2, 0.5, 0.6]}
    edit = PartEdit.model_validate({"split": "pot", "boxes": {"lid": box}, "by": "sam2"})
    assert edit.pieces_of == ("lid", "pot")
    assert PartEdit.model_validate(edit.model_dump()) == edit
    for wrong in (
        {"split": "pot", "boxes": {"lid": box}},
        {"split": "pot", "boxes": {"lid": {**box, "corners": [0.5, 0.2, 0.1, 0.6]}}, "by": "sam2"},
        {"split": "pot", "pieces": 2, "by": "sam2"},
        {"boxes": {"lid": box}, "by": "sam2"},
    ):
        with pytest.raises(ValueError):
            PartEdit.model_validate(wrong)


# ------------------------------------------------------------------------------------------------------------ Ctrl-C


@pytest.mark.parametrize("work", ["views encoded", "views followed"])
def test_ctrl_c_in_the_middle_leaves_a_run_that_goes_on(scene, tmp_path, work):
    with pytest.raises(KeyboardInterrupt):
        generate(scene, tmp_path / "run", until="grouping", progress=Listener(interrupt_at=work))
    assert not (tmp_path / "run/segments/sam2.npz").exists()
    assert not (tmp_path / "run/groups.npz").exists()
    made = continue_run(tmp_path / "run", since="grouping", until="grouping")
    assert made.report["backends"]["grouping"].startswith("sam2 (")
    assert made.report["reused"] == ["reconstruct", "views"]


def test_the_command_line_says_that_weights_are_absent(scene, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("HF_HUB_CACHE", str(tmp_path))
    words = ["generate", str(scene.input), "-o", str(tmp_path / "run"), "--until", "grouping", "--up", "z", "-q"]
    assert main([*words, "--views.size-px", "64", "--grouping.backend", "sam2"]) == 1
    assert "'hf download facebook/sam2.1-hiera-tiny' gets them" in capsys.readouterr().err
