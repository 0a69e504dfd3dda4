"""Edits of parts: what they do to labels and names, and that all that was said of a part follows it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lollipop import lollipop
from phys4dgen.cli import main
from phys4dgen.errors import SceneError, StageError
from phys4dgen.formats import save_gaussians
from phys4dgen.grouping.edits import merge_parts, rename_part
from phys4dgen.materials import read_materials
from phys4dgen.run.artefacts import read_groups
from phys4dgen.run.folder import RunFolder
from phys4dgen.run.generate import continue_run, generate, scene_of_run
from phys4dgen.run.part_flags import Clicks, edits_of_flags
from phys4dgen.run.regroup import regroup
from phys4dgen.scene import PartEdit, Scene, dump_scene, load_scene
from phys4dgen.types import Parts

PARTS = Parts(np.array([0, 0, 1, 2, 3, 3]), ("pot", "soil", "stem", "leaves"), "file")


def test_merge_keeps_the_first_name_and_the_lowest_place():
    merged = merge_parts(PARTS, ["leaves", "soil"])
    assert merged.names == ("pot", "leaves", "stem")
    assert merged.labels.tolist() == [0, 0, 1, 2, 1, 1]


@given(chosen=st.lists(st.integers(0, 3), min_size=2, max_size=4, unique=True))
def test_merge_joins_what_it_names_and_nothing_else(chosen):
    names = [PARTS.names[number] for number in chosen]
    merged = merge_parts(PARTS, names)
    for i in range(len(PARTS.labels)):
        for j in range(len(PARTS.labels)):
            together = PARTS.labels[i] == PARTS.labels[j] or {PARTS.labels[i], PARTS.labels[j]} <= set(chosen)
            assert (merged.labels[i] == merged.labels[j]) == together
    for old, new in zip(PARTS.labels, merged.labels, strict=True):
        assert merged.names[new] == (names[0] if old in chosen else PARTS.names[old])


def test_rename_refuses_a_name_that_is_taken():
    assert rename_part(PARTS, "soil", "earth").names == ("pot", "earth", "stem", "leaves")
    with pytest.raises(StageError, match="called already"):
        rename_part(PARTS, "soil", "pot")
    with pytest.raises(StageError, match=r"no part 'leafs'.*Did you mean 'leaves'"):
        merge_parts(PARTS, ["leafs", "stem"])


@pytest.mark.parametrize(
    ("kind", "text", "says"),
    [
        ("merge", "pot", "two or more"),
        ("merge", "pot,7", r"no part '7'; the parts are 0 pot, 1 soil"),
        ("rename", "pot", "OLD=NEW"),
        ("rename", "pot=soil", "called already"),
        ("rename", "pto=vase", "Did you mean 'pot'"),
        ("rename", "pot=9", "--rename: to: expected a name of letters"),
        ("split", "pto", "Did you mean 'pot'"),
        ("split", "pot=two", "--split: expected NAME=K"),
        ("split", "pot=1", "--split: pieces: expected a number of at least 2"),
        ("seed", "pot@3,5", "--seed: expected NAME@VIEW,X,Y"),
        ("seed", "pot", "--seed: expected NAME@VIEW,X,Y"),
    ],
)
def test_a_flag_that_makes_no_sense_is_one_sentence(kind, text, says, tmp_path):
    with pytest.raises(SceneError, match=says):
        edits_of_flags([(kind, text)], PARTS.names, Clicks(RunFolder(tmp_path), Scene(input=tmp_path)))


def test_edits_stand_in_scene_yaml(tmp_path):
    edits = (
        PartEdit(merge=("a", "b")),
        PartEdit(rename="a", to="c"),
        PartEdit(split="c", pieces=2),
        PartEdit(split="c_1", seeds={"d": ((0.5, 0.25, -1.0),)}),
        PartEdit(seeds={"e": ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), "f": ((0.0, 1.0, 0.0),)}),
    )
    scene = Scene(input=tmp_path / "a.ply").with_overrides({"grouping.edits": tuple(e.model_dump() for e in edits)})
    assert scene.grouping.edits == edits
    (tmp_path / "scene.yaml").write_text(dump_scene(scene))
    assert load_scene(tmp_path / "scene.yaml") == scene
    for wrong in (
        "[{merge: [a]}]",
        "[{rename: a}]",
        "[{merge: [a, b], rename: a, to: b}]",
        "[{merge: [a, a]}]",
        "[{split: a}]",
        "[{pieces: 2}]",
        "[{split: a, pieces: 2, seeds: {b: [[0, 0, 0]]}}]",
        "[{split: a, seeds: {a: [[0, 0, 0]]}}]",
        "[{seeds: {a: [[0, 0, 0]]}}]",
    ):
        (tmp_path / "wrong.yaml").write_text(f"input: a.ply\ngrouping: {{edits: {wrong}}}\n")
        with pytest.raises(SceneError, match=r"wrong\.yaml line 2: grouping.edits.0"):
            load_scene(tmp_path / "wrong.yaml")


@pytest.fixture
def run(tmp_path):
    gaussians, labels = lollipop()
    save_gaussians(gaussians, tmp_path / "a.ply")
    labels = np.where((labels == 0) & (gaussians.means[:, 2] < 0.02), 0, labels + 1)  # the block's lower half apart
    np.savez(tmp_path / "labels.npz", labels=labels, names=np.array(PARTS.names))
    scene = Scene(input=tmp_path / "a.ply").with_overrides(
        {
            "up": "z",
            "height_m": 0.2,
            "views.size_px": 64,
            "grouping.labels_file": tmp_path / "labels.npz",
            "parts.leaves.hold": "free",
            "parts.soil.material": "garden_soil",
            "forces": ({"part": "stem", "value_ms2": (1.0, 0.0, 0.0), "to_s": 0.1},),
            "simulation.grid": 12,
        }
    )
    return generate(scene, tmp_path / "run", until="materials")


def test_what_was_said_of_a_part_follows_it(run, capsys):
    path = run.root / "materials.yaml"
    rows = path.read_text("utf-8").split("  stem:\n")
    rows[1] = rows[1].replace("density_kgm3: ", "density_kgm3: 1", 1)
    path.write_text("  stem:\n".join(rows), "utf-8")
    edited = read_materials(path)["stem"].surface.density_kgm3

    assert main(["group", str(run.root), "--rename", "2=stalk", "--merge", "stalk,leaves", "-q"]) == 0
    scene = scene_of_run(run.root)
    assert read_groups(RunFolder(run.root)).names == ("pot", "soil", "stalk")
    assert scene.forces[0].part == "stalk"
    assert scene.parts["stalk"].hold == "free"
    assert scene.parts["soil"].material == "garden_soil"
    again = continue_run(run.root, since="simulate", until="materials")
    assert again.report["reused"] == ["reconstruct", "views", "grouping"]
    assert read_materials(path)["stalk"].surface.density_kgm3 == edited
    assert read_materials(path)["stalk"].surface.source == "user"

    regroup(run.root, undo=True)
    assert read_groups(RunFolder(run.root)).names == ("pot", "soil", "stalk", "leaves")
    regroup(run.root, undo=True)
    assert read_groups(RunFolder(run.root)).names == PARTS.names
    assert scene_of_run(run.root).forces[0].part == "stem"
    assert main(["group", str(run.root), "--undo"]) == 2
    assert main(["group", str(run.root), "--undo", "--merge", "0,1"]) == 2
    assert "one kind at a time" in capsys.readouterr().err


def test_a_new_name_alone_leaves_the_inside_as_it_is(run):
    regroup(run.root, [("rename", "stem=stalk")])
    again = continue_run(run.root, since="simulate", until="materials")
    assert again.report["reused"] == ["reconstruct", "views", "grouping", "interior"]
