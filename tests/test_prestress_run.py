"""A whole run whose object carries its weight from the start: it stands still, goes on and is made anew rightly."""

import json

import numpy as np
import pytest

from lollipop import lollipop_scene
from phys4dgen.animate import Deformer
from phys4dgen.export.trajectory import read_trajectory
from phys4dgen.formats import load_gaussians
from phys4dgen.progress import Progress
from phys4dgen.run.generate import continue_run, generate, scene_of_run


class Stops(Progress):
    """Interrupts after some frames."""

    def update(self, done, total, what):
        if what == "frames simulated" and done == 3:
            raise KeyboardInterrupt


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    soft = {"parts__stick__material": "rubber", "parts__ball__material": "foam"}
    scene = lollipop_scene(
        tmp_path_factory.mktemp("input"), motion__preset="rest", gravity="on", simulation__chunks=1, **soft
    )
    return generate(scene, tmp_path_factory.mktemp("still") / "run", until="simulate")


def moved_m(root):
    positions = read_trajectory(root / "trajectory.npz").positions
    return np.linalg.norm(positions - positions[0], axis=2).max()


def test_all_gaussians_stay_where_they_were_captured(run):
    assert json.loads((run.root / "motion.json").read_text())["prestress"]["converged"]
    assert moved_m(run.root) < 0.005 * 0.2


def test_shown_covariances_begin_as_those_of_the_capture(run):
    gaussians = load_gaussians(run.root / "gaussians.ply")
    trajectory = read_trajectory(run.root / "trajectory.npz")
    packed = gaussians.covariances().reshape(-1, 9)[:, [0, 1, 2, 4, 5, 8]]
    for frame, atol in ((0, 1e-10), (1, 1e-6)):
        _, shown = Deformer(gaussians).deform(np.asarray(trajectory.deformation_gradients[frame]))
        np.testing.assert_allclose(shown, packed, atol=atol)


def test_a_stopped_run_goes_on_to_the_same_arrays(run, tmp_path):
    scene = scene_of_run(run.root)
    with pytest.raises(KeyboardInterrupt):
        generate(scene, tmp_path / "run", until="simulate", progress=Stops())
    generate(scene, tmp_path / "run", until="simulate")
    again, whole = (read_trajectory(root / "trajectory.npz") for root in (tmp_path / "run", run.root))
    np.testing.assert_array_equal(again.positions, whole.positions)
    np.testing.assert_array_equal(again.deformation_gradients, whole.deformation_gradients)


def test_without_it_the_same_run_is_simulated_again_and_sags(run):
    still_m = moved_m(run.root)
    scene = scene_of_run(run.root).with_overrides({"prestress": "off"})
    continue_run(run.root, scene, since="simulate", until="simulate")
    assert json.loads((run.root / "motion.json").read_text())["prestress"] is None
    assert moved_m(run.root) > 5 * still_m
