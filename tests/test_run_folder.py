"""The run folder: whole files, one process, and no run destroyed by another."""

import json
import logging
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from phys4dgen.errors import RunError, SceneError
from phys4dgen.formats import save_gaussians
from phys4dgen.progress import SILENT
from phys4dgen.run.artefacts import write_part_maps, write_views
from phys4dgen.run.folder import RunFolder, finished_stages
from phys4dgen.run.json_text import json_text
from phys4dgen.run.prediction import predicted_bytes
from phys4dgen.run.recorder import RecordingProgress
from phys4dgen.run.report import Report, part_reports
from phys4dgen.run.stages import STAGES, stage_digests, stages_until
from phys4dgen.scene import Scene
from phys4dgen.types import (
    SHEET,
    SOLID,
    Camera,
    Continuum,
    Frame,
    Masks,
    Material,
    MaterialBook,
    PartMaterials,
    Parts,
    Views,
)


@pytest.fixture
def scene(tmp_path):
    (tmp_path / "a.splat").write_bytes(bytes(32))
    return Scene(input=tmp_path / "a.splat")


def digests(scene):
    return stage_digests(scene, version="1")


def test_a_finished_stage_is_kept_by_the_same_settings_and_lost_by_others(tmp_path, scene):
    root = tmp_path / "run"
    with RunFolder(root).claim(digests(scene)) as run:
        run.write_npz(run.groups_npz, {"labels": np.zeros(3, np.int32)})
        run.finish("views")
        run.finish("grouping")
    with RunFolder(root).claim(digests(scene)) as run:
        assert run.is_finished("grouping")
        assert not run.is_finished("interior")
    assert finished_stages(root) == ["views", "grouping"]

    other = scene.with_overrides({"grouping.parts": 3})
    with pytest.raises(RunError, match=r"'grouping'.*--overwrite"):
        RunFolder(root).claim(digests(other))
    assert (root / "groups.npz").exists()
    with RunFolder(root).claim(digests(other), overwrite=True) as run:
        assert run.is_finished("views")
        assert not run.is_finished("grouping")
        assert not run.groups_npz.exists()


def test_a_run_that_finished_nothing_does_not_stand_in_the_way(tmp_path, scene):
    root = tmp_path / "run"
    RunFolder(root).claim(digests(scene)).release()
    RunFolder(root).claim(digests(scene.with_overrides({"up": "-y"}))).release()


def test_overwrite_leaves_files_alone_that_are_not_ours(tmp_path, scene):
    root = tmp_path / "run"
    RunFolder(root).claim(digests(scene)).release()
    (root / "notes.txt").write_text("mine")
    (root / "frames").mkdir()
    (root / "frames" / "frame_0000.ply").write_text("old")
    changed = scene.with_overrides({"seed": 5})
    RunFolder(root).claim(digests(changed), overwrite=True).release()
    assert (root / "notes.txt").read_text() == "mine"
    assert not (root / "frames" / "frame_0000.ply").exists()


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_folder_of_other_files_is_refused(tmp_path, scene, overwrite):
    with pytest.raises(RunError, match=r"a\.splat.*choose another place"):
        RunFolder(tmp_path).claim(digests(scene), overwrite=overwrite)
    assert (tmp_path / "a.splat").exists()
    with pytest.raises(RunError, match="got a file"):
        RunFolder(tmp_path / "a.splat").claim(digests(scene), overwrite=overwrite)


def test_a_second_process_is_refused_and_a_dead_one_forgotten(tmp_path, scene):
    root = tmp_path / "run"
    root.mkdir()
    holder = (
        "import time\nfrom pathlib import Path\nfrom phys4dgen.run.lock import FolderLock\n"
        f"lock = FolderLock(Path({str(root)!r}))\nlock.acquire()\nprint('held', flush=True)\ntime.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", holder], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "held\n"
            with pytest.raises(RunError, match=f"process {process.pid}"):
                RunFolder(root).claim(digests(scene))
        finally:
            process.kill()
    RunFolder(root).claim(digests(scene)).release()


def test_a_failed_write_leaves_the_old_file_and_no_litter(tmp_path, scene):
    with RunFolder(tmp_path / "run").claim(digests(scene)) as run:
        run.write_json(run.report_json, {"a": 1})
        with pytest.raises(TypeError):
            run.write_json(run.report_json, {"a": object()})
        assert json.loads(run.report_json.read_text()) == {"a": 1}
        assert not list(run.root.rglob("*.partial-*"))


