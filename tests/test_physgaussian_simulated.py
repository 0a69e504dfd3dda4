"""Scenes of PhysGaussian as simulated: velocities, layers, time steps and fillings are those of its own solver."""

import numpy as np
import pytest

from phys4dgen.formats import load_gaussians
from phys4dgen.stages.motion_loads import LoadMaker
from phys4dgen.stages.motion_obstacles import ObstacleMaker
from phys4dgen.types import Continuum, Frame, Parts, rotation_to_z_up
from physgaussian_importing import importing_into, mentions, of_kind, placed
from physgaussian_scenes import CONFIGURATIONS, write_model


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    folder = tmp_path_factory.mktemp("model")
    write_model(folder)
    return folder


@pytest.fixture
def run(model, tmp_path):
    """Imports a configuration, by name or as a dictionary."""
    return importing_into(tmp_path, model)


def as_simulated(imported):
    """The Gaussians as particles, and what turns the scene's forces and boundaries into the solver's."""
    scene, gaussians = imported.scene, load_gaussians(imported.scene.input)
    rotation = rotation_to_z_up(np.array(scene.up))
    lower, upper = gaussians.robust_bounds(rotation=rotation)
    frame = Frame(rotation, scene.longest_m / float((upper - lower).max()))
    count = len(gaussians)
    nothing = np.zeros(count, np.int32)
    continuum = Continuum(
        positions=gaussians.means.astype(np.float64),
        part=nothing,
        is_interior=np.zeros(count, bool),
        volume_m3=np.ones(count),
        gaussian_index=np.arange(count, dtype=np.int32),
        piece=nothing,
        shape=nothing.astype(np.int8),
        thickness_m=np.full(count, np.nan),
        thickness_measured=np.zeros(count, bool),
        offset_m=np.zeros((count, 3)),
        site=np.arange(count),
        spacing_m=0.02,
    )
    parts = Parts(labels=nothing, names=("object",), backend="test")
    points_m = frame.to_metres(gaussians.means)
    loads = LoadMaker(frame, parts, continuum, np.ones(count), scene.longest_m)
    return loads, ObstacleMaker(frame, points_m, margin_m=0.01, cell_m=0.04), points_m


@pytest.mark.parametrize("name", ["coin", "heap", "clay"])
def test_a_metre_of_the_solver_is_a_unit_of_mpm_space(run, model, name):
    """Distances of the particles to every plane, and velocities of blocks, as PhysGaussian has them."""
    config, gaussians, placement = placed(model, name)
    places = placement.to_mpm(gaussians.means)
    imported = run(name)
    _, obstacles, points_m = as_simulated(imported)
    planes = [c for c in config.boundary_conditions if c.type == "surface_collider"]
    found = [s.obstacle for s in obstacles.solids(of_kind(imported.scene.boundaries, "plane"))]
    assert len(planes) == len(found) > 0
    for condition, obstacle in zip(planes, found, strict=True):
        normal = np.array(condition.normal) / np.linalg.norm(condition.normal)
        there = (places - condition.point) @ normal
        np.testing.assert_allclose(obstacle.shape.distances(points_m)[0], there, atol=1e-4)


def test_a_turn_gives_the_velocities_of_physgaussian(run, model):
    config, gaussians, placement = placed(model, "cake")
    condition = config.boundary_conditions[1]
    imported = run("cake")
    loads, _, points_m = as_simulated(imported)
    drive = loads.drives(imported.scene.forces, (), held=np.zeros(len(points_m), bool))[0]
    # its formula: theta from axis_1 towards axis_2 = axis_1 x normal
    normal = np.array(condition.normal, float)
    axis_1 = np.ones(3) - normal.sum() * normal
    axis_1 /= np.linalg.norm(axis_1)
    axis_2 = np.cross(axis_1, normal)
    offset = placement.to_mpm(gaussians.means) - condition.point
    away = np.linalg.norm(offset - (offset @ normal)[:, None] * normal, axis=1)
    theta = np.arctan2(offset @ axis_2, offset @ axis_1)
    speed = away * condition.rotation_scale
    there = -(speed * np.sin(theta))[:, None] * axis_1 + (speed * np.cos(theta))[:, None] * axis_2
    there += condition.translation_scale * normal
    assert drive.chosen.sum() > 20
    np.testing.assert_allclose(drive.velocities_ms(points_m, 0.0), there, atol=1e-4)


def test_layers_are_let_go_when_physgaussian_does(run, model):
    config, gaussians, placement = placed(model, "heap")
    heap = run("heap")
    release = of_kind(heap.scene.boundaries, "release")[0]
    np.testing.assert_allclose(release.direction, (0, 1, 0), atol=1e-9)
    assert mentions(heap, "num_layers")
    assert mentions(heap, "beyond end_position")
    condition = config.boundary_conditions[1]
    places = placement.to_mpm(gaussians.means)
    reach = abs(condition.end_position - condition.start_position)
    # fifty boxes about end_position, each a fiftieth smaller and held a fiftieth longer
    there = np.zeros(len(places))
    for layer in range(50):
        half = np.array([1, 1, reach / 50 * (50 - layer)])
        inside = (np.abs(places - [1, 1, condition.end_position]) < half).all(1)
        there[inside] = condition.end_time / 50 * (layer + 1)
    loads, _, _ = as_simulated(heap)
    drives = loads.drives((), heap.scene.boundaries, held=np.zeros(len(places), bool))
    here = np.max([np.where(drive.chosen, drive.let_go_s, 0) for drive in drives], axis=0)
    held = there > 0
    assert 0.5 < held.mean() < 1
    assert np.abs(here - there)[held].max() < 1.5 * condition.end_time / 50
    assert (here[~held] == 0).mean() > 0.95


def test_time_steps_that_do_not_divide_a_frame(run):
    corrected, compat = run("cake"), run("cake", "compat")
    assert corrected.scene.simulation.frame_time_s == 0.04
    assert compat.scene.simulation.frame_time_s == pytest.approx(1999 * 2e-5)
    assert mentions(corrected, "1999 substeps")
    assert mentions(compat, "1999 substeps")


def test_a_time_step_on_which_physgaussian_blows_up(run):
    assert mentions(run({**CONFIGURATIONS["leaf"], "E": 2e9}), "substep_dt", "9.2 cells")
    assert not mentions(run("leaf"), "substep_dt: a wave")


def test_inside(run):
    assert run("leaf").scene.interior.method == "none"
    assert run("cake").scene.interior.method != "none"
    assert mentions(run("cake"), "particle_filling")
    assert run("cake", "compat").scene.interior.particles == "gaussians"
