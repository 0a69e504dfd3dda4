"""A run that is killed again and again, in each of its stages, ends with the arrays of an undisturbed one."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from lollipop import lollipop_scene
from phys4dgen.errors import RunError
from phys4dgen.run.generate import continue_run, generate, scene_of_run
from phys4dgen.run.state import finished_stages

STAGES = ("reconstruct", "views", "grouping", "interior", "materials", "simulate", "render")
DYING_RUNS = Path(__file__).with_name("dying_runs.py")


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("input")
    motion = {"motion__acceleration_ms2": 2.0, "simulation__duration_s": 4 / 24, "simulation__max_substeps": 30}
    scene = lollipop_scene(folder, motion__preset="sway", **motion)
    return generate(scene, tmp_path_factory.mktemp("undisturbed") / "run")


@pytest.fixture
def scene_yaml(undisturbed, tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text((undisturbed.root / "scene.yaml").read_text("utf-8"), "utf-8")
    return path


def assert_same_files(expected, found):
    """All results but the film, whose encoder promises nothing, and what tells of times and of the way there."""
    names = [path.relative_to(expected).as_posix() for path in sorted(expected.rglob("*")) if path.is_file()]
    telling = {".state.json", ".lock", "log.jsonl", "report.json", "video.mp4", "scene.yaml"}
    assert {*names} == {path.relative_to(found).as_posix() for path in found.rglob("*") if path.is_file()}
    for name in names:
        if name.endswith(".npz"):
            with np.load(expected / name) as wanted, np.load(found / name) as arrays:
                assert wanted.files == arrays.files
                for key in wanted.files:
                    np.testing.assert_array_equal(arrays[key], wanted[key], err_msg=f"{name}: {key}")
        elif name not in telling:
            assert (found / name).read_bytes() == (expected / name).read_bytes(), name


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the killed processes are forks")
def test_the_same_command_goes_on_to_the_same_arrays(undisturbed, scene_yaml, tmp_path):
    out = tmp_path / "run"
    moments = [word for stage in STAGES for moment in ("begins", "writes", "unrecorded") for word in (stage, moment)]
    words = [sys.executable, str(DYING_RUNS), str(scene_yaml), str(out), *moments]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert finished_stages(out) == list(STAGES[:-1])
    run = generate(scene_of_run(out), out)
    assert run.report["reused"] == list(STAGES[:-1])
    assert_same_files(undisturbed.root, out)


def test_one_process_at_a_time_and_an_early_interrupt(undisturbed, scene_yaml, tmp_path):
    """While one command works (and stands still here), a second is refused; after Ctrl-C another goes on."""
    out = tmp_path / "run"
    words = [sys.executable, "-m", "phys4dgen", "generate", "--scene", str(scene_yaml), "-o", str(out)]
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        try:
            while process.poll() is None and not (out / "views" / "cameras.json").exists():
                time.sleep(0.002)
            process.send_signal(signal.SIGSTOP)
            before = {path: path.stat().st_mtime_ns for path in out.rglob("*")}
            with pytest.raises(RunError, match=f"another phys4dgen .process {process.pid}. is working in this run"):
                generate(scene_of_run(out), out)
            with pytest.raises(RunError, match=f"process {process.pid}"):
                continue_run(out, since="simulate")
            assert {path: path.stat().st_mtime_ns for path in out.rglob("*")} == before
        finally:
            process.send_signal(signal.SIGINT)
            process.send_signal(signal.SIGCONT)
        said = process.communicate()[1].splitlines()[-1]
    assert process.returncode == 130
    assert said.startswith("phys4dgen: interrupted; the stages reconstruct")
    assert f"'phys4dgen simulate {out}', to continue" in said
    again = continue_run(out, since="simulate", until="materials")
    assert "reconstruct" in again.report["reused"]
    for name in ("groups.npz", "continuum.npz"):
        with np.load(undisturbed.root / name) as wanted, np.load(out / name) as found:
            for key in wanted.files:
                np.testing.assert_array_equal(found[key], wanted[key], err_msg=f"{name}: {key}")
