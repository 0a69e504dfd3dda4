"""An edit redoes what depends on it, and nothing else; what a person wrote survives; an overlay changes nothing."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lollipop import lollipop_scene
from phys4dgen.errors import RunError
from phys4dgen.export.trajectory import read_trajectory
from phys4dgen.materials import read_materials
from phys4dgen.run.generate import continue_run, generate, scene_of_run
from phys4dgen.run.inspection import inspect_path
from phys4dgen.run.material_edits import edited_materials
from phys4dgen.run.state import finished_stages
from phys4dgen.scene import dump_scene

NAMES = ("reconstruct", "views", "grouping", "interior", "materials", "simulate", "render")


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    scene = lollipop_scene(tmp_path_factory.mktemp("input"))
    return generate(scene, tmp_path_factory.mktemp("undisturbed") / "run")


@pytest.fixture
def run(undisturbed, tmp_path):
    """A copy, to be edited."""
    shutil.copytree(undisturbed.root, tmp_path / "run")
    return replace(undisturbed, root=tmp_path / "run")


def reused(run):
    return run.report["reused"]


def notes_on(run, stage):
    return [note for note in run.report["notes"] if note.startswith(f"{stage}: ")]


def edit_material(run, part, key, value):
    """What a person does in an editor: change one line of materials.yaml."""
    path = run.root / "materials.yaml"
    lines = path.read_text("utf-8").splitlines()
    start = next(i for i, line in enumerate(lines) if line.strip() == f"{part}:")
    at = next(i for i in range(start, len(lines)) if lines[i].strip().startswith(f"{key}:"))
    lines[at] = f"{lines[at].split(':')[0]}: {value}"
    path.write_text("\n".join(lines) + "\n", "utf-8")


def test_edits_redo_what_depends_on_them(run):
    assert reused(run) == []
    before = read_trajectory(run.root / "trajectory.npz").positions
    again = continue_run(run.root, since="simulate")
    assert again.report == run.report  # nothing was to be done

    edit_material(run, "ball", "density_kgm3", 1234.0)
    heavier = continue_run(run.root, since="simulate")
    assert reused(heavier) == ["reconstruct", "views", "grouping", "interior", "materials"]
    assert "the materials changed" in notes_on(heavier, "simulate")[0]
    assert "the motion changed" in notes_on(heavier, "render")[0]
    book = read_materials(run.root / "materials.yaml")
    assert book["ball"].surface.density_kgm3 == 1234
    ball = next(part for part in heavier.report["parts"] if part["name"] == "ball")
    assert (ball["surface"]["density_kgm3"], ball["surface"]["source"]) == (1234, "user")
    after = read_trajectory(run.root / "trajectory.npz").positions
    assert (after != before).any()

    scene_yaml = run.root / "scene.yaml"
    text = scene_yaml.read_text("utf-8").replace("width: 96", "width: 128  # for the poster")
    scene_yaml.write_text(text, "utf-8")
    frame = run.root / "frames" / "frame_0003.ply"
    written = frame.stat().st_mtime_ns
    wider = continue_run(run.root, since="render")
    assert reused(wider) == list(NAMES[:-1])
    assert "output.video.width is 128 and was 96" in notes_on(wider, "render")[0]
    assert frame.stat().st_mtime_ns == written  # the motion is the same, so the frames are
    assert "# for the poster" in scene_yaml.read_text("utf-8")

    # A comment and a touched file change nothing.
    path = run.root / "materials.yaml"
    path.write_text("# mine\n" + path.read_text("utf-8"), "utf-8")
    os.utime(run.root / "groups.npz")
    same = continue_run(run.root, since="simulate")
    assert reused(same) == list(NAMES)
    assert path.read_text("utf-8").startswith("# mine\n")


def test_render_refuses_to_simulate(run):
    scene = scene_of_run(run.root).with_overrides({"motion.acceleration_ms2": 0.5})
    with pytest.raises(RunError, match=r"'simulate' is not up to date, because motion.acceleration_ms2 is 0\.5"):
        continue_run(run.root, scene, since="render")
    assert finished_stages(run.root) == list(NAMES)  # and scene.yaml is as it was
    assert json.loads((run.root / "report.json").read_text("utf-8")) == run.report


def test_an_edited_material_survives_a_new_identification(run):
    edit_material(run, "ball", "youngs_modulus_pa", 54321.0)
    edit_material(run, "stick", "name", "rubber")  # the old numbers still stand beside it
    scene = scene_of_run(run.root).with_overrides({"simulation.grid": 18})
    again = continue_run(run.root, scene, since="simulate", until="materials")
    assert reused(again) == ["reconstruct", "views", "grouping"]
    assert "simulation.grid is 18 and was 16" in notes_on(again, "interior")[0]
    assert "the particles changed" in notes_on(again, "materials")[0]
    book = read_materials(run.root / "materials.yaml")
    assert (book["ball"].surface.youngs_modulus_pa, book["ball"].surface.source) == (54321, "user")
    assert (book["stick"].surface.name, book["stick"].surface.source) == ("natural_rubber", "user")
    assert book["stick"].surface.youngs_modulus_pa < 1e8  # the library's rubber
    # What the scene names later wins over the older edit.
    steel = scene.with_overrides({"parts.ball.material": "steel"})
    continue_run(run.root, steel, since="simulate", until="materials")
    assert read_materials(run.root / "materials.yaml")["ball"].surface.name == "steel"


@pytest.mark.parametrize("dies_before", ["materials.yaml", ".identified.yaml"])
def test_a_new_identification_that_dies_halfway_makes_no_edits(run, undisturbed, monkeypatch, dies_before):
    """Between the replacement of one file and of the other, what is new in one is not a person's word."""
    edit_material(run, "ball", "youngs_modulus_pa", 54321.0)
    replace_file = Path.replace

    def dying(path, target):
        if Path(target).name == dies_before:
            raise KeyboardInterrupt
        return replace_file(path, target)

    before = scene_of_run(run.root)
    steel = before.with_overrides({"parts.stick.material": "steel"})
    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", dying)
        with pytest.raises(KeyboardInterrupt):
            continue_run(run.root, steel, since="materials", until="materials")
    assert "materials" not in finished_stages(run.root)
    again = continue_run(run.root, before, since="materials", until="materials")
    assert "a command that made it again did not end" in notes_on(again, "materials")[0]
    book = read_materials(run.root / "materials.yaml")
    assert (book["ball"].surface.youngs_modulus_pa, book["ball"].surface.source) == (54321, "user")
    assert book["stick"] == read_materials(undisturbed.root / "materials.yaml")["stick"]
    edits = edited_materials(run.root / "materials.yaml", run.root / ".identified.yaml")
    assert {part for part, _ in edits} == {"ball"}
    assert not (run.root / ".identified.coming.yaml").exists()


