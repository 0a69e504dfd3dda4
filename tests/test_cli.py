"""The command line up to where the work begins: flags, precedence, errors in one sentence, exit codes."""

import importlib.util
import json
import subprocess
import sys
import time

import numpy as np
import pytest

from phys4dgen.cli import main
from phys4dgen.cli.arguments import COMMANDS, parse, scene_from
from phys4dgen.cli.console import PlainProgress
from phys4dgen.errors import SceneError
from phys4dgen.formats import load_gaussians, save_gaussians
from phys4dgen.progress import SILENT, Progress

TAKEN_AWAY = ("torch", "trimesh", "openai", "huggingface_hub")
"""Packages that a test takes away."""


def scene_of(*words):
    return scene_from(parse(["generate", "a.splat", "-o", "run", *words]))


@pytest.mark.parametrize("words", [["--up", "-y"], ["--up=-y"]])
def test_up_takes_a_negative_axis_either_way(words):
    assert scene_of(*words).up == "-y"


def test_everyday_flags_set_keys_of_the_scene():
    scene = scene_of(
        "--height-m", "0.35", "--parts", "3", "--motion", "sway", "--wind", "-1,0,0.5", "--hold", "pot",
        "--hold", "soil", "--material", "pot=terracotta", "--part-name", "0=pot", "--part-name", "1=soil",
        "--duration-s", "1e0", "--fps", "12", "--grid", "48", "--seed", "7", "--threads", "1",
    )  # fmt: skip
    assert (scene.height_m, scene.grouping.parts, scene.motion.preset, scene.seed) == (0.35, 3, "sway", 7)
    assert scene.motion.wind == (-1, 0, 0.5)
    assert (scene.parts["pot"].hold, scene.parts["pot"].material) == ("fixed", "terracotta")
    assert scene.parts["soil"].hold == "fixed"
    assert scene.grouping.names == {0: "pot", 1: "soil"}
    assert (scene.simulation.duration_s, scene.simulation.fps, scene.simulation.grid) == (1.0, 12.0, 48)
    assert scene.simulation.threads == 1


def test_every_key_of_the_scene_is_a_flag():
    scene = scene_of(
        "--simulation.max-substeps=300", "--output.frames", "none", "--output.video.elevation-deg", "-5",
        "--parts.my-pot.thickness-m", "0.004", "--forces", "[{part: part_1, value_ms2: [3, 0, 0], to_s: 0.3}]",
    )  # fmt: skip
    assert scene.simulation.max_substeps == 300
    assert scene.output.frames == "none"
    assert scene.output.video.elevation_deg == -5
    assert scene.parts["my-pot"].thickness_m == 0.004
    assert scene.forces[0].value_ms2 == (3, 0, 0)


