"""Scenes of PhysGaussian: every key and boundary type arrives, or is named among the differences."""

import math

import numpy as np
import pytest

from phys4dgen.errors import SceneError
from phys4dgen.formats import load_gaussians
from phys4dgen.grouping.from_file import parts_from_file
from phys4dgen.materials import read_materials
from phys4dgen.physgaussian.boundary_types import BOUNDARY_TYPES
from phys4dgen.physgaussian.configuration import MATERIALS, Configuration, Filling, RegionMaterial
from phys4dgen.physgaussian.masses import particle_masses
from phys4dgen.scene import sections
from phys4dgen.stages.motion_loads import in_region
from physgaussian_importing import MODES, importing_into, mentions, of_kind, placed
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


def test_the_six_use_every_key_every_material_and_every_boundary_type():
    used = set().union(*CONFIGURATIONS.values())
    assert used == set(Configuration.model_fields)
    assert {config["material"] for config in CONFIGURATIONS.values()} == set(MATERIALS)
    assert set(CONFIGURATIONS["cake"]["particle_filling"]) == set(Filling.model_fields)
    regions = CONFIGURATIONS["coin"]["additional_material_params"]
    assert set().union(*regions) == set(RegionMaterial.model_fields)
    conditions = [entry for config in CONFIGURATIONS.values() for entry in config.get("boundary_conditions", [])]
    for kind, keys in BOUNDARY_TYPES.items():
        of_it = [entry for entry in conditions if entry["type"] == kind]
        assert set().union(*of_it) == set(keys.model_fields), kind
    surfaces = {entry["surface"] for entry in conditions if entry["type"] == "surface_collider"}
    assert surfaces == {"sticky", "slip", "separate", "cut"}


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_every_configuration_imports_in_both_modes(run, name, mode):
    imported = run(name, mode)
    assert all(path.is_file() for path in imported.files)
    assert imported.scene.frame_count == Configuration.model_validate(CONFIGURATIONS[name]).frame_num
    conditions = CONFIGURATIONS[name]["boundary_conditions"]
    arrived = len(imported.scene.forces) + len(imported.scene.boundaries)
    assert arrived >= len(conditions)
    text = imported.scene_yaml.read_text()
    assert all(f"# - {difference}" in text for difference in imported.differences)
    names = tuple(imported.scene.parts)
    assert set(read_materials(imported.scene.materials.file, names)) == set(names)


def test_coordinates_go_there_and_back(model):
    config, gaussians, placement = placed(model, "heap")
    mpm = placement.to_mpm(gaussians.means)
    extent = mpm.max(0) - mpm.min(0)
    assert extent.max() == pytest.approx(config.scale)
    np.testing.assert_allclose((mpm.max(0) + mpm.min(0)) / 2, 1, atol=1e-6)
    for index in range(3):
        np.testing.assert_allclose(placement.point(mpm[index]), gaussians.means[index], atol=1e-6)
    # 90 deg about x, then 30 deg about z: y goes to z, x to (cos 30, sin 30, 0)
    np.testing.assert_allclose(placement.vector((0, 0, 1)), (0, 1, 0), atol=1e-9)
    np.testing.assert_allclose(placement.vector((math.cos(math.pi / 6), 0.5, 0)), (1, 0, 0), atol=1e-9)


def test_a_box_of_mpm_space_chooses_the_same_gaussians(model):
    _, gaussians, placement = placed(model, "heap")
    center, half = np.array([1.1, 0.9, 1.05]), np.array([0.3, 0.2, 0.4])
    there = (np.abs(placement.to_mpm(gaussians.means) - center) < half).all(1)
    box = {key: value for key, value in placement.box(center, half).items()}
    here = in_region(sections.BoxRegion(**box), gaussians.means.astype(np.float64))
    assert 50 < there.sum() < len(gaussians) / 2
    assert (there == here).mean() > 0.999


def test_size_grid_time_and_up(run, model):
    imported = run("leaf")
    _, gaussians, placement = placed(model, "leaf")
    scene = imported.scene
    lower, upper = gaussians.robust_bounds()
    assert scene.longest_m == pytest.approx((upper - lower).max() * placement.scale, rel=1e-6)
    assert scene.simulation.grid == round(scene.longest_m / 0.04)
    assert (scene.simulation.fps, scene.simulation.frame_time_s, scene.simulation.damping_ratio) == (25, 0.04, 0)
    assert scene.up == (0, 0, 1)
    assert run("clay").scene.up == (0, 0, 1)  # -90 deg about x turns z to y, which is up there


