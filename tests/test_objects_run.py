"""Runs of two balls: names, poses, momentum, rebound; an edit of one object redoes that one; faults of a run."""

import json
import shutil

import numpy as np
import pytest

from balls import RADIUS_M, two_balls
from phys4dgen.errors import RunError, SceneError
from phys4dgen.export.trajectory import read_trajectory
from phys4dgen.formats import load_gaussians
from phys4dgen.materials import read_materials
from phys4dgen.run.generate import continue_run, generate, scene_of_run
from phys4dgen.run.overlays import render_overlay
from phys4dgen.run.regroup import regroup
from phys4dgen.run.state import finished_stages

PARTS = ["left/lower", "left/upper", "right/lower", "right/upper"]
STAGES = ["reconstruct", "views", "grouping", "interior", "materials"]
SIMULATION = {"cell_m": 0.009, "duration_s": 0.2, "fps": 80.0, "max_substeps": 60, "chunks": 1, "threads": 1}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """Two foam balls that fly at each other in free space."""
    scene = two_balls(
        tmp_path_factory.mktemp("objects") / "input",
        left={"velocity_ms": [1.5, 0, 0], "spin_deg_s": [0, 0, 90]},
        right={"velocity_ms": [-0.5, 0, 0]},
        parts={"all": {"material": "pu_foam"}, "right/upper": {"interior_material": "pu_foam"}},
        motion={"preset": "rest"},
        simulation=SIMULATION,
    )
    return generate(scene, tmp_path_factory.mktemp("objects_run") / "run")


@pytest.fixture
def run(undisturbed, tmp_path):
    """A copy, to be edited."""
    shutil.copytree(undisturbed.root, tmp_path / "run")
    return tmp_path / "run"


def report_of(run, name):
    return json.loads((run / "objects" / name / "report.json").read_text("utf-8"))


def motion_of(run):
    return json.loads((run / "motion.json").read_text("utf-8"))


def centres_m(run):
    """Mean place of the Gaussians of each ball, [T, 2, 3]."""
    positions = read_trajectory(run / "trajectory.npz").positions
    return np.stack([positions[:, :600].mean(1), positions[:, 600:].mean(1)], 1)