def test_a_flag_wins_over_preview_and_preview_over_the_scene_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "scene.yaml").write_text("input: b.splat\nsimulation: {grid: 100, fps: 30, cfl: 0.3}\n")
    words = ["generate", "-o", "run", "--scene", "deep/scene.yaml", "--preview", "--fps", "20"]
    scene = scene_from(parse(words))
    assert (scene.simulation.grid, scene.simulation.fps, scene.simulation.cfl) == (32, 20, 0.3)
    assert scene.input == tmp_path / "deep" / "b.splat"
    assert scene_from(parse([words[0], "c.splat", *words[1:]])).input == tmp_path / "c.splat"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["genrate"], "Did you mean 'generate'?"),
        (["generate", "a.splat", "-o", "run", "--hieght-m", "3"], "Did you mean '--height-m'?"),
        (["generate", "a.splat", "-o", "run", "--simulation.gird", "3"], "Did you mean 'grid'?"),
        (
            ["generate", "a.splat", "-o", "run", "--grid", "3"],
            "--grid: simulation.grid: expected 'auto' or a number of at least 8",
        ),
        (["generate", "a.splat", "-o", "run", "--motion", "swya"], "Did you mean 'sway'?"),
        (["generate", "a.splat", "-o", "run", "--until", "gruoping"], "Did you mean 'grouping'?"),
        (["generate", "a.splat", "-o", "run", "--up"], "--up"),
        (["generate", "a.splat", "-o", "run", "--simulation.grid"], "expected a value after it"),
        (["generate", "a.splat", "-o", "run", "--material", "pot"], "pot=ceramic"),
        (["generate", "a.splat", "-o", "run", "--part-name", "pot=0"], "0=pot"),
        (["generate", "a.splat", "-o", "run", "b.splat"], "'b.splat' is not an argument"),
        (["generate", "a.splat"], "-o RUN"),
        (["generate", "-o", "run"], "name the splat"),
        (["generate", "-o", "run", "--scene", "none.yaml"], "none.yaml: cannot read"),
        (["inspect"], "FILE"),
        (["simulate"], "RUN"),
        (["render", "none", "--overlay", "strian"], "Did you mean 'strain'?"),
        (["render", "none", "--simulation.grid", "64"], "'simulate none' takes this flag"),
        (["render", "none", "--widht", "64"], "Did you mean '--width'?"),
        (["simulate", "none", "--until", "gruoping"], "Did you mean 'grouping'?"),
        (["demo", "-o", "run", "--scene", "snowmen"], "Did you mean 'snowman'?"),
        (["convert", "a.ply"], "OUT"),
        (["inspect", "a.splat", "--simulation.grid", "3"], "'--simulation.grid' is not a flag"),
    ],
)
def test_a_wrong_command_line_is_one_sentence_and_exit_code_2(words, sentence, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    streams = capsys.readouterr()
    assert streams.out == ""
    assert streams.err.startswith("phys4dgen: ")
    assert streams.err.count("\n") == 1
    assert sentence in streams.err
    assert list(tmp_path.iterdir()) == []


def test_a_misspelt_key_in_a_scene_file_names_its_line(tmp_path, capsys):
    (tmp_path / "s.yaml").write_text("input: a.splat\nsimulation:\n  gird: 64\n")
    assert main(["generate", "-o", str(tmp_path / "run"), "--scene", str(tmp_path / "s.yaml")]) == 2
    assert "s.yaml line 3: 'simulation.gird' is not a key of a scene. Did you mean 'grid'?" in capsys.readouterr().err


def test_the_traceback_is_for_vv_only(tmp_path, capsys):
    words = ["inspect", str(tmp_path / "none.ply")]
    assert main(words) == 1
    assert capsys.readouterr().err.count("\n") == 1
    assert main([*words, "-vv"]) == 1
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.parametrize(
    "error", [RuntimeError("a bug"), MemoryError(), OSError(28, "No space left on device", "f.ply")]
)
def test_the_unexpected_is_one_sentence_too(error, monkeypatch, capsys):
    def fail(_arguments):
        raise error

    monkeypatch.setattr("phys4dgen.cli.inspect.run", fail)
    assert main(["inspect", "x"]) == 1
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert ("the disk is full at f.ply; make room" in message) == isinstance(error, OSError)
    assert message.startswith("phys4dgen: ")


def test_inspect_speaks_to_people_and_to_programs(tmp_path, random_gaussians, capsys):
    save_gaussians(random_gaussians(100, sh_degree=1), tmp_path / "a.ply")
    assert main(["inspect", str(tmp_path / "a.ply"), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["kind"], facts["count"], facts["sh_degree"]) == ("splat", 100, 1)
    assert main(["inspect", str(tmp_path / "a.ply")]) == 0
    assert "count: 100" in capsys.readouterr().out
    assert main(["inspect", str(tmp_path)]) == 1
    assert "run folder" in capsys.readouterr().err


@pytest.mark.parametrize("command", list(COMMANDS))
def test_help_lists_flags(command, capsys):
    assert main([command, "--help"]) == 0
    text = capsys.readouterr().out
    assert ("--simulation.grid" in text) == (command in ("generate", "demo", "simulate", "render", "identify"))


def test_help_of_the_program_is_quick():
    code = "import sys; from phys4dgen.cli import main; main(['--help']); print(*sorted(sys.modules))"
    began = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert time.perf_counter() - began < 3  # far above the 0.1 s of an idle machine
    assert "generate" in done.stdout
    heavy = {"numpy", "numba", "pydantic", "rich", "scipy"}
    assert heavy.isdisjoint(done.stdout.splitlines()[-1].split())


def test_plain_progress_says_what_it_is_told(capsys):
    progress = PlainProgress(sys.stderr)
    assert isinstance(progress, Progress)
    assert isinstance(SILENT, Progress)
    progress.stage("grouping")
    progress.update(1, 2, "views")
    progress.note("3 parts")
    progress.warn("the size is a guess")
    progress.stage("interior")
    progress.close()
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "grouping ..."
    assert "  3 parts" in lines
    assert "  warning: the size is a guess" in lines
    assert lines[-1].startswith("  interior took ")


def test_scene_from_needs_an_input():
    with pytest.raises(SceneError, match="name the splat"):
        scene_from(parse(["generate", "-o", "run"]))


def test_convert_keeps_every_value_that_the_format_has(tmp_path, random_gaussians, capsys):
    gaussians = random_gaussians(300, sh_degree=1)
    save_gaussians(gaussians, tmp_path / "a.ply")
    assert main(["convert", str(tmp_path / "a.ply"), str(tmp_path / "b.splat")]) == 0
    streams = capsys.readouterr()
    assert streams.out.strip() == str(tmp_path / "b.splat")
    assert "SH degree 1 becomes 0" in streams.err
    converted = load_gaussians(tmp_path / "b.splat")
    np.testing.assert_array_equal(converted.means, gaussians.means)
    np.testing.assert_allclose(converted.opacities, gaussians.opacities, atol=1 / 500)
    assert main(["convert", str(tmp_path / "a.ply"), str(tmp_path / "b.splat")]) == 1
    assert "--overwrite" in capsys.readouterr().err
    assert main(["convert", str(tmp_path / "a.ply"), str(tmp_path / "b.splat"), "--overwrite", "-q"]) == 0
    assert capsys.readouterr() == ("", "")
    assert main(["convert", str(tmp_path / "a.ply"), str(tmp_path / "c.compressed.ply")]) == 0
    assert "come in another order" in capsys.readouterr().err
    assert load_gaussians(tmp_path / "c.compressed.ply").sh_degree == 1
    assert main(["convert", str(tmp_path / "c.compressed.ply"), str(tmp_path / "d.ply"), "-q"]) == 0
    np.testing.assert_allclose(load_gaussians(tmp_path / "d.ply").means.mean(0), gaussians.means.mean(0), atol=1e-3)
    assert main(["convert", str(tmp_path / "a.ply"), str(tmp_path / "b.spz")]) == 1
    assert "later version" in capsys.readouterr().err


def findings(capsys):
    """What doctor says, by name."""
    return {finding["name"]: finding for finding in json.loads(capsys.readouterr().out)["findings"]}


def test_doctor_names_what_is_missing_and_never_a_key(monkeypatch, capsys):
    monkeypatch.setenv("OPENAI_API_KEY", "sk-do-not-print-me")
    monkeypatch.delenv("GEMINI_API_KEY", raising=False)
    assert main(["doctor", "--json"]) == 0
    text = capsys.readouterr().out
    assert "do-not-print-me" not in text
    found = {finding["name"]: finding for finding in json.loads(text)["findings"]}
    assert found["OPENAI_API_KEY"]["state"] == "ready"
    assert (found["GEMINI_API_KEY"]["state"], found["GEMINI_API_KEY"]["fix"]) == (
        "optional",
        "export GEMINI_API_KEY=...",
    )
    for name in ("processor", "threads", "compiled kernels", "ffmpeg", "disk"):
        assert found[name]["state"] == "ready"
    monkeypatch.setattr("phys4dgen.run.doctor._FREE_GB", 1e9)
    assert main(["doctor"]) == 1
    assert "MISSING disk" in capsys.readouterr().out


def test_doctor_finds_weights_or_names_the_command_that_gets_them(monkeypatch, capsys, tmp_path):
    pytest.importorskip("huggingface_hub", reason="the hub's cache is read by huggingface_hub")
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(tmp_path / "hub"))
    monkeypatch.setenv("U2NET_HOME", str(tmp_path / "u2net"))
    monkeypatch.setattr("pathlib.Path.home", lambda: tmp_path)
    assert main(["doctor", "--json"]) == 0
    absent = findings(capsys)
    assert {absent[f"{name} weights"]["state"] for name in ("SAM2", "CLIP", "LGM", "matte")} == {"optional"}
    assert absent["SAM2 weights"]["fix"] == "hf download facebook/sam2.1-hiera-tiny"
    assert absent["LGM weights"]["fix"] == "hf download ashawkey/LGM model_fp16_fixrot.safetensors"
    assert "isnet-general-use.onnx" in absent["matte weights"]["fix"]
    cached = tmp_path / "hub" / "models--facebook--sam2.1-hiera-tiny"
    (cached / "snapshots" / "abc").mkdir(parents=True)
    (cached / "refs").mkdir()
    (cached / "refs" / "main").write_text("abc")
    (cached / "snapshots" / "abc" / "model.safetensors").write_text("")
    (tmp_path / "u2net").mkdir()
    (tmp_path / "u2net" / "u2net.onnx").write_text("")
    assert main(["doctor", "--json"]) == 0
    there = findings(capsys)
    assert (there["SAM2 weights"]["state"], there["SAM2 weights"]["fix"]) == ("ready", "")
    assert "u2net.onnx" in there["matte weights"]["detail"]
    assert there["CLIP weights"]["state"] == "optional"


def test_doctor_names_the_extra_of_an_absent_package(monkeypatch, capsys):
    find_spec = importlib.util.find_spec
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name in TAKEN_AWAY else find_spec(name))
    assert main(["doctor", "--json"]) == 0
    found = findings(capsys)
    assert {name: found[name]["fix"] for name in TAKEN_AWAY if name in found} == {
        "torch": "pip install 'phys4dgen[models]'",
        "trimesh": "pip install 'phys4dgen[mesh]'",
        "openai": "pip install 'phys4dgen[mllm]'",
    }
    assert found["CLIP weights"]["fix"] == "pip install 'phys4dgen[models]'"


@pytest.mark.parametrize("command", ["simulate", "render"])
def test_a_folder_that_is_no_run_is_left_alone(command, tmp_path, capsys):
    assert main([command, str(tmp_path)]) == 1
    assert "expected a run folder" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
