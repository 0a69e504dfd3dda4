"""A run that is killed, interrupted or out of disk in the middle of a stage goes on, to the same arrays."""

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress

import numpy as np
import pytest

from lollipop import lollipop_scene
from phys4dgen.run.generate import continue_run, generate, scene_of_run
from phys4dgen.run.partial_motion import PartialMotion
from phys4dgen.run.state import finished_stages

FRAMES = 10


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """A run up to the simulation."""
    seconds = {"simulation__duration_s": FRAMES / 24}
    scene = lollipop_scene(
        tmp_path_factory.mktemp("input"), motion__preset="sway", motion__acceleration_ms2=2.0, **seconds
    )
    return generate(scene, tmp_path_factory.mktemp("prepared") / "run", until="materials")


@pytest.fixture(scope="module")
def undisturbed(prepared, tmp_path_factory):
    out = shutil.copytree(prepared.root, tmp_path_factory.mktemp("undisturbed") / "run")
    return generate(scene_of_run(out), out)


@pytest.fixture
def out(prepared, tmp_path):
    """A copy of the prepared run."""
    return shutil.copytree(prepared.root, tmp_path / "run")


@pytest.fixture(scope="module")
def half_simulated(prepared, tmp_path_factory):
    """A copy that was killed in the middle of the simulation; several tests go on from it, each with its own copy."""
    out = shutil.copytree(prepared.root, tmp_path_factory.mktemp("killed") / "run")
    stop_when_there(out, "trajectory.partial/frame_0003.npz", signal.SIGKILL)
    assert "simulate" not in finished_stages(out)
    return out


@pytest.fixture
def killed(half_simulated, tmp_path):
    return shutil.copytree(half_simulated, tmp_path / "run")


def command(run, *words):
    return [sys.executable, "-m", "phys4dgen", *words, str(run)]


def stop_when_there(out, name, how):
    """Go on with the run in ``out`` and stop it once the file ``name`` is there; returns what it said."""
    words = command(out, "generate", "--scene", str(out / "scene.yaml"), "-o")
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        while process.poll() is None and not (out / name).exists():
            time.sleep(0.002)
        process.send_signal(how)
        assert process.stderr is not None
        said = process.stderr.read()
    assert process.returncode == (130 if how == signal.SIGINT else -how), said
    return said


def assert_same_run(expected, out):
    for name in ("groups.npz", "continuum.npz", "trajectory.npz"):
        with np.load(expected.root / name) as wanted, np.load(out / name) as found:
            for key in wanted.files:
                np.testing.assert_array_equal(found[key], wanted[key], err_msg=f"{name}: {key}")
    facts, others = (json.loads((root / "motion.json").read_text("utf-8")) for root in (expected.root, out))
    assert facts == others
    last = f"frames/frame_{FRAMES - 1:04d}.ply"
    assert (out / last).read_bytes() == (expected.root / last).read_bytes()
    assert not (out / "trajectory.partial").exists()
    assert not list(out.rglob("*.partial-*"))


def goes_on(run):
    return [note for note in run.report["notes"] if note.startswith("simulate: goes on")]


def test_killed_in_the_middle_of_the_simulation(undisturbed, killed):
    run = generate(scene_of_run(killed), killed)
    assert goes_on(run)
    assert_same_run(undisturbed, killed)


def test_interrupted_and_continued_by_simulate(undisturbed, out):
    said = stop_when_there(out, "trajectory.partial/frame_0003.npz", signal.SIGINT)
    assert "simulate" in said.splitlines()[-1]
    finished = subprocess.run(command(out, "simulate"), capture_output=True, text=True, check=False)
    assert finished.returncode == 0, finished.stderr
    assert "goes on after frame" in finished.stderr
    assert_same_run(undisturbed, out)


def test_killed_in_the_middle_of_the_film(undisturbed, out):
    stop_when_there(out, "frames/frame_0004.ply", signal.SIGKILL)
    assert finished_stages(out)[-1] == "simulate"
    assert not (out / "video.mp4").exists()
    run = generate(scene_of_run(out), out)
    assert not goes_on(run)
    assert_same_run(undisturbed, out)


def test_frames_of_other_settings_are_not_taken(killed):
    scene = scene_of_run(killed).with_overrides({"motion.acceleration_ms2": 3.0})
    run = continue_run(killed, scene, since="simulate", until="simulate")
    assert not goes_on(run)
    assert not (killed / "trajectory.partial").exists()


def test_a_damaged_checkpoint_costs_time_only(undisturbed, killed):
    (killed / "trajectory.partial" / "frame_0001.npz").write_bytes(b"PK nothing")
    run = generate(scene_of_run(killed), killed)
    assert any("simulated anew" in warning for warning in run.report["warnings"])
    assert_same_run(undisturbed, killed)


def test_a_recalled_motion_leaves_nothing_partial(tmp_path):
    partial = PartialMotion(tmp_path / "none", made_from="", gaussian_count=1, progress=None)
    partial.remove()
    assert not (tmp_path / "none").exists()


def test_a_full_disk_is_one_sentence_and_no_half_file(undisturbed, out):
    """Files may not grow beyond what those before the simulation need: writing the trajectory fails."""
    limit = max(path.stat().st_size for path in out.rglob("*") if path.is_file()) + 10_000
    assert limit < (undisturbed.root / "trajectory.npz").stat().st_size

    def small_files():
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    words = command(out, "generate", "--scene", str(out / "scene.yaml"), "-o")
    ended = subprocess.run(words, capture_output=True, text=True, check=False, preexec_fn=small_files)
    assert ended.returncode == 1
    assert "Traceback" not in ended.stderr
    assert ended.stderr.splitlines()[-1].startswith("phys4dgen: ")
    assert finished_stages(out)[-1] == "materials"
    assert not (out / "trajectory.npz").exists()
    assert not list(out.rglob("*.partial-*"))
    generate(scene_of_run(out), out)
    assert_same_run(undisturbed, out)


@pytest.mark.skipif(sys.platform != "linux", reason="mounts a small file system")
def test_a_full_file_system(prepared, tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=3500k", "tmpfs", str(disk)]
    mounted = subprocess.run(mount, capture_output=True, check=False)
    if mounted.returncode != 0:
        pytest.skip("a small file system cannot be mounted here")
    try:
        out = shutil.copytree(prepared.root, disk / "run")
        filler = disk / "filler"
        words = command(out, "generate", "--scene", str(out / "scene.yaml"), "-o")
        with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
            while process.poll() is None and not (out / "trajectory.partial/frame_0001.npz").exists():
                time.sleep(0.002)
            status = os.statvfs(disk)
            with suppress(OSError):  # the run was faster
                filler.write_bytes(bytes(max(0, status.f_bavail * status.f_bsize - 100_000)))
            said = process.communicate()[1]
        assert process.returncode == 1, said
        assert "disk is full" in said.splitlines()[-1] or "No space" in said.splitlines()[-1]
        assert not list(out.rglob("*.partial-*"))
        for archive in out.rglob("*.npz"):
            with np.load(archive) as arrays:
                assert all(arrays[name] is not None for name in arrays.files)
    finally:
        subprocess.run(["umount", str(disk)], check=False)
