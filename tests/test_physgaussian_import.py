"""Scenes of PhysGaussian: every key and boundary type arrives, or is named among the differences."""

import json
import math
import shutil

import numpy as np
import pytest

from phys4dgen.cli import main
from phys4dgen.errors import SceneError
from phys4dgen.formats import load_gaussians
from phys4dgen.grouping.from_file import parts_from_file
from phys4dgen.materials import read_materials
from phys4dgen.physgaussian.boundary_types import BOUNDARY_TYPES
from phys4dgen.physgaussian.configuration import MATERIALS, Configuration, Filling, RegionMaterial, read_configuration
from phys4dgen.physgaussian.importing import import_physgaussian
from phys4dgen.physgaussian.masses import particle_masses
from phys4dgen.physgaussian.placement import place, simulated
from phys4dgen.scene import sections
from phys4dgen.stages.motion_loads import LoadMaker, in_region
from phys4dgen.stages.motion_obstacles import ObstacleMaker
from phys4dgen.types import Continuum, Frame, Parts, rotation_to_z_up
from physgaussian_scenes import CONFIGURATIONS, write_model

MODES = ("corrected", "compat")


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    folder = tmp_path_factory.mktemp("model")
    write_model(folder)
    return folder


@pytest.fixture
def run(model, tmp_path):
    """Imports a configuration, by name or as a dictionary."""

    def importing(given, mode="corrected"):
        config = tmp_path / "config.json"
        config.write_text(json.dumps(CONFIGURATIONS[given] if isinstance(given, str) else given))
        return import_physgaussian(config, model, tmp_path / f"scene_{mode}.yaml", mode=mode)

    return importing


def of_kind(entries, kind):
    return [entry for entry in entries if entry.kind == kind]


def mentions(imported, *words):
    return any(all(word in text for word in words) for text in imported.differences)


def placed(model, name):
    config = Configuration.model_validate(CONFIGURATIONS[name])
    gaussians = load_gaussians(model / "point_cloud/iteration_30000/point_cloud.ply")
    gaussians = gaussians.subset(simulated(gaussians, config))
    return config, gaussians, place(gaussians, config)


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


def test_cameras(run):
    leaf = run("leaf")
    video = leaf.scene.output.video
    # azimuth 0 is the direction (1, 1, 0), 135 deg in ours, and it turns clockwise seen from above
    assert video.orbit_deg == pytest.approx(29)
    assert video.azimuth_deg == pytest.approx(135 - 20 + 29 / 2)
    assert video.elevation_deg == pytest.approx(15)
    assert mentions(leaf, "init_radius", "delta_e")
    coin = run("coin").scene.output.video  # camera 1 stands at +x
    assert coin.azimuth_deg == pytest.approx(90, abs=1)
    assert coin.elevation_deg == pytest.approx(0, abs=1)
    assert mentions(run({**CONFIGURATIONS["coin"], "default_camera_index": 7}), "no camera 7")


def test_spellings(run, tmp_path):
    config = {**CONFIGURATIONS["ball"], "init_azimuth": 30, "default_camera_index": -1}
    config["particle_filling"] = {"max_particles_per_cell": 8}
    corrected, compat = run(config), run(config, "compat")
    assert corrected.scene.output.video.azimuth_deg != compat.scene.output.video.azimuth_deg
    assert mentions(corrected, "init_azimuth:", "ignores this key; this import takes it")
    assert mentions(compat, "init_azimuth:", "so does this import")
    assert mentions(corrected, "particle_filling.max_particles_per_cell")
    path = tmp_path / "config.json"
    assert read_configuration(path, mode="corrected").values.particle_filling.max_partciels_per_cell == 8
    assert read_configuration(path, mode="compat").values.particle_filling.max_partciels_per_cell == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frictio_angle": 3}, "Did you mean 'friction_angle'"),
        ({"particle_filling": {"densty_threshold": 3}}, "densty_threshold"),
        ({"boundary_conditions": [{"type": "surface_colider"}]}, "Did you mean 'surface_collider'"),
        ({"boundary_conditions": [{"point": [1, 1, 1]}]}, "expected a type"),
        ({"boundary_conditions": [{"type": "cuboid", "point": [1, 1, 1], "size": [1, 1, 1]}]}, "velocity"),
        ({"boundary_conditions": [{"type": "bounding_box", "pont": 1}]}, "pont"),
        ({"material": "jely"}, "Did you mean 'jelly'"),
        ({"nu": 0.7}, "nu"),
        ({"E": "stiff"}, "E"),
        ({"rotation_degree": [90]}, "go together"),
        ({"sim_area": [1, -1, 0, 1, 0, 1]}, "sim_area"),
        ({"sim_area": [5, 6, 5, 6, 5, 6]}, "no Gaussian of"),
        ({"frame_dt": 1e-5}, "shorter than substep_dt"),
        ({"n_grid": 6, "boundary_conditions": [{"type": "bounding_box"}]}, "no room between its walls"),
        ({"density": 1e5}, "density"),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_sentence(run, change, message):
    with pytest.raises(SceneError, match=message) as raised:
        run({**CONFIGURATIONS["ball"], **change})
    assert "\n" not in str(raised.value)


def test_a_ratio_of_one_half(run):
    incompressible = {**CONFIGURATIONS["ball"], "nu": 0.5}
    assert mentions(run(incompressible), "nu: 0.5")
    with pytest.raises(SceneError, match="divides by zero"):
        run(incompressible, "compat")


def test_broken_files(model, tmp_path):
    path = tmp_path / "a.json"
    for text, message in (
        ('{"smooth": ,}', "line 1: not JSON"),
        ("[1]", "expected a JSON object"),
        ("[" * 99999, "not JSON"),
    ):
        path.write_text(text)
        with pytest.raises(SceneError, match=message):
            import_physgaussian(path, model, tmp_path / "a.yaml")
    with pytest.raises(SceneError, match="no such file"):
        import_physgaussian(tmp_path / "absent.json", model, tmp_path / "a.yaml")
    path.write_text("{}")
    (tmp_path / "empty").mkdir()
    with pytest.raises(SceneError, match="iteration_N"):
        import_physgaussian(path, tmp_path / "empty", tmp_path / "a.yaml")


def test_the_command(model, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(model, tmp_path / "model")
    (tmp_path / "leaf.json").write_text(json.dumps(CONFIGURATIONS["leaf"]))
    words = ["import-physgaussian", "leaf.json", "model", "-o", "leaf.yaml"]
    assert main(words) == 0
    said = capsys.readouterr()
    assert said.out.splitlines() == ["leaf.yaml", "leaf_object.ply", "leaf_materials.yaml"]
    assert "covariance" in said.err
    assert main(words) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert main([*words, "--mode", "compat", "--overwrite"]) == 0
    assert main(["import-physgaussian", "leaf.json", "model"]) == 2
    assert main(["import-physgausian", "leaf.json"]) == 2
    assert "Did you mean 'import-physgaussian'" in capsys.readouterr().err
