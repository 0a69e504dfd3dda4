"""``group RUN`` on parts by appearance: another number from the kept tree, splits and clicks, undo, and what fails."""

import re

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

import phys4dgen.stages.grouping as stage
from grouping_objects import potted_plant, shaded_ball
from phys4dgen.cli import main
from phys4dgen.formats import load_gaussians, save_gaussians
from phys4dgen.grouping.label_maps import read_cameras
from phys4dgen.render.views import render_labels
from phys4dgen.run.artefacts import read_groups
from phys4dgen.run.folder import RunFolder
from phys4dgen.run.generate import continue_run, generate, scene_of_run
from phys4dgen.run.regroup import regroup
from phys4dgen.scene import Scene

TRUTH = potted_plant()[1]
SETTINGS = {"up": "z", "height_m": 0.3, "views.size_px": 96, "simulation.grid": 16}
FROM_ABOVE = "view_24"
CURE = "The parts are uncertain"


def started(folder, gaussians=None, **settings):
    save_gaussians(potted_plant()[0] if gaussians is None else gaussians, folder / "plant.ply")
    scene = Scene(input=folder / "plant.ply").with_overrides({**SETTINGS, **settings})
    return generate(scene, folder / "run", until="grouping")


@pytest.fixture
def run(tmp_path):
    return started(tmp_path)


def groups(root):
    with np.load(root / "groups.npz") as arrays:
        return dict(arrays)


def click(root, part):
    """VIEW,X,Y well inside what a true part shows from above."""
    camera = read_cameras(root / "views/cameras.json")[FROM_ABOVE]
    shown = render_labels(load_gaussians(root.parent / "plant.ply"), TRUTH, camera) == part
    y_px, x_px = np.unravel_index(int(np.asarray(distance_transform_edt(shown)).argmax()), shown.shape)
    return f"{FROM_ABOVE},{x_px},{y_px}"


def test_another_number_of_parts_comes_from_the_kept_tree(run, tmp_path, monkeypatch):
    (tmp_path / "new").mkdir()
    new = started(tmp_path / "new", **{"grouping.parts": 2})

    def refuse(*_args, **_named):
        raise AssertionError("the parts were searched anew")

    monkeypatch.setattr(stage, "appearance_tree", refuse)
    assert main(["group", str(run.root), "--parts", "2", "-q"]) == 0
    expected = groups(new.root)
    for name, array in groups(run.root).items():
        np.testing.assert_array_equal(array, expected[name])
    assert expected["visible"].mean() > 0.5


def test_a_tree_that_does_not_hold_is_made_again(run, monkeypatch):
    made = []
    find = stage.appearance_tree
    monkeypatch.setattr(stage, "appearance_tree", lambda *args, **named: made.append(1) or find(*args, **named))
    regroup(run.root, parts=2)
    assert not made
    (run.root / "groups_tree.npz").write_bytes(b"PK damaged")
    regroup(run.root, parts=3)
    assert len(made) == 1
    turned = scene_of_run(run.root).with_overrides({"up": "y"})
    continue_run(run.root, turned, since="views", until="grouping")
    assert len(made) == 2


def test_a_split_is_remembered_and_taken_back(run):
    regroup(run.root, parts=2)
    before = groups(run.root)
    scene = scene_of_run(run.root)
    force = {"value_ms2": (1.0, 0.0, 0.0), "to_s": 0.1, "part": "part_0"}
    scene = scene.with_overrides({"parts.part_0.hold": "fixed", "forces": (force,)})
    continue_run(run.root, scene, since="grouping", until="grouping")
    assert main(["group", str(run.root), "--split", "0", "--rename", "part_0_1=pot", "-q"]) == 0
    scene = scene_of_run(run.root)
    assert [edit.model_dump() for edit in scene.grouping.edits] == [
        {"split": "part_0", "pieces": 2},
        {"rename": "part_0_1", "to": "pot"},
    ]
    assert set(scene.parts) == {"pot", "part_0_2"}
    assert {options.hold for options in scene.parts.values()} == {"fixed"}
    assert [force.part for force in scene.forces] == ["pot", "part_0_2"]
    assert (groups(run.root)["labels"] == TRUTH).mean() > 0.93
    later = continue_run(run.root, since="simulate", until="materials")
    assert later.report["reused"] == ["reconstruct", "views", "grouping"]
    regroup(run.root, undo=True)
    regroup(run.root, undo=True)
    for name, array in groups(run.root).items():
        np.testing.assert_array_equal(array, before[name])
    scene = scene_of_run(run.root)
    assert list(scene.parts) == [force.part for force in scene.forces] == ["part_0"]


