"""A picture through the pipeline: from the file to views of its Gaussians, and again from the run folder."""

import numpy as np
import pytest
from PIL import Image, ImageDraw

from phys4dgen.errors import SceneError
from phys4dgen.formats import load_gaussians
from phys4dgen.progress import SILENT
from phys4dgen.render.views import render_gaussians
from phys4dgen.run.folder import RunFolder
from phys4dgen.run.generate import generate
from phys4dgen.run.source_files import read_source
from phys4dgen.scene import Scene, load_scene
from phys4dgen.stages.asset import load
from phys4dgen.stages.views import look


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder = tmp_path_factory.mktemp("picture")
    picture = Image.new("RGB", (200, 200), (250, 250, 250))
    mask = Image.new("L", (200, 200))
    for target, color in ((picture, (190, 90, 50)), (mask, 255)):
        ImageDraw.Draw(target).polygon([(60, 40), (140, 40), (125, 170), (75, 170)], fill=color)
    picture.save(folder / "pot.png")
    mask.save(folder / "mask.png")
    (folder / "scene.yaml").write_text(
        "input: pot.png\nheight_m: 0.2\nreconstruct: {mask: mask.png, front_gaussians: 3000}\nviews: {size_px: 64}\n"
    )
    return load_scene(folder / "scene.yaml")


def test_a_picture_becomes_a_run_that_resumes(scene, tmp_path):
    assert scene.reconstruct.mask is not None
    assert scene.reconstruct.mask.is_absolute()
    run = generate(scene, tmp_path / "run", until="reconstruct")
    assert run.report["completed_until"] == "reconstruct"
    assert "stand-in" in run.report["backends"]["reconstruct"]
    assert any("stand-in" in warning for warning in run.report["warnings"])
    again = generate(scene, tmp_path / "run", until="views")
    assert again.report["reused"] == ["reconstruct"]
    gaussians = load_gaussians(tmp_path / "run" / "gaussians.ply")
    assert 1000 < len(gaussians) < 20_000
    source = read_source(RunFolder(tmp_path / "run"), scene)
    np.testing.assert_array_equal(source.gaussians.means, gaussians.means)
    asset = load(scene, source, SILENT)
    np.testing.assert_allclose(asset.frame.up, [0, 1, 0], atol=1e-12)
    assert asset.height_m == pytest.approx(0.2)
    assert asset.solid is not None
    assert asset.solid.contains(gaussians.means.mean(0, keepdims=True)).all()
    assert source.camera is not None
    pixels, _ = source.camera.project(gaussians.means)
    assert (pixels > 0).all()
    assert (pixels < source.camera.width).all()
    assert source.even_colors is not None
    assert source.even_colors.shape == gaussians.means.shape
    views = look(scene, asset, SILENT)
    canonical = views.cameras[0]
    assert len(views) == 29
    np.testing.assert_array_equal(canonical.viewmat, source.camera.viewmat)
    assert (canonical.width, canonical.height) == (64, 64)
    # at 64 pixels the rim alone is several percent of this small pot, so its outline is compared at 128
    outline = Image.fromarray(source.picture[..., 3]).resize((128, 128), Image.Resampling.BOX)
    shown = render_gaussians(asset.gaussians, canonical.resized(128, 128)).alpha > 0.5
    inside = np.asarray(outline) > 0.5
    assert (shown & inside).sum() / (shown | inside).sum() > 0.95
    others = np.array([camera.viewmat[2, :3] @ canonical.viewmat[2, :3] for camera in views.cameras[1:]])
    assert others.max() < 0.95  # the next is 20 degrees away: the view of the table that looks the same way is left out


def test_a_mask_and_a_network_at_once_are_refused():
    with pytest.raises(SceneError, match="keep one of them"):
        Scene(input="a.png").with_overrides({"reconstruct.mask": "m.png", "reconstruct.matte_model": "n.onnx"})
