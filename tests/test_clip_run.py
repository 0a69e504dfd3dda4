"""Names from a picture, CLIP and a program as identifiers, in whole runs of a small object."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from PIL import Image

from lollipop import lollipop
from phys4dgen.errors import SceneError, StageError
from phys4dgen.formats import save_gaussians
from phys4dgen.materials import read_materials
from phys4dgen.render.cameras import orbit_camera
from phys4dgen.render.views import render_gaussians, render_labels
from phys4dgen.run.artefacts import read_groups
from phys4dgen.run.folder import RunFolder
from phys4dgen.run.generate import continue_run, generate
from phys4dgen.scene import Scene, refuse_impossible_part_names
from tiny_checkpoints import tiny_clip

NAMES = ("foot", "stick", "candy")


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """The lollipop with its true parts, and a dim picture of it from 15 degrees beside the front with its names."""
    folder = tmp_path_factory.mktemp("input")
    gaussians, labels = lollipop()
    save_gaussians(gaussians, folder / "lollipop.ply")
    np.save(folder / "labels.npy", labels)
    camera = orbit_camera(
        azimuth_deg=15.0, elevation_deg=20.0, target=(0, 0, 0.1), rotation=np.eye(3), radius=0.35, fovy_deg=49.1,
        width=120, height=120,
    )  # fmt: skip
    rgb = 0.7 * np.clip(render_gaussians(gaussians, camera).rgb, 0, 1)
    Image.fromarray(np.rint(255 * rgb).astype(np.uint8)).save(folder / "photo.png")
    segments = render_labels(gaussians, labels, camera)
    Image.fromarray(np.where(segments >= 0, 50 * segments + 20, 0).astype(np.uint8)).save(folder / "segments.png")
    named = {
        "picture": folder / "photo.png",
        "segments": folder / "segments.png",
        "names": {50 * number + 20: name for number, name in enumerate(NAMES)},
        "compare": "descriptor",
    }
    return Scene(input=folder / "lollipop.ply").with_overrides(
        {
            "up": "z",
            "height_m": 0.2,
            "views.size_px": 64,
            "simulation.grid": 24,
            "grouping.labels_file": folder / "labels.npy",
            "grouping.named_picture": named,
        }
    )


@pytest.fixture(scope="module")
def run(scene, tmp_path_factory):
    return generate(scene, tmp_path_factory.mktemp("runs") / "run", until="materials")


def test_parts_bear_the_names_of_the_picture_and_the_report_says_how(run):
    assert read_groups(RunFolder(run.root)).names == NAMES
    said = [note for note in run.report["notes"] if "of the picture" in note]
    assert len(said) == 3
    assert all("colour and shape (stand-in for CLIP)" in note and "ahead of the next" in note for note in said)


def test_a_name_of_the_picture_may_be_used_before_the_parts_are_found(scene):
    unlabelled = scene.with_overrides({"grouping.labels_file": None})
    refuse_impossible_part_names(unlabelled.with_overrides({"parts.candy.material": "wax"}))
    with pytest.raises(SceneError, match="no part 'cndy'"):
        refuse_impossible_part_names(unlabelled.with_overrides({"parts.cndy.material": "wax"}))


def test_a_program_names_the_materials_from_the_run_folder(run, scene):
    script = (
        "import sys, numpy; names = numpy.load(sys.argv[1] + '/groups.npz')['names'].tolist();"
        "open(sys.argv[2], 'w').write('parts: {' + names[2] + ': {surface: wax}, ' + names[1] + ': {surface: paper}}')"
    )
    argv = (sys.executable, "-c", script, "{run}", "{out}")
    wanted = scene.with_overrides({"materials.backend": "command", "materials.argv": argv})
    made = continue_run(run.root, wanted, since="materials", until="materials")
    found = read_materials(made.root / "materials.yaml")
    assert found["candy"].surface.name == "wax"
    assert found["candy"].surface.source.startswith("command:")
    assert found["foot"].surface.source in ("rule", "default")


def test_clip_names_the_materials_of_all_parts_that_are_seen(run, scene, tmp_path):
    pytest.importorskip("torch", reason="CLIP needs torch: pip install 'phys4dgen[models]'")
    pytest.importorskip("transformers", reason="CLIP needs transformers: pip install 'phys4dgen[models]'")
    folder = tiny_clip(tmp_path / "clip")
    wanted = scene.with_overrides({"materials.backend": "clip", "clip.weights": str(folder)})
    made = continue_run(run.root, wanted, since="materials", until="materials")
    for materials in read_materials(made.root / "materials.yaml").values():
        assert materials.surface.source == "clip"
        assert ", next " in materials.surface.evidence


def test_clip_by_name_without_weights_is_an_error(run, scene, monkeypatch, tmp_path):
    pytest.importorskip("transformers", reason="weights are looked for only where transformers is")
    monkeypatch.setenv("HF_HUB_CACHE", str(tmp_path))
    wanted = scene.with_overrides({"materials.backend": "clip", "clip.weights": "nobody/nothing"})
    with pytest.raises(StageError, match="'hf download nobody/nothing' gets them"):
        continue_run(run.root, wanted, since="materials", until="materials")
