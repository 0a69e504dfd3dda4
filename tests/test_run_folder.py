"""The run folder: whole files, one process, and no run destroyed by another."""

import json
import logging
import os
import subprocess
import sys
import time
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from phys4dgen.errors import RunError, SceneError
from phys4dgen.formats import save_gaussians
from phys4dgen.interior import Interior
from phys4dgen.interior.bridge import BridgeReport
from phys4dgen.progress import SILENT
from phys4dgen.run.artefacts import read_interior, write_interior, write_part_maps, write_views
from phys4dgen.run.folder import RunFolder
from phys4dgen.run.json_text import json_text
from phys4dgen.run.prediction import predicted_bytes
from phys4dgen.run.recorder import RecordingProgress
from phys4dgen.run.report import Report, part_reports
from phys4dgen.run.stages import STAGES, Needs, scene_settings, stage_named, stages_until
from phys4dgen.run.state import StageRecord, finished_stages
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


def record_of(scene, stage, **products):
    """A record of a finished stage that took nothing but its settings."""
    needs = Needs.of(stage, scene_settings(scene), dict.fromkeys(stage.takes, "as before"))
    return StageRecord(needs, products)


def finish(run, scene, *names):
    for name in names:
        run.finish(
            stage_named(name),
            record_of(scene, stage_named(name), **dict.fromkeys(stage_named(name).makes, "as before")),
        )


def test_a_run_of_other_settings_is_refused_or_loses_what_depends_on_them(tmp_path, scene):
    root = tmp_path / "run"
    with RunFolder(root).claim() as run:
        run.write_npz(run.groups_npz, {"labels": np.zeros(3, np.int32)})
        run.write_text(run.materials_yaml, "parts: {}")
        run.write_text(run.gaussians_ply, "ply")
        finish(run, scene, "views", "grouping", "interior", "materials")
    assert finished_stages(root) == ["views", "grouping", "interior", "materials"]

    settings = scene_settings(scene.with_overrides({"grouping.parts": 3}))
    with RunFolder(root).claim() as run:
        run.refuse_other_settings(scene_settings(scene))
        with pytest.raises(RunError, match=r"'grouping' \(grouping.parts is 3 and was auto\).*--overwrite.*simulate"):
            run.refuse_other_settings(settings)
        assert run.groups_npz.exists()
        run.remove_outdated(settings)
        assert not run.groups_npz.exists()
        assert run.gaussians_ply.exists()
        assert run.materials_yaml.exists()  # it may hold what a person wrote
    assert finished_stages(root) == ["views"]


def test_settings_that_no_finished_stage_reads_are_no_reason_to_refuse(tmp_path, scene):
    with RunFolder(tmp_path / "run").claim() as run:
        finish(run, scene, "views", "grouping")
        run.refuse_other_settings(
            scene_settings(scene.with_overrides({"simulation.cfl": 0.3, "output.frames": "none"}))
        )


def test_overwrite_leaves_files_alone_that_are_not_ours(tmp_path, scene):
    with RunFolder(tmp_path / "run").claim() as run:
        finish(run, scene, "views", "render")
        (run.root / "notes.txt").write_text("mine")
        run.frames.mkdir()
        (run.frames / "frame_0000.ply").write_text("old")
        run.remove_outdated(scene_settings(scene.with_overrides({"up": "-y"})))
        assert (run.root / "notes.txt").read_text() == "mine"
        assert not (run.frames / "frame_0000.ply").exists()


def test_a_stage_whose_products_were_made_again_otherwise_is_not_finished(tmp_path, scene):
    with RunFolder(tmp_path / "run").claim() as run:
        finish(run, scene, "views", "grouping", "interior")
        stage = stage_named("grouping")
        run.finish(stage, record_of(scene, stage, parts="others"))
    assert finished_stages(run.root) == ["views", "grouping"]


def test_a_folder_of_other_files_is_refused(tmp_path, scene):
    with pytest.raises(RunError, match=r"a\.splat.*choose another place"):
        RunFolder(tmp_path).claim()
    assert (tmp_path / "a.splat").exists()
    with pytest.raises(RunError, match="got a file"):
        RunFolder(tmp_path / "a.splat").claim()


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
                RunFolder(root).claim()
        finally:
            process.kill()
    RunFolder(root).claim().release()


def test_a_failed_write_leaves_the_old_file_and_no_litter(tmp_path, scene):
    with RunFolder(tmp_path / "run").claim() as run:
        run.write_json(run.report_json, {"a": 1})
        with pytest.raises(TypeError):
            run.write_json(run.report_json, {"a": object()})
        assert json.loads(run.report_json.read_text()) == {"a": 1}
        assert not list(run.root.rglob("*.partial-*"))


