"""``simulation.scale: paper``: the numbers of the paper's appendix C."""

from types import SimpleNamespace

import numpy as np
import pytest

from phys4dgen.errors import SceneError
from phys4dgen.mpm import Settings
from phys4dgen.mpm.timestep import substeps_for
from phys4dgen.progress import SILENT
from phys4dgen.scene import Scene
from phys4dgen.stages.asset import load
from phys4dgen.stages.courant import tell_courant_numbers
from phys4dgen.stages.reconstruct import Source
from phys4dgen.types import Gaussians, Material, MaterialBook, PartMaterials

PAPER = {"simulation.scale": "paper"}


def paper(name, **more):
    return Scene(input=name).with_overrides({**PAPER, **more})


@pytest.mark.parametrize(("name", "substeps", "fps", "grid"), [("a.png", 714, 14, 25), ("a.splat", 400, 24, 32)])
def test_the_numbers_of_each_task(name, substeps, fps, grid):
    scene = paper(name)
    assert scene.paper_scale is not None
    assert scene.paper_scale.substeps == substeps
    assert scene.frame_time_s == pytest.approx(substeps * 5e-5)
    assert scene.fps == fps
    assert scene.frame_count == 2 * fps
    shell = np.random.default_rng(0).normal(size=(4000, 3)) * [1.0, 1.0, 3.0]
    gaussians = Gaussians(
        means=shell.astype(np.float32),
        quats_wxyz=np.tile(np.float32([1, 0, 0, 0]), (4000, 1)),
        scales=np.full((4000, 3), 0.01, np.float32),
        opacities=np.full(4000, 0.9, np.float32),
        sh=np.zeros((4000, 1, 3), np.float32),
    )
    asset = load(scene, Source(gaussians, "test", up=np.array([0.0, 0.0, 1.0])), SILENT)
    assert asset.height_m == pytest.approx(1.0)  # a unit object
    assert asset.grid == grid
    assert asset.cell_m == pytest.approx(1 / grid)  # in a cube of side 2 with twice as many cells


def test_what_the_user_says_comes_first():
    scene = paper("a.png", **{"simulation.fps": 30.0, "simulation.frame_time_s": 0.01})
    assert (scene.fps, scene.frame_time_s) == (30.0, 0.01)
    metres = Scene(input="a.png")
    assert (metres.fps, metres.frame_time_s, metres.paper_scale) == (24.0, 1 / 24, None)
    with pytest.raises(SceneError, match="paper makes the longest side one"):
        paper("a.png", height_m=0.3)


def test_a_frame_takes_the_papers_substeps_where_fewer_would_do():
    settings = Settings(dx_m=0.04, frame_time_s=714 * 5e-5, fewest_substeps_per_frame=714)
    assert substeps_for(1.0, 0.0, settings) == 714
    assert substeps_for(1.0, 0.0, settings, time_s=settings.frame_time_s / 2) == 357
    assert substeps_for(5000.0, 0.0, settings) > 714


def test_the_report_names_the_parts_that_the_papers_step_is_too_long_for():
    def made_of(modulus_pa):
        material = Material("m", "neo_hookean", 1000.0, modulus_pa, 0.3, "test")
        return PartMaterials(material, material)

    said = []
    book = MaterialBook({"leaf": made_of(1e6), "pot": made_of(10**9.3)})
    tell_courant_numbers(SimpleNamespace(cell_m=0.04), book, SimpleNamespace(warn=said.append))
    # c = sqrt(1.346 E / rho) = 1638 m/s crosses 0.04 in 2.4e-5 s
    assert len(said) == 1
    assert "'pot' is 2," in said[0]
