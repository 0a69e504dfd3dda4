"""The how-tos of docs/howto work by copying their commands."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from phys4dgen.formats import save_gaussians
from phys4dgen.render.cameras import view_cameras
from phys4dgen.render.views import render_views
from phys4dgen.zoo import bundled

HOWTOS = sorted((Path(__file__).parents[1] / "docs" / "howto").glob("*.md"))


def commands(page):
    """Lines that start with ``$`` in the console blocks of a page."""
    blocks = re.findall(r"```console\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    return [line[2:] for block in blocks for line in block.splitlines() if line.startswith("$ ")]


def draw_duck(path):
    """The bundled duck as a picture with an alpha channel."""
    duck = bundled("rubber_duck").gaussians
    lower, upper = duck.robust_bounds()
    camera = view_cameras("object", lower=lower, upper=upper, rotation=np.eye(3), size_px=256)[0]
    view = render_views(duck, [camera])
    rgba = np.concatenate([view.rgb[0], view.alpha[0][..., None]], -1)
    Image.fromarray(np.rint(255 * np.clip(rgba, 0, 1)).astype(np.uint8)).save(path)


def build_duck(path):
    """A mesh in the place of a duck."""
    trimesh = pytest.importorskip("trimesh", reason="reading meshes needs trimesh (extra 'mesh')")
    trimesh.creation.capsule(height=1, radius=0.5).export(path)


def write_physgaussian(folder):
    """A configuration and a model of PhysGaussian."""
    place = folder / "model" / "point_cloud" / "iteration_30000"
    place.mkdir(parents=True)
    save_gaussians(bundled("rubber_duck").gaussians, place / "point_cloud.ply")
    (folder / "config.json").write_text('{"material": "jelly", "E": 1e5, "nu": 0.4, "g": [0, 0, -9.8]}')


def test_there_are_six_pages_with_commands():
    assert len(HOWTOS) >= 6
    assert all(commands(page) for page in HOWTOS)


@pytest.mark.parametrize("page", HOWTOS, ids=lambda page: page.stem)
def test_the_commands_of_a_page_work(page, tmp_path):
    lines = commands(page)
    if any("plant.ply" in line for line in lines):
        save_gaussians(bundled("potted_flower").gaussians, tmp_path / "plant.ply")
    if any("duck.png" in line for line in lines):
        draw_duck(tmp_path / "duck.png")
    if any("import-physgaussian" in line for line in lines):
        write_physgaussian(tmp_path)
    if any("duck.glb" in line for line in lines):
        build_duck(tmp_path / "duck.glb")
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    there = {"cwd": tmp_path, "env": {**os.environ, "PATH": path}}
    for line in lines:
        done = subprocess.run(shlex.split(line), **there, capture_output=True, text=True, timeout=300, check=False)
        assert done.returncode == 0, f"{line}\n{done.stderr[-2000:]}"
