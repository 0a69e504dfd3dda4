"""Programs of others as generators, well and badly behaved."""

import sys
import time

import numpy as np
import pytest

from phys4dgen.errors import SceneError, StageError
from phys4dgen.formats import save_gaussians
from phys4dgen.reconstruct.command import reconstruct_by_command
from phys4dgen.reconstruct.foreground import Cutout
from phys4dgen.scene import Scene


def run(script, *, timeout_s=30.0, extra=()):
    cutout = Cutout(np.ones((32, 32, 4), np.float32), "mask", ())
    argv = [sys.executable, "-c", f"import sys, os, pathlib, time, shutil; image, out = sys.argv[1:3]; {script}"]
    return reconstruct_by_command(cutout, [*argv, "{image}", "{out}", *extra], timeout_s=timeout_s)


def test_a_program_that_leaves_a_splat(random_gaussians, tmp_path):
    given = random_gaussians(50)
    save_gaussians(given, tmp_path / "given.ply")
    script = "assert open(image, 'rb').read(4) == b'\\x89PNG'; shutil.copy(sys.argv[3], out)"
    made = run(script, extra=[str(tmp_path / "given.ply")])
    np.testing.assert_array_equal(made.gaussians.means, given.means)
    assert made.backend.startswith("command")


@pytest.mark.parametrize(
    ("script", "message"),
    [
        ("sys.exit('no memory')", "failed with exit code 1; it said: no memory"),
        ("pass", "ended without writing"),
        ("open(out, 'w').write('garbage')", "did not leave a splat or mesh"),
        ("os.symlink('/etc/hostname', out)", "outside its folder"),
        ("os.mkdir(out)", "ended without writing"),
    ],
)
def test_a_program_that_misbehaves_ends_in_one_sentence(script, message):
    with pytest.raises(StageError, match=message) as raised:
        run(script)
    assert "\n" not in str(raised.value)


def test_a_program_that_hangs_is_ended_with_its_children():
    start = time.monotonic()
    with pytest.raises(StageError, match=r"ended after 1 s.*timeout_s"):
        run("os.fork(); time.sleep(60)", timeout_s=1.0)
    assert time.monotonic() - start < 20


def test_a_program_that_is_not_there():
    with pytest.raises(StageError, match="cannot be started"):
        reconstruct_by_command(Cutout(np.ones((8, 8, 4), np.float32), "mask", ()), ["/no/such/program"], timeout_s=1)


def test_the_scene_asks_for_both_program_and_backend():
    scene = Scene(input="a.png").with_overrides(
        {"reconstruct.backend": "command", "reconstruct.argv": ["prog", "{image}", "{out}"]}
    )
    assert scene.reconstruct.argv == ("prog", "{image}", "{out}")
    with pytest.raises(SceneError, match="argv"):
        Scene(input="a.png").with_overrides({"reconstruct.backend": "command"})
    with pytest.raises(SceneError, match=r"\{out\}"):
        Scene(input="a.png").with_overrides({"reconstruct.backend": "command", "reconstruct.argv": ["prog"]})


@pytest.mark.parametrize("suffix", [".glb", ".ply"])
def test_a_program_that_leaves_a_mesh(tmp_path, suffix):
    trimesh = pytest.importorskip("trimesh", reason="reading meshes needs trimesh (extra 'mesh')")
    trimesh.creation.icosphere(subdivisions=2).export(tmp_path / f"given{suffix}")
    cutout = Cutout(np.ones((32, 32, 4), np.float32), "mask", ())
    script = "import sys, shutil; shutil.copy(sys.argv[1], sys.argv[2])"
    mark = "{out}" if suffix == ".ply" else f"{{out{suffix}}}"
    argv = [sys.executable, "-c", script, str(tmp_path / f"given{suffix}"), mark]
    made = reconstruct_by_command(cutout, argv, timeout_s=30, mesh_gaussians=1500)
    assert len(made.gaussians) == pytest.approx(1500, rel=0.1)
    np.testing.assert_allclose(np.linalg.norm(made.gaussians.means, axis=1), 1, atol=0.06)
    with pytest.raises(StageError, match=r"ended without writing \{out.glb\}"):
        reconstruct_by_command(cutout, [sys.executable, "-c", "pass", "{out.glb}"], timeout_s=30)