def test_parts_are_named_apart_and_everything_is_in_metres(undisturbed):
    root, report = undisturbed.root, undisturbed.report
    assert list(read_materials(root / "materials.yaml")) == PARTS == [part["name"] for part in report["parts"]]
    assert report["metres_per_unit"] == 1
    gaussians = load_gaussians(root / "gaussians.ply")
    with np.load(root / "groups.npz") as groups, np.load(root / "continuum.npz") as particles:
        assert groups["names"].tolist() == PARTS
        for number, side in ((0, -0.08), (1, 0.08)):
            mine = groups["labels"] // 2 == number
            low, high = gaussians.subset(mine).robust_bounds()
            middle = 0.5 * (low + high)
            np.testing.assert_allclose([middle[0], middle[1], low[2]], [side, 0, 0.02], atol=1e-5)
            own = particles["positions"][particles["group"] // 2 == number]
            np.testing.assert_allclose(own.mean(0), [side, 0, 0.02 + RADIUS_M], atol=0.003)
        # up is z in the scene, whatever it was in the input
        for lower, upper in ((0, 1), (2, 3)):
            heights = gaussians.means[:, 2]
            assert heights[groups["labels"] == upper].min() > heights[groups["labels"] == lower].max() - 1e-6


def test_the_report_says_what_was_assumed_of_each_object(undisturbed):
    left, right = undisturbed.report["objects"]
    assert (left["name"], right["name"]) == ("left", "right")
    assert left["up"] == [0, 0, 1]
    assert np.allclose(right["up"], [0, 1, 0])
    assert left["size_was_given"]
    assert left["height_m"] == pytest.approx(2 * RADIUS_M, rel=1e-6)
    assert left["velocity_ms"] == [1.5, 0, 0]
    assert left["parts"] == ["lower", "upper"]
    masses = {part["name"]: part["mass_g"] for part in undisturbed.report["parts"]}
    assert left["mass_g"] == pytest.approx(masses["left/lower"] + masses["left/upper"])


def test_a_collision_in_free_space_keeps_momentum_and_the_balls_bounce_off(undisturbed):
    momentum = np.array(motion_of(undisturbed.root)["momentum_kgms"])
    left, right = (entry["mass_g"] / 1e3 for entry in undisturbed.report["objects"])
    expected = np.array([1.5 * left - 0.5 * right, 0, 0])
    np.testing.assert_allclose(momentum, np.tile(expected, (len(momentum), 1)), atol=2e-3 * 1.5 * left)
    times_s = read_trajectory(undisturbed.root / "trajectory.npz").times_s
    speeds = np.diff(centres_m(undisturbed.root)[..., 0], axis=0) / np.diff(times_s)[:, None]
    np.testing.assert_allclose(speeds[0], [1.5, -0.5], atol=0.02)
    rebound = speeds[-1, 1] - speeds[-1, 0]
    assert 0.3 * 2.0 < rebound < 2.0
    assert abs(left * speeds[-1, 0] + right * speeds[-1, 1] - expected[0]) < 0.03 * abs(left * 1.5)


def test_the_same_command_makes_nothing_again(run):
    scene = scene_of_run(run)
    before = (run / "trajectory.npz").read_bytes()
    again = generate(scene, run)
    assert again.report["reused"] == [*STAGES, "simulate", "render"]
    assert (run / "trajectory.npz").read_bytes() == before
    assert finished_stages(run) == [*STAGES, "simulate", "render"]


def test_an_edit_of_one_object_redoes_that_one_alone(run):
    scene = scene_of_run(run).with_overrides({"objects.left.height_m": 0.09})
    again = generate(scene, run, until="materials", overwrite=True)
    assert report_of(run, "left")["reused"] == ["reconstruct"]
    assert report_of(run, "right")["reused"] == STAGES
    assert again.report["objects"][0]["height_m"] == pytest.approx(0.09)
    assert again.report["objects"][0]["mass_g"] < 0.85 * again.report["objects"][1]["mass_g"]


def test_a_moved_object_is_not_understood_again(run):
    scene = scene_of_run(run).with_overrides({"objects.right.position_m": (0.8, 0, 0.02)})
    with pytest.raises(RunError, match=r"objects.right.position_m is \[0.8, 0.0, 0.02\] and was .*--overwrite"):
        generate(scene, run)
    again = continue_run(run, scene, since="simulate", until="simulate")
    assert [report_of(run, name)["reused"] for name in ("left", "right")] == [STAGES, STAGES]
    assert again.report["reused"] == []
    # they do not meet any more
    assert np.allclose(centres_m(run)[-1, 1, 0], 0.8 - 0.5 * 0.2 * (1 - 1 / 16), atol=0.01)


def test_another_start_simulates_again_and_no_more(run):
    scene = scene_of_run(run).with_overrides({"objects.right.velocity_ms": (0, 0.2, 0)})
    again = continue_run(run, scene, since="simulate", until="simulate")
    assert again.report["reused"] == STAGES


def test_materials_may_be_edited_for_all_or_for_one(run):
    path = run / "objects" / "left" / "materials.yaml"
    path.write_text(path.read_text("utf-8").replace("density_kgm3: ", "density_kgm3: 1", 1), "utf-8")
    again = continue_run(run, since="simulate", until="materials")
    edited = read_materials(run / "materials.yaml")
    assert edited["left/lower"].surface.density_kgm3 > 100 > edited["left/upper"].surface.density_kgm3
    assert again.report["reused"] == STAGES[:-1]
    path = run / "materials.yaml"
    path.write_text(path.read_text("utf-8").replace("poisson_ratio: 0.1", "poisson_ratio: 0.25"), "utf-8")
    again = continue_run(run, since="simulate", until="simulate")
    kept = read_materials(run / "materials.yaml")
    assert {entry.surface.poisson_ratio for entry in kept.values()} == {0.25}
    assert {entry.surface.source for entry in kept.values()} == {"user"}
    assert "simulate" not in again.report["reused"]


def test_a_materials_file_names_parts_of_all_objects(run, tmp_path):
    path = tmp_path / "chosen.yaml"
    path.write_text("parts:\n  right/lower: {surface: steel}\n")
    scene = scene_of_run(run).with_overrides({"materials.file": path})
    continue_run(run, scene, since="simulate", until="materials")
    names = {name: entry.surface.name for name, entry in read_materials(run / "materials.yaml").items()}
    assert names == dict.fromkeys(PARTS, "pu_foam")  # what the scene names for all wins over a file
    continue_run(run, scene.with_overrides({"parts": {}}), since="simulate", until="materials")
    names = {name: entry.surface.name for name, entry in read_materials(run / "materials.yaml").items()}
    assert names["right/lower"] == "steel"
    assert names["right/upper"] != "steel"


def test_film_and_overlays_of_a_run_of_objects(run):
    scene = scene_of_run(run)
    video, sheet = render_overlay(run, scene, "parts")
    assert video.is_file()
    assert sheet.is_file()
    again = continue_run(run, scene.with_overrides({"output.video.orbit_deg": 5.0}), since="render")
    assert again.report["reused"] == [*STAGES, "simulate"]
    shutil.rmtree(run / "objects" / "left")
    with pytest.raises(RunError, match="'reconstruct' is not up to date"):
        continue_run(run, scene.with_overrides({"output.video.orbit_deg": 6.0}), since="render")


def test_parts_of_objects_are_edited_in_the_scene(run):
    with pytest.raises(SceneError, match=r"objects\.NAME\.grouping"):
        regroup(run, [("merge", "left/lower,left/upper")])
    with pytest.raises(RunError, match="one of several objects"):
        regroup(run / "objects" / "left", [("merge", "lower,upper")])