def test_leftovers_of_a_killed_run_are_removed(tmp_path, scene):
    root = tmp_path / "run"
    RunFolder(root).claim(digests(scene)).release()
    leftover = root / ".video.partial-123.mp4"
    leftover.write_text("half a film")
    RunFolder(root).claim(digests(scene)).release()
    assert not leftover.exists()


def test_a_damaged_state_is_one_sentence(tmp_path, scene):
    root = tmp_path / "run"
    RunFolder(root).claim(digests(scene)).release()
    (root / ".state.json").write_text("{")
    with pytest.raises(RunError, match="damaged"):
        RunFolder(root).claim(digests(scene), overwrite=True)


def test_space_is_asked_for_before_the_work(tmp_path, scene):
    with RunFolder(tmp_path / "run").claim(digests(scene)) as run:
        run.require_space(1000)
        with pytest.raises(RunError, match=r"output\.frames none"):
            run.require_space(10**18)


def test_the_log_is_json_lines(tmp_path, scene):
    with RunFolder(tmp_path / "run").claim(digests(scene)) as run:
        logger = logging.getLogger("phys4dgen.test")
        logger.setLevel(logging.INFO)
        logger.info("50 %% of %s", "it")
    entries = [json.loads(line) for line in run.log_jsonl.read_text().splitlines()]
    assert entries[-1]["message"] == "50 % of it"
    assert entries[-1]["level"] == "info"


def test_each_setting_reaches_the_digest_of_its_stage(scene):
    """A key of the scene that no stage listens to would let a changed scene reuse old results."""
    changes = {
        "up": "+y", "height_m": 1.0, "longest_m": 2.0, "seed": 1, "gravity": None, "parts.a.hold": "fixed",
        "views.size_px": 128, "grouping.parts": 2, "interior.label_grid": 16, "materials.backend": "default",
        "motion.duration_s": 0.5, "forces": [{"value_ms2": [1, 0, 0], "to_s": 1}], "simulation.cfl": 0.3,
        "output.frames": "none",
    }  # fmt: skip
    assert {key.split(".")[0] for key in changes} == set(Scene.model_fields) - {"input"}
    before = digests(scene)
    for key, value in changes.items():
        if value is not None:
            assert digests(scene.with_overrides({key: value})) != before, key
    assert digests(scene.with_overrides({"simulation.threads": 2})) == before


def test_the_content_of_the_input_counts_not_its_name(tmp_path, scene):
    before = digests(scene)
    (tmp_path / "b.splat").write_bytes(scene.input.read_bytes())
    assert digests(scene.with_overrides({"input": str(tmp_path / "b.splat")})) == before
    scene.input.write_bytes(bytes(64))
    assert digests(scene)[STAGES[0].name] != before[STAGES[0].name]


def test_a_missing_input_is_one_sentence(tmp_path):
    with pytest.raises(RunError, match=r"none\.splat: cannot read"):
        digests(Scene(input=tmp_path / "none.splat"))


def test_until_names_a_stage():
    assert stages_until(None)[-1] == "render"
    assert stages_until("grouping") == ("views", "grouping")
    with pytest.raises(SceneError, match="Did you mean 'interior'"):
        stages_until("interor")


def test_json_has_no_nan_and_takes_numpy():
    text = json_text(
        {"a": np.float32(0.5), "b": np.array([1.0, np.nan]), "c": float("inf"), "d": Path("x/y"), "e": (1, True)}
    )
    assert json.loads(text) == {"a": 0.5, "b": [1.0, None], "c": None, "d": "x/y", "e": [1, True]}