def test_faint_gaussians_and_those_outside_are_left_out(run, model):
    leaf = run("leaf")
    everything = load_gaussians(model / "point_cloud/iteration_30000/point_cloud.ply")
    assert len(load_gaussians(leaf.scene.input)) == int((everything.opacities > 0.1).sum()) < len(everything)
    assert mentions(leaf, "opacity_threshold")
    heap = run("heap")
    x, y, z = everything.means.T.astype(np.float64)
    cos, sin = math.cos(math.pi / 6), 0.5
    turned = np.stack([cos * x + sin * z, sin * x - cos * z, y])  # 90 deg about x, then 30 deg about z
    area = np.array(CONFIGURATIONS["heap"]["sim_area"]).reshape(3, 2)
    inside = ((turned > area[:, :1]) & (turned < area[:, 1:])).all(0)
    np.testing.assert_array_equal(load_gaussians(heap.scene.input).means, everything.means[inside])
    assert 0 < inside.sum() < len(everything)
    around = load_gaussians(heap.scene_yaml.with_name("scene_corrected_surroundings.ply"))
    np.testing.assert_array_equal(around.means, everything.means[~inside])
    assert mentions(heap, "sim_area")
    ball = run("ball")
    assert ball.scene.input == model / "point_cloud/iteration_30000/point_cloud.ply"


@pytest.mark.parametrize("mode", MODES)
def test_gravity_and_damping(run, mode):
    leaf = run("leaf", mode).scene
    assert leaf.gravity == "off"
    still = of_kind(leaf.forces, "wind")[0]
    assert still.drag_per_s == pytest.approx(-math.log(0.9999) / 1e-4)
    assert still.velocity_ms == (0, 0, 0)
    heap = run("heap", mode).scene
    np.testing.assert_allclose(heap.gravity_ms2, (0, -9.8, 0), atol=1e-6)  # z of MPM space is y of the splat


def test_a_number_for_gravity(run):
    scalar = {**CONFIGURATIONS["ball"], "g": 9.8}
    imported = run(scalar)
    np.testing.assert_allclose(imported.scene.gravity_ms2, (0, 0, -9.8))
    assert mentions(imported, "g:", "PhysGaussian stops")
    with pytest.raises(SceneError, match="PhysGaussian stops"):
        run(scalar, "compat")


def test_materials(run):
    def only(name, mode="corrected"):
        imported = run(name, mode)
        book = read_materials(imported.scene.materials.file)
        return imported, {part: materials.surface for part, materials in book.items()}

    assert only("leaf")[1]["object"].law == "fixed_corotated"
    coin, metals = only("coin")
    assert set(metals) == {"object", "region_1", "region_2"}
    assert mentions(coin, "additional_material_params.2", "no Gaussian")
    metal = metals["object"]
    assert metal.law == "von_mises"
    assert metal.extra["yield_stress_pa"] == pytest.approx(math.sqrt(1.5) * 2e4)
    assert metal.extra["hardening_modulus_pa"] == pytest.approx(3 * 1e6 / 2.6 * 0.1)
    assert (metals["region_1"].youngs_modulus_pa, metals["region_1"].density_kgm3) == (4e6, 500)
    assert (metals["region_2"].youngs_modulus_pa, metals["region_2"].density_kgm3) == (2e5, 1000)
    assert mentions(coin, "a factor too many")
    foam = only("cake")[1]["object"]
    assert (foam.law, foam.extra["yield_stress_pa"], foam.extra["viscosity_pas"]) == ("viscoplastic", 500, 10)
    assert only("heap")[1]["object"].extra["friction_angle_deg"] == 35
    clay = only("clay")[1]["object"]
    assert clay.law == "von_mises"
    assert clay.extra["hardening_modulus_pa"] == -300
    snow, snows = only("ball")
    assert snows["object"].law == "snow"
    assert mentions(snow, "no stress at all")
    dust = only("ball", "compat")[1]["object"]
    assert dust.youngs_modulus_pa == 1


def test_metal_without_a_yield_stress(run):
    bare = {key: value for key, value in CONFIGURATIONS["coin"].items() if key != "yield_stress"}
    corrected = run(bare)
    assert read_materials(corrected.scene.materials.file)["object"].surface.law == "stvk_hencky"
    assert mentions(corrected, "yield_stress: not given")
    compat = run(bare, "compat")
    assert read_materials(compat.scene.materials.file)["object"].surface.extra["yield_stress_pa"] < 0.01


def test_regions_are_parts(run, model):
    imported = run("coin")
    _, gaussians, placement = placed(model, "coin")
    parts = parts_from_file(imported.scene.grouping.labels_file, len(gaussians))
    height = placement.to_mpm(gaussians.means)[:, 2]
    np.testing.assert_array_equal(parts.labels == parts.names.index("region_1"), np.abs(height - 1.3) < 0.2)
    assert all(options.hold == "free" for options in imported.scene.parts.values())