def test_another_motion_that_dies_halfway_is_not_taken_for_the_old_one(run, undisturbed, monkeypatch):
    """Its trajectory lies there, its facts do not."""
    replace_file = Path.replace

    def dying(path, target):
        if Path(target).name == "motion.json":
            raise KeyboardInterrupt
        return replace_file(path, target)

    before = scene_of_run(run.root)
    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", dying)
        with pytest.raises(KeyboardInterrupt):
            continue_run(run.root, before.with_overrides({"motion.acceleration_ms2": 0.7}), since="simulate")
    positions = [read_trajectory(root / "trajectory.npz").positions for root in (run.root, undisturbed.root)]
    assert (positions[0] != positions[1]).any()
    continue_run(run.root, before, since="simulate")
    np.testing.assert_array_equal(read_trajectory(run.root / "trajectory.npz").positions, positions[1])


def test_a_stage_that_ends_with_the_same_result_redoes_nothing_after_it(run):
    scene = scene_of_run(run.root).with_overrides({"views.size_px": 65})
    again = continue_run(run.root, scene, since="simulate")
    assert reused(again) == ["reconstruct", "interior", "materials", "simulate", "render"]
    assert "the views changed" in notes_on(again, "grouping")[0]


def test_a_key_that_is_newer_than_the_run_stood_at_its_default(run):
    path = run.root / ".state.json"
    state = json.loads(path.read_text("utf-8"))
    for record in state["stages"].values():
        record["needs"]["settings"].pop("interior.particles", None)
    path.write_text(json.dumps(state), "utf-8")
    assert finished_stages(run.root)[-1] == "render"
    scene = scene_of_run(run.root).with_overrides({"interior.particles": "gaussians"})
    (run.root / "scene.yaml").write_text(dump_scene(scene), "utf-8")
    assert finished_stages(run.root)[-1] == "grouping"


def test_labels_that_a_person_put_into_the_run_are_taken(run):
    with np.load(run.root / "groups.npz") as arrays:
        labels = arrays["labels"].copy()
    labels[:250] = 1
    np.savez(run.root / "groups.npz", labels=labels, names=np.array(["block", "stick", "ball"]))
    again = continue_run(run.root, since="simulate", until="interior")
    assert reused(again) == ["reconstruct", "views", "grouping"]
    assert "the parts changed" in notes_on(again, "interior")[0]


def test_inspect_and_the_interrupt_message_tell_what_an_edit_made_out_of_date(run):
    assert finished_stages(run.root) == list(NAMES)
    scene_yaml = run.root / "scene.yaml"
    scene_yaml.write_text(scene_yaml.read_text("utf-8").replace("damping_ratio: 0.08", "damping_ratio: 0.2"), "utf-8")
    facts = inspect_path(run.root)
    assert facts["out_of_date"] == ["simulate", "render"]
    assert facts["finished"] == finished_stages(run.root) == list(NAMES[:-2])
