"""Overlays say what is true: strain by theory, colours by part, arrows where and when something pushes."""

import json

import numpy as np
import pytest
from PIL import Image

from lollipop import lollipop
from phys4dgen.cli import main
from phys4dgen.errors import RunError
from phys4dgen.export.annotate import Arrow, draw_arrows, strain_colors, with_legend, with_scale_bar
from phys4dgen.export.pictures import part_colors
from phys4dgen.formats import save_gaussians
from phys4dgen.run.generate import generate
from phys4dgen.scene import Scene
from phys4dgen.stages.overlays import equivalent_strain


def test_equivalent_strain_of_textbook_deformations():
    stretch = 1.01
    rod = np.diag([stretch, stretch**-0.5, stretch**-0.5])  # pulled, incompressible
    shear = np.eye(3) + 0.02 * np.outer([1, 0, 0], [0, 1, 0])
    angle = 0.7
    turned = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    strains = equivalent_strain(np.array([np.eye(3), turned, 1.3 * np.eye(3), rod, turned @ rod, shear], np.float32))
    expected = [0, 0, 0, np.log(stretch), np.log(stretch), 0.02 / np.sqrt(3)]
    np.testing.assert_allclose(strains, expected, atol=2e-6)


def test_strain_colours_get_darker_all_the_way():
    luma = strain_colors(np.linspace(0, 1, 50)) @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(luma) < 0).all()
    np.testing.assert_array_equal(strain_colors(np.array([1.0])), strain_colors(np.array([7.0])))


@pytest.mark.parametrize("background", [0, 255])
def test_legends_are_below_the_picture_and_legible(background):
    image = np.full((40, 200, 3), background, np.uint8)
    for shown in (with_legend(image, [((200, 30, 30), "pot"), (None, "t = 0.1 s")]), with_scale_bar(image, "x", "01")):
        np.testing.assert_array_equal(shown[:40], image)
        assert shown.shape[0] > 60
        assert np.ptp(shown[40:].astype(int)) > 180  # ink on paper
    rows = with_legend(image, [((9, 9, 9), "a rather long name of a part")] * 4)
    assert len(rows) - 40 > 2 * (len(with_legend(image, [(None, "a")])) - 40)  # it wraps


def test_an_arrow_lies_between_its_ends():
    image = np.full((100, 200, 3), 255, np.uint8)
    drawn = draw_arrows(image, [Arrow((40, 50), (120, 50), (200, 0, 0))])
    coloured = np.argwhere(drawn[:, :, 1] < 128)
    assert abs(coloured[:, 1].min() - 40) <= 3
    assert abs(coloured[:, 1].max() - 120) <= 3
    assert abs(coloured[:, 0].mean() - 50) < 1
    near_the_tip = coloured[coloured[:, 1] > 100]
    assert np.ptp(near_the_tip[:, 0]) > 2 * np.ptp(coloured[coloured[:, 1] < 90][:, 0])
    end_on = draw_arrows(image, [Arrow((60, 50), (61, 50), (200, 0, 0), 1.0)])
    assert (end_on[50, 61] > 200).all()  # the dot of one that comes towards the viewer
    np.testing.assert_array_equal(draw_arrows(image, []), image)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("overlay")
    gaussians, labels = lollipop()
    save_gaussians(gaussians, folder / "a.ply")
    np.savez(folder / "labels.npz", labels=labels, names=np.array(["block", "stick", "ball"]))
    scene = Scene(input=folder / "a.ply").with_overrides(
        {
            "up": "z", "height_m": 0.2, "grouping.labels_file": folder / "labels.npz", "parts.block.hold": "fixed",
            "forces": ({"part": "ball", "value_ms2": (2.0, 0.0, 0.0), "to_s": 0.1},),
            "simulation.grid": 16, "simulation.duration_s": 0.25, "simulation.max_substeps": 60, "views.size_px": 64,
            "output.video.width": 240, "output.video.orbit_deg": 0.0, "output.frames": "none",
        }
    )  # fmt: skip
    return generate(scene, folder / "run", until="simulate")


def test_overlays_leave_the_run_as_it_is(run, capsys):
    before = {path: path.read_bytes() for path in run.root.rglob("*") if path.is_file()}
    for name in ("parts", "material", "strain", "forces"):
        assert main(["render", str(run.root), "--overlay", name, "-q"]) == 0
        assert (run.root / "overlays" / f"{name}.mp4").stat().st_size > 1000
        with Image.open(run.root / "overlays" / f"{name}.png") as sheet:
            assert sheet.width > 200
    touched = [path.name for path, content in before.items() if path.read_bytes() != content]
    assert set(touched) <= {"log.jsonl", ".lock", ".state.json"}
    assert json.loads((run.root / "report.json").read_text("utf-8")) == run.report


def test_the_parts_have_the_colours_of_their_legend(run):
    assert main(["render", str(run.root), "--overlay", "parts", "--background", "black", "-q"]) == 0
    with Image.open(run.root / "overlays" / "parts.png") as sheet:
        pixels = np.asarray(sheet.convert("RGB")).reshape(-1, 3).astype(float)
    lit = pixels[(pixels.max(1) > 90) & (np.ptp(pixels, axis=1) > 40)]
    lit /= np.linalg.norm(lit, axis=1, keepdims=True)
    for color in part_colors(3).astype(float):
        assert ((lit @ (color / np.linalg.norm(color))) > 0.995).sum() > 100


def test_what_is_not_simulated_has_no_overlay(tmp_path, run):
    from phys4dgen.run.overlays import render_overlay

    scene = Scene(input=tmp_path / "a.ply")
    with pytest.raises(RunError, match="phys4dgen simulate"):
        render_overlay(tmp_path, scene, "strain")