@pytest.mark.parametrize("mode", MODES)
def test_surfaces(run, mode):
    sticky = of_kind(run("coin", mode).scene.boundaries, "plane")[0]
    assert sticky.contact == "sticky"
    slip = of_kind(run("cake", mode).scene.boundaries, "plane")[0]
    assert slip.contact == ("slip" if mode == "corrected" else "sticky")
    assert slip.normal == (0, 0, 1)
    heap = run("heap", mode)
    separate = of_kind(heap.scene.boundaries, "plane")[0]
    assert separate.contact == ("separate" if mode == "corrected" else "sticky")
    assert mentions(heap, "surface_collider", "sticky")
    if mode == "corrected":
        assert separate.friction == 0.5
    cut = run("clay", mode)
    assert of_kind(cut.scene.boundaries, "plane")[0].contact == "sticky"
    assert mentions(cut, "'cut'")


def test_walls_stand_inside_the_third_cell(run, model):
    _, _, placement = placed(model, "leaf")
    walls = of_kind(run("leaf").scene.boundaries, "container")[0]
    assert (walls.contact, walls.friction) == ("separate", 0)
    low = placement.to_mpm(np.array(walls.shape.center) - np.array(walls.shape.size) / 2)
    high = placement.to_mpm(np.array(walls.shape.center) + np.array(walls.shape.size) / 2)
    assert (low > 2 * 0.04).all()
    assert (low < 3 * 0.04).all()
    assert (high > 46 * 0.04).all()
    assert (high < 47 * 0.04).all()
    assert mentions(run("clay"), "bounding_box", "for a part of the film")


def test_cuboids(run, model):
    _, _, placement = placed(model, "coin")
    corrected, compat = run("coin"), run("coin", "compat")
    block = of_kind(corrected.scene.boundaries, "box")[0]
    assert (block.contact, block.from_s, block.to_s) == ("sticky", 0.1, 0.5)
    np.testing.assert_allclose(block.velocity_ms, (0, 0, -0.5))
    np.testing.assert_allclose(np.array(block.size) * placement.scale, (1, 1, 0.2), rtol=1e-5)
    np.testing.assert_allclose(placement.to_mpm(block.center), (1, 1, 1.6), atol=1e-6)
    assert not of_kind(corrected.scene.boundaries, "pin")
    assert mentions(corrected, "reset")
    pins = of_kind(compat.scene.boundaries, "pin")
    assert [(pin.from_s, pin.to_s) for pin in pins] == [(0, 0.1), (0.5, pytest.approx(0.5015))]


@pytest.mark.parametrize("mode", MODES)
def test_impulses_change_velocities_as_there(run, model, mode):
    config, gaussians, placement = placed(model, "leaf")
    imported = run("leaf", mode)
    push = of_kind(imported.scene.forces, "acceleration")[0]
    assert push.from_s == 0.1
    assert push.to_s - push.from_s == pytest.approx(2e-4)
    places = placement.to_mpm(gaussians.means)
    cells = {tuple(int(x // 0.04) for x in center) for center in places}
    mass = len(cells) * 0.04**3 * config.density  # every cell with particles counts as full
    np.testing.assert_allclose(push.value_ms2, (-0.18 * len(places) / mass, 0, 0), rtol=1e-6)
    assert mentions(imported, "particle_impulse", f"{len(gaussians):,}")


def test_masses():
    region = {"point": [1, 1, 1], "size": [1, 1, 1], "E": 1.0, "nu": 0.0, "density": 300.0}
    config = Configuration(density=100.0, additional_material_params=[region])
    places = np.array([[0.01, 0.01, 0.01], [0.02, 0.01, 0.01], [0.03, 0.02, 0.01], [0.5, 0.5, 0.5]])
    labels = np.array([0, 0, 1, 0], np.int32)
    cell = 0.04**3
    np.testing.assert_allclose(particle_masses(config, places, labels), [cell * 100 / 3] * 2 + [cell * 100, cell * 100])
    sand = config.model_copy(update={"material": "sand"})
    np.testing.assert_allclose(particle_masses(sand, places, labels), np.array([100, 100, 300, 100]) * cell / 2)


def test_held_and_turned_particles(run, model):
    held = of_kind(run("leaf").scene.forces, "velocity")[0]
    assert held.value_ms == (0, 0, 0)
    assert held.to_s is None
    _, gaussians, placement = placed(model, "leaf")
    there = np.abs(placement.to_mpm(gaussians.means)[:, 2] - 0.55) < 0.1
    np.testing.assert_array_equal(in_region(held.region, gaussians.means.astype(np.float64)), there)
    turn = of_kind(run("cake").scene.forces, "rotation")[0]
    assert turn.rate_deg_s == pytest.approx(math.degrees(2.0))
    np.testing.assert_allclose(turn.axis, (0, 0, -1), atol=1e-9)  # left-handed about its normal
    assert turn.along_ms == -0.1
    _, gaussians, placement = placed(model, "cake")
    local = placement.to_mpm(gaussians.means) - 1
    there = (np.abs(local[:, 2]) < 0.2) & (np.hypot(local[:, 0], local[:, 1]) < 0.3)
    assert (in_region(turn.region, gaussians.means.astype(np.float64)) == there).mean() > 0.999
    assert there.any()
