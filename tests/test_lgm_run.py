"""LGM from pictures to Gaussians, with a narrow network of random weights."""

import json
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from lgm_tiny import TINY, safetensors_bytes, tiny_weights
from phys4dgen.errors import SceneError, StageError
from phys4dgen.progress import SILENT
from phys4dgen.reconstruct.foreground import Cutout
from phys4dgen.reconstruct.lgm import configuration, generator
from phys4dgen.reconstruct.lgm.four_views import FourViews
from phys4dgen.reconstruct.lgm.generator import Lgm, reconstruct_by_lgm
from phys4dgen.reconstruct.lgm.rays import view_cameras
from phys4dgen.run.generate import generate
from phys4dgen.scene import Scene, dump_scene, load_scene
from phys4dgen.stages.reconstruct import reconstruct

TORCH = "LGM needs torch (extra 'models')"


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory):
    pytest.importorskip("torch", reason=TORCH)
    path = tmp_path_factory.mktemp("lgm") / "tiny.safetensors"
    path.write_bytes(safetensors_bytes(tiny_weights()))
    return path


def four_views(seed=0):
    rng = np.random.default_rng(seed)
    alpha = np.zeros((4, 32, 32), np.float32)
    alpha[:, 8:24, 8:24] = 1
    return FourViews(rng.uniform(0, 1, (4, 32, 32, 3)).astype(np.float32), alpha, "test")


def test_four_views_become_gaussians(checkpoint):
    made = reconstruct_by_lgm(four_views(), checkpoint, config=TINY)
    assert 100 < len(made.gaussians) <= TINY.gaussian_count
    assert np.abs(made.gaussians.means).max() <= 1
    assert made.gaussians.opacities.min() >= 0.005
    assert made.facts["transparent_share"] == pytest.approx(1 - len(made.gaussians) / 1024)
    assert made.backend == "LGM, test"
    np.testing.assert_array_equal(made.camera.viewmat, view_cameras(32)[0].viewmat)
    assert made.picture.shape == (32, 32, 4)
    again = reconstruct_by_lgm(four_views(), checkpoint, config=TINY)
    np.testing.assert_array_equal(again.gaussians.means, made.gaussians.means)
    other = reconstruct_by_lgm(four_views(1), checkpoint, config=TINY)
    assert np.abs(other.gaussians.means[:50] - made.gaussians.means[:50]).max() > 1e-3


def test_a_multi_view_generator_stands_before_it(checkpoint):
    seen = []

    def imagine(cutout):
        seen.append(cutout)
        return four_views()

    cutout = Cutout(np.ones((8, 8, 4), np.float32), "mask", ("it is cut off",))
    made = Lgm(checkpoint, imagine, config=TINY)(cutout)
    assert seen == [cutout]
    assert made.warnings == ("it is cut off",)


def test_without_torch_it_says_what_to_install(monkeypatch):
    monkeypatch.setattr(generator, "torch_is_installed", lambda: False)
    with pytest.raises(StageError, match=r"phys4dgen\[models\]"):
        reconstruct_by_lgm(four_views(), None, config=TINY)


@pytest.fixture
def scene(tmp_path):
    """Of four pictures of a square, beside a checkpoint that is yet to be written."""
    for view in range(4):
        picture = Image.new("RGBA", (64, 64))
        picture.paste((50 * view, 90, 200, 255), (16, 16, 48, 48))
        picture.save(tmp_path / f"{view}.png")
    text = "input: 0.png\nreconstruct: {checkpoint: tiny.safetensors, views: [0.png, 1.png, 2.png, 3.png]}\n"
    (tmp_path / "scene.yaml").write_text(text)
    return load_scene(tmp_path / "scene.yaml")


def test_paths_are_taken_from_the_scene_file(scene, tmp_path):
    assert scene.reconstruct.checkpoint == tmp_path / "tiny.safetensors"
    assert scene.reconstruct.views[3] == tmp_path / "3.png"
    (tmp_path / "again.yaml").write_text(dump_scene(scene))
    assert load_scene(tmp_path / "again.yaml") == scene


def test_a_run_with_lgm_is_resumed_from_its_folder(scene, checkpoint, tmp_path, monkeypatch):
    monkeypatch.setattr(configuration, "BIG", TINY)
    monkeypatch.setattr(generator.reconstruct_by_lgm, "__kwdefaults__", {"config": TINY})
    (tmp_path / "tiny.safetensors").write_bytes(checkpoint.read_bytes())
    scene = scene.with_overrides({"views.size_px": 64})
    run = generate(scene, tmp_path / "run", until="reconstruct")
    facts = json.loads((run.root / "reconstruct" / "source.json").read_text())
    assert facts["backend"] == "LGM, four views given"
    assert facts["up"] == [0, 1, 0]
    generate(scene, tmp_path / "run", until="views")


def test_auto_without_torch_takes_the_stand_in_and_says_so(scene, monkeypatch):
    monkeypatch.setattr(generator, "torch_is_installed", lambda: False)
    said = []
    monkeypatch.setattr(type(SILENT), "warn", lambda self, text: said.append(text))
    made = reconstruct(scene, SILENT)
    assert made.backend.startswith("inflate (stand-in)")
    assert any("torch is not installed" in text for text in said)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"reconstruct.backend": "lgm"}, "needs checkpoint"),
        ({"reconstruct.checkpoint": "a.safetensors"}, "four views together, got 0"),
        ({"reconstruct.views": ["a.png"] * 4}, "needs checkpoint and four views"),
        ({"reconstruct.checkpoint": "a", "reconstruct.views": ["a.png"] * 3}, "got 3 views"),
        (
            {"reconstruct.checkpoint": "a", "reconstruct.views": ["a"] * 4, "reconstruct.backend": "inflate"},
            "backend is 'inflate'",
        ),
    ],
)
def test_the_scene_wants_checkpoint_and_views_together(overrides, message):
    with pytest.raises(SceneError, match=message):
        Scene(input="a.png").with_overrides(overrides)


def test_the_package_is_imported_without_torch():
    code = "import sys, phys4dgen.reconstruct.lgm.generator; print('torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
