"""The how-tos of docs/howto work by copying their commands.

To be quick about it, every page but one is run in this process, with a preview that is coarser than the user's, and the
bundled objects have every fourth of their Gaussians; the commands are the documented ones, word by word.
"""

import os
import re
import shlex
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from phys4dgen.cli import arguments, main
from phys4dgen.formats import save_gaussians
from phys4dgen.render.cameras import view_cameras
from phys4dgen.render.views import render_views
from phys4dgen.zoo import bundled

COARSER = {"simulation.grid": 24, "simulation.duration_s": 0.25}
"""In the place of the same settings of ``--preview``."""
AS_INSTALLED = "from-a-picture"
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


def thinned(name, *, seed=0):
    """A bundled object with every fourth of its Gaussians, twice as large."""
    whole = bundled(name, seed=seed)
    few = whole.gaussians.subset(np.arange(0, len(whole.gaussians), 4))
    return replace(whole, gaussians=replace(few, scales=2 * few.scales), labels=whole.labels[::4])


def run_as_installed(line, folder):
    """As a person does."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    there = {"cwd": folder, "env": {**os.environ, "PATH": path}}
    done = subprocess.run(shlex.split(line), **there, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, f"{line}\n{done.stderr[-2000:]}"


@pytest.fixture
def run_here(monkeypatch, capsys):
    """Runs a command of phys4dgen in this process, coarser."""
    for key, value in COARSER.items():
        assert key in arguments._PREVIEW
        monkeypatch.setitem(arguments._PREVIEW, key, value)
    monkeypatch.setattr("phys4dgen.run.demo.bundled", thinned)

    def run(line, folder):
        program, *words = shlex.split(line)
        if program != "phys4dgen":
            return run_as_installed(line, folder)
        with monkeypatch.context() as patch:
            patch.chdir(folder)
            assert main(words) == 0, f"{line}\n{capsys.readouterr().err[-2000:]}"

    return run


def prepare(lines, folder):
    """The files of the person who reads the page."""
    if any("plant.ply" in line for line in lines):
        save_gaussians(thinned("potted_flower").gaussians, folder / "plant.ply")
    if any("duck.png" in line for line in lines):
        draw_duck(folder / "duck.png")
    if any("import-physgaussian" in line for line in lines):
        write_physgaussian(folder)
    if any("two.yaml" in line for line in lines):
        page = next(page for page in HOWTOS if page.stem == "several-objects")
        (folder / "two.yaml").write_text(page.read_text("utf-8").split("```yaml\n")[1].split("```")[0])
        for file, name in (("ball.ply", "basketball"), ("castle.ply", "sandcastle")):
            save_gaussians(thinned(name).gaussians, folder / file)
    if any("duck.glb" in line for line in lines):
        build_duck(folder / "duck.glb")


@pytest.mark.parametrize("page", HOWTOS, ids=lambda page: page.stem)
def test_the_commands_of_a_page_work(page, tmp_path, run_here):
    lines = commands(page)
    prepare(lines, tmp_path)
    run = run_as_installed if page.stem == AS_INSTALLED else run_here
    for line in lines:
        run(line, tmp_path)