def test_views_and_part_maps_read_back_from_pictures(tmp_path, scene):
    rng = np.random.default_rng(0)
    camera = Camera(viewmat=np.eye(4), K=np.diag([10.0, 10.0, 1.0]), width=6, height=4)
    views = Views(
        cameras=(camera,) * 2,
        rgb=rng.uniform(0, 1, (2, 4, 6, 3)),
        alpha=rng.uniform(0, 1, (2, 4, 6)),
        depth=rng.uniform(0, 3, (2, 4, 6)),
    )
    labels = rng.integers(-1, 4, (2, 4, 6))
    with RunFolder(tmp_path / "run").claim(digests(scene)) as run:
        write_views(run, views, frame=Frame(rotation=np.eye(3), metres_per_unit=0.5))
        write_part_maps(run, Masks(labels=labels))
    facts = json.loads(run.cameras_json.read_text())
    assert [entry["name"] for entry in facts["cameras"]] == ["view_00", "view_01"]
    assert facts["cameras"][1]["viewmat"] == np.eye(4).tolist()
    depth = np.asarray(Image.open(run.views / "view_01_depth.png")).astype(float) * facts["depth_step"]
    np.testing.assert_allclose(depth, views.depth[1], atol=facts["depth_step"])
    rgb = np.asarray(Image.open(run.views / "view_00_rgb.png")) / 255
    np.testing.assert_allclose(rgb, views.rgb[0], atol=0.5 / 255 + 1e-6)
    np.testing.assert_array_equal(np.asarray(Image.open(run.views / "view_01_parts.png")).astype(int) - 1, labels[1])


def material(density_kgm3):
    return Material("m", "neo_hookean", density_kgm3, 1e5, 0.3, "user")


def test_part_masses_are_density_times_true_volume():
    continuum = Continuum(
        positions=np.zeros((3, 3)),
        part=np.array([0, 0, 1]),
        is_interior=np.array([False, True, False]),
        volume_m3=np.array([1e-6, 3e-6, 2e-6]),
        gaussian_index=np.full(3, -1),
        piece=np.zeros(3),
        shape=np.array([SOLID, SOLID, SHEET]),
        thickness_m=np.array([np.nan, np.nan, 1e-3]),
        thickness_measured=np.array([False, False, True]),
        offset_m=np.zeros((3, 3)),
        spacing_m=0.01,
    )
    parts = Parts(labels=np.array([0, 1, 1, 1]), names=("pot", "leaf"), backend="file")
    book = MaterialBook(
        {"pot": PartMaterials(material(2000), material(1000)), "leaf": PartMaterials(material(800), material(800))}
    )
    pot, leaf = part_reports(parts, continuum, book)
    assert pot.mass_g == pytest.approx(1e-6 * 2000e3 + 3e-6 * 1000e3)
    assert pot.interior_fraction == pytest.approx(0.75)
    assert pot.thickness_mm is None
    assert (leaf.gaussians, leaf.particles) == (3, 1)
    assert leaf.mass_g == pytest.approx(1.6)
    assert leaf.thickness_mm == pytest.approx(1.0)


def test_the_report_puts_warnings_first_and_times_each_stage():
    progress = RecordingProgress(SILENT)
    progress.stage("views")
    time.sleep(0.02)
    progress.stage("grouping")
    progress.warn("the scale is a guess")
    progress.warn("the scale is a guess")
    progress.end_stage()
    report = Report(input="a.splat", seed=1, warnings=progress.warnings, stages=progress.stages).as_dict()
    assert next(iter(report)) == "warnings"
    assert report["warnings"] == ["the scale is a guess"]
    assert list(report["seconds"]) == ["views", "grouping"]
    assert 0.02 <= report["seconds"]["views"] < 5
    assert report["versions"]["python"] == ".".join(map(str, sys.version_info[:3]))
    assert str(os.cpu_count()) in report["versions"]["platform"]
    json_text(report)


@pytest.mark.parametrize("sh_degree", [0, 2])
def test_the_predicted_size_is_that_of_the_files(tmp_path, scene, random_gaussians, sh_degree):
    gaussians = random_gaussians(2000, sh_degree=sh_degree)
    scene = scene.with_overrides({"views.size_px": 64, "output.video.width": 64, "simulation.duration_s": 1.0})
    save_gaussians(gaussians, tmp_path / "frame.ply")
    frame = (tmp_path / "frame.ply").stat().st_size
    expected = 25 * frame + 24 * 2000 * 48
    assert predicted_bytes(scene, gaussians) == pytest.approx(expected, rel=0.1)
    small = scene.with_overrides({"output.frames": "none"})
    assert predicted_bytes(small, gaussians) == pytest.approx(expected - 24 * frame, rel=0.25)