def test_leftovers_of_a_killed_run_are_removed(tmp_path, scene):
    root = tmp_path / "run"
    RunFolder(root).claim().release()
    leftover = root / ".video.partial-123.mp4"
    leftover.write_text("half a film")
    RunFolder(root).claim().release()
    assert not leftover.exists()


def test_a_damaged_state_is_one_sentence(tmp_path, scene):
    root = tmp_path / "run"
    RunFolder(root).claim().release()
    (root / ".state.json").write_text("{")
    with pytest.raises(RunError, match="damaged"):
        RunFolder(root).claim()


def test_space_is_asked_for_before_the_work(tmp_path, scene):
    with RunFolder(tmp_path / "run").claim() as run:
        run.require_space(1000)
        with pytest.raises(RunError, match=r"output\.frames none"):
            run.require_space(10**18)


def test_the_log_is_json_lines(tmp_path, scene):
    with RunFolder(tmp_path / "run").claim() as run:
        logger = logging.getLogger("phys4dgen.test")
        logger.setLevel(logging.INFO)
        logger.info("50 %% of %s", "it")
    entries = [json.loads(line) for line in run.log_jsonl.read_text().splitlines()]
    assert entries[-1]["message"] == "50 % of it"
    assert entries[-1]["level"] == "info"


def readers_of(key):
    """Stages that are made again when a key of the scene changes."""
    return [stage.name for stage in STAGES if key in Needs.of(stage, {key: 1}, dict.fromkeys(stage.takes, "")).settings]


@pytest.mark.parametrize(
    ("key", "stages"),
    [
        ("input", [stage.name for stage in STAGES]),
        ("views.size_px", ["views"]),
        ("grouping.parts", ["grouping"]),
        ("interior.confidence", ["interior"]),
        ("simulation.grid", ["interior", "simulate"]),
        ("simulation.fps", ["simulate", "render"]),
        ("simulation.threads", []),
        ("parts.pot.hold", ["simulate"]),
        ("parts.pot.material", ["materials"]),
        ("parts.pot.thickness_m", ["interior", "materials", "simulate"]),
        ("materials.file", ["materials"]),
        ("forces", ["simulate"]),
        ("output.video.width", ["render"]),
        ("a_new_section.key", [stage.name for stage in STAGES]),
    ],
)
def test_each_setting_reaches_the_stages_that_read_it(key, stages):
    assert readers_of(key) == stages


def test_every_key_of_the_scene_is_read_by_a_stage(scene):
    unread = [key for key in scene_settings(scene) if not readers_of(key)]
    speed_and_spending = ["materials.max_requests", "materials.max_tokens", "materials.max_wait_s"]
    assert sorted(unread) == [*speed_and_spending, "materials.offline", "simulation.threads"]


def test_every_product_is_made_before_it_is_taken():
    made = set()
    for stage in STAGES:
        assert set(stage.takes) <= made
        made |= set(stage.makes)


def test_files_count_by_content_not_by_name(tmp_path, scene):
    before = scene_settings(scene)
    (tmp_path / "b.splat").write_bytes(bytes(32))
    assert scene_settings(scene.with_overrides({"input": str(tmp_path / "b.splat")})) == before
    (tmp_path / "a.splat").write_bytes(bytes(31) + b"1")
    assert scene_settings(scene) != before
    with pytest.raises(RunError, match=r"none\.splat"):
        scene_settings(Scene(input=tmp_path / "none.splat"))


def test_until_names_a_stage():
    assert stages_until(None)[-1] == "render"
    assert stages_until("grouping") == ("reconstruct", "views", "grouping")
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
    with RunFolder(tmp_path / "run").claim() as run:
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


@pytest.fixture
def continuum():
    """Two solid particles and one of a sheet."""
    return Continuum(
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
        site=np.array([0, 1, 1]),
        spacing_m=0.01,
    )


def test_particles_come_back_and_those_of_an_older_version_are_a_site_each(tmp_path, continuum):
    interior = Interior(continuum, BridgeReport(1, 1, 1.0, 0), 5, 0.9, 2.5, 0, "carving")
    run = RunFolder(tmp_path)
    write_interior(run, interior, settled=replace(continuum, thickness_m=continuum.thickness_m * 2))
    found = read_interior(run).continuum
    for field in fields(Continuum):
        np.testing.assert_array_equal(getattr(found, field.name), getattr(continuum, field.name))
    with np.load(run.continuum_npz) as file:
        older = {name: file[name] for name in file.files if name != "site"}
    np.savez(run.continuum_npz, **older)
    assert read_interior(run).continuum.site.tolist() == [0, 1, 2]


def test_part_masses_are_density_times_true_volume(continuum):
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