def test_clicks_give_the_parts_that_they_point_at(run):
    before = groups(run.root)
    words = [f"leaves@{click(run.root, 2)}", f"pot@{click(run.root, 0)}", f"soil@{click(run.root, 1)}"]
    assert main(["group", str(run.root), *(w for word in words for w in ("--seed", word)), "-q"]) == 0
    parts = read_groups(RunFolder(run.root))
    assert parts.names == ("pot", "soil", "leaves")
    assert (parts.labels == TRUTH).mean() > 0.93
    # a second click of one part, views by number
    first = click(run.root, 0).replace(FROM_ABOVE, FROM_ABOVE[-2:])
    regroup(run.root, [("seed", f"rest@{first}"), ("seed", f"rest@{click(run.root, 1)}"), ("seed", words[0])])
    assert read_groups(RunFolder(run.root)).names == ("rest", "leaves")
    # and clicks that divide one part
    regroup(run.root, [("split", "rest"), ("seed", words[2])])
    parts = read_groups(RunFolder(run.root))
    assert parts.names == ("rest", "soil", "leaves")
    assert (parts.labels == TRUTH).mean() > 0.93
    for _ in range(3):
        regroup(run.root, undo=True)
    np.testing.assert_array_equal(groups(run.root)["labels"], before["labels"])
    np.testing.assert_array_equal(groups(run.root)["names"], before["names"])


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (["--seed", "a@view_99,1,1"], "there is no view 'view_99'; the views are view_00 to view_28, or 0 to 28"),
        (["--seed", "a@29,1,1"], "there is no view '29'"),
        (["--seed", "a@0,96,1"], "the click at 96, 1 lies outside the view of 96 x 96 px"),
        (["--seed", "a@0,nan,1"], "lies outside the view"),
        (["--seed", "a@0,1,1"], "the click at 1, 1 is beside the object"),
        (["--seed", "a@POT"], "one part alone was clicked on, 'a'"),
        (["--seed", "a@POT", "--seed", "b@POT"], "the clicks for 'a' and 'b' fall on one spot"),
        (["--split", "stem"], "--split: there is no part 'stem'; the parts are 0 part_0"),
        (["--split", "0=2", "--seed", "a@POT"], "got '0=2' and clicks"),
        (["--split", "2", "--seed", "a@POT"], "the click for 'a' falls on another part than 'part_2'"),
        (["--split", "0", "--seed", "part_0@POT"], "needs another name for the piece"),
        (["--split", "0", "--seed", "part_1@POT"], "cannot be called 'part_1': there is such a part"),
        (["--split", "1=20"], "'part_1' holds only [0-9]+ of 20 pieces"),
        (["--split", "0", "--rename", "1=soil"], "a split gives the parts other numbers"),
        (["--parts", "99"], "expected 1 to 60 parts, or auto, got 99"),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_one_sentence_and_changes_nothing(flags, says, whole_run, capsys):
    root = whole_run.root
    files = [root / name for name in ("scene.yaml", "report.json", "groups.npz", "materials.yaml")]
    before = [path.read_bytes() for path in files]
    pot = click(root, 0)
    assert main(["group", str(root), *(flag.replace("POT", pot) for flag in flags)]) != 0
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert said.count("phys4dgen: ") == 1

    assert re.search(says, said), said
    assert [path.read_bytes() for path in files] == before


@pytest.fixture(scope="module")
def whole_run(tmp_path_factory):
    made = started(tmp_path_factory.mktemp("whole"))
    return continue_run(made.root, since="simulate", until="materials")


def test_what_colour_cannot_tell_is_said_once_with_the_cures(tmp_path):
    made = started(tmp_path, shaded_ball())
    doubts = [text for text in made.report["warnings"] if text.startswith(CURE)]
    assert len(doubts) == 1
    assert "no two regions differ enough" in doubts[0]
    for cure in ("--parts", "--seed", "--grouping.labels-file", "SAM2"):
        assert cure in doubts[0]
    more = regroup(made.root, parts=60)
    assert any("60 parts were asked for, but colour and shape hold only" in text for text in more.report["warnings"])
    # who edits parts has looked at them
    edited = regroup(made.root, [("rename", "0=ball")])
    assert not any(text.startswith(CURE) for text in edited.report["warnings"])
