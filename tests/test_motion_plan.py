"""From a scene to what the solver gets: presets, rigid parts, ground, gravity."""

import numpy as np
import pytest

from phys4dgen.errors import SceneError, SimulationError
from phys4dgen.materials import find_entry
from phys4dgen.progress import SILENT, SilentProgress
from phys4dgen.scene.model import validated_scene
from phys4dgen.stages.asset import Asset
from phys4dgen.stages.motion_plan import plan_motion
from phys4dgen.stages.prestress import with_prestress
from phys4dgen.types import SOLID, Continuum, Frame, Material, MaterialBook, PartMaterials, Parts

CELL_M = 0.0125
STEP_M = CELL_M / 2
FRAME = Frame(np.eye(3), 1.0)


def _box(low, high):
    axes = [np.arange(a + STEP_M / 2, b, STEP_M) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)


FOOT, POST = ((-0.05, -0.05, 0.0), (0.05, 0.05, 0.025)), ((-0.0125, -0.0125, 0.025), (0.0125, 0.0125, 0.2))
SOFT = {"youngs_modulus_pa": 5e4, "density_kgm3": 300.0}
STEEL = {"youngs_modulus_pa": 2e11, "density_kgm3": 7860.0}


def _book(**parts):
    """Materials by part; numbers that the user wrote, unless they say another source."""
    book = {}
    for name, values in parts.items():
        material = Material(**{"name": name, "law": "neo_hookean", "poisson_ratio": 0.2, "source": "user", **values})
        book[name] = PartMaterials(material, material)
    return MaterialBook(book)


@pytest.fixture
def plan(random_gaussians):
    """A post on a foot, 0.2 m tall: ``plan({scene keys}, foot={material}, post={material})``."""
    points = [_box(*FOOT), _box(*POST)]
    part = np.repeat(np.arange(2, dtype=np.int32), [len(p) for p in points])
    p = len(part)
    continuum = Continuum(
        positions=np.concatenate(points),
        part=part,
        is_interior=np.zeros(p, bool),
        volume_m3=np.full(p, STEP_M**3),
        gaussian_index=np.full(p, -1, np.int32),
        piece=np.zeros(p, np.int32),
        shape=np.full(p, SOLID, np.int8),
        thickness_m=np.full(p, np.nan),
        thickness_measured=np.zeros(p, bool),
        offset_m=np.zeros((p, 3)),
        site=np.arange(p),
        spacing_m=STEP_M,
    )
    gaussians = random_gaussians(10)
    parts = Parts(np.arange(10, dtype=np.int32) % 2, ("foot", "post"), "test")
    asset = Asset(gaussians, FRAME, np.array([-0.05, -0.05, 0]), np.array([0.05, 0.05, 0.2]), CELL_M)

    def make(keys, *, foot=SOFT, post=SOFT):
        tree = {"input": "post.ply", "simulation": {"grid": 16, "chunks": 1}, **keys}
        scene = validated_scene(tree, source="test", places={})
        return plan_motion(scene, asset, parts, continuum, _book(foot=foot, post=post), SILENT)

    return make


def test_a_soft_post_on_its_foot_sways(plan):
    found = plan({})
    assert found.facts.preset == "sway"
    assert found.held.parts == ("foot",)
    assert found.facts.gust_ms2 <= 3 * 9.81
    assert found.facts.gravity == "rest"
    assert found.settings.gravity_ms2 == (0.0, 0.0, 0.0)
    assert found.settings.ground is None
    assert found.facts.rigid == []


def test_what_would_not_bend_falls_as_one_rigid_body(plan):
    found = plan({}, foot=STEEL, post=STEEL)
    assert found.facts.preset == "drop"
    assert "would bend" in found.facts.why
    assert not found.held.particles.any()
    assert (found.assembly.body.rigid_group == 0).all()
    assert [part.part for part in found.facts.rigid] == ["foot", "post"]
    assert "6000 are allowed" in found.facts.rigid[0].reason
    assert found.settings.gravity_ms2[2] == pytest.approx(-9.81)
    assert found.settings.ground.height_m == pytest.approx(-0.4 * 0.2, abs=1e-6)
    assert found.settings.damping_relative_to_rigid


def test_what_takes_more_than_three_g_falls(plan):
    found = plan({}, post={"youngs_modulus_pa": 2e7, "density_kgm3": 300.0})
    assert found.facts.preset == "drop"
    assert " g" in found.facts.why
    assert found.facts.rigid == []


def test_a_stiff_part_on_a_soft_one_is_rigid_alone(plan):
    found = plan({"motion": {"preset": "drop", "drop_height_rel": 0.1}}, post=STEEL)
    body = found.assembly.body
    np.testing.assert_array_equal(body.rigid_group, np.where(body.part == 1, 0, -1))
    assert found.settings.ground.height_m == pytest.approx(-0.02, abs=1e-6)


def test_a_rigid_part_that_stands_on_what_is_held_is_held(plan):
    with pytest.raises(SimulationError, match="post: does not deform and touches what is held"):
        plan({"motion": {"preset": "sway"}, "parts": {"post": {"hold": "rigid"}, "foot": {"hold": "fixed"}}})


def test_a_free_part_that_is_too_stiff_is_rigid_too(plan):
    found = plan({"motion": {"preset": "drop"}, "parts": {"post": {"hold": "free"}}}, post=STEEL)
    assert [part.part for part in found.facts.rigid] == ["post"]


def test_ground_and_gravity_are_as_asked_for(plan):
    found = plan(
        {
            "motion": {"preset": "rest"},
            "gravity": "on",
            "boundaries": [{"kind": "ground", "friction": 0.1, "contact": "slip", "below_m": 0.05}],
        }
    )
    ground = found.settings.ground
    assert (ground.friction, ground.contact) == (0.1, "slip")
    assert ground.height_m == pytest.approx(-0.05, abs=1e-6)
    assert found.facts.ground_below_m == 0.05
    assert found.settings.gravity_ms2[2] == pytest.approx(-9.81)
    weightless = plan({"motion": {"preset": "drop"}, "gravity": "off"})
    assert weightless.settings.gravity_ms2 == (0.0, 0.0, 0.0)


# ------------------------------------------------------------------------------------------------ forces and boundaries

TOP = {"kind": "box", "center": [0, 0, 0.19], "size": [1, 1, 0.02]}


def rest(**keys):
    return {"motion": {"preset": "rest"}, "parts": {"foot": {"hold": "fixed"}}, **keys}


def test_forces_reach_the_solver_by_part_and_region(plan):
    forces = [
        {"kind": "total_force", "part": "post", "value_n": [1, 0, 0], "ramp_s": 0.1},
        {"kind": "impulse", "part": "post", "region": TOP, "value_ns": [0, 0.1, 0], "at_s": 0.2},
        {"kind": "wind", "velocity_ms": [2, 0, 0]},
    ]
    found = plan(rest(forces=forces))
    total, blow, wind = found.settings.loads
    body = found.assembly.body
    assert total.part == 1
    assert total.value_n == (1.0, 0.0, 0.0)
    np.testing.assert_array_equal(blow.selects(body), (body.part == 1) & (body.positions_m[:, 2] > 0.18))
    # air of 1.2 kg/m3 on the foot's and the post's side, both of 300 kg/m3
    area = 0.1 * 0.025 + 0.025 * 0.175
    mass = 300.0 * (0.1 * 0.1 * 0.025 + 0.025**2 * 0.175)
    assert wind.drag_per_m == pytest.approx(0.5 * 1.2 * area / mass, rel=0.25)


def test_lengths_and_points_of_fields_are_the_inputs(plan):
    forces = [
        {"kind": "attractor", "center": [0, 0, 0.5], "strength_ms2": 2, "radius": 0.1},
        {"kind": "noise", "strength_ms2": 1},
    ]
    attractor, noise = plan(rest(forces=forces)).settings.loads
    assert attractor.center_m == (0.0, 0.0, 0.5)
    assert attractor.radius_m == 0.1
    assert noise.length_m == pytest.approx(0.1)  # half of the longest side


def test_a_region_without_anything_in_it_is_refused(plan):
    empty = {"kind": "sphere", "center": [0, 0, 3], "radius": 0.1}
    with pytest.raises(SimulationError, match=r"region of a acceleration holds nothing of part 'post'.*spans \[-0.0"):
        plan(rest(forces=[{"part": "post", "region": empty, "value_ms2": [1, 0, 0]}]))


def test_a_lasting_pin_holds_and_a_passing_one_lets_go(plan):
    found = plan({"motion": {"preset": "rest"}, "gravity": "on", "boundaries": [{"kind": "pin", "region": TOP}]})
    np.testing.assert_array_equal(found.held.particles, found.assembly.body.positions_m[:, 2] > 0.18)
    passing = plan(
        {"motion": {"preset": "rest"}, "gravity": "on", "boundaries": [{"kind": "pin", "region": TOP, "to_s": 1}]}
    )
    assert not passing.held.particles.any()
    (drive,) = passing.settings.drives
    assert drive.velocity_ms == (0.0, 0.0, 0.0)
    assert drive.to_s == 1


def test_what_is_told_to_move_is_not_held(plan):
    found = plan({"forces": [{"kind": "velocity", "part": "foot", "value_ms": [0.1, 0, 0], "to_s": 0.5}]})
    assert found.facts.preset == "rest"
    assert not found.held.particles[found.assembly.body.part == 0].any()
    turn = {"kind": "rotation", "part": "post", "axis": [0, 0, 2], "rate_deg_s": 90}
    (drive,) = plan({"forces": [turn]}).settings.drives
    np.testing.assert_allclose(drive.spin_rad_s, [0, 0, np.pi / 2])
    np.testing.assert_allclose(drive.center_m[:2], 0, atol=1e-9)


def test_press_brings_a_plate_down_by_its_share_of_the_height(plan):
    found = plan({"motion": {"preset": "press", "press_depth_rel": 0.25}})
    assert not found.held.particles.any()
    assert found.settings.ground.contact == "sticky"
    (plate,) = found.settings.obstacles
    bottom = plate.shape.center_m[2] - plate.shape.half_m[2] - plate.shape.radius_m
    assert bottom == pytest.approx(0.2 + 0.05 * 0.2, rel=1e-3)
    deepest = plate.shift_m(0.3 * 2.0)[2]
    assert bottom + deepest == pytest.approx(0.75 * 0.2, rel=1e-3)
    np.testing.assert_allclose(plate.shift_m(2.0), 0)
    assert len(found.facts.obstacles) == 1
    by_force = plan({"motion": {"preset": "press", "press_force_n": 2.0}}).settings.obstacles[0]
    assert by_force.push.force_n == 2.0


def test_press_and_twist_need_something_soft(plan):
    with pytest.raises(SimulationError, match="press: nothing of the object would deform"):
        plan({"motion": {"preset": "press"}}, foot=STEEL, post=STEEL)


def test_twist_turns_the_top_and_holds_the_foot(plan):
    found = plan({"motion": {"preset": "twist", "twist_deg": 70}})
    assert found.held.parts == ("foot",)
    turn, stay = found.settings.drives
    assert turn.spin_rad_s[2] * (turn.to_s - turn.from_s) == pytest.approx(np.radians(70))
    assert stay.from_s == turn.to_s
    np.testing.assert_array_equal(
        turn.selects(found.assembly.body), found.assembly.body.positions_m[:, 2] > 0.16 - 0.0007
    )


def test_melt_changes_a_part_from_outside_inwards(plan):
    found = plan({"motion": {"preset": "melt", "part": "foot"}})
    (change,) = found.settings.changes
    body = found.assembly.body
    mine = change.selects(body)
    np.testing.assert_array_equal(mine, body.part == 0)
    assert change.law.name == "FLUID"
    assert change.at_s[mine].max() == pytest.approx(1.0)
    outer = mine & (np.abs(body.positions_m[:, 0]) > 0.045)
    inner = (
        mine
        & (np.linalg.norm(body.positions_m[:, :2], axis=1) < 0.02)
        & (np.abs(body.positions_m[:, 2] - 0.0125) < 0.004)
    )
    assert change.at_s[outer].max() < change.at_s[inner].min() + 1e-9
    assert found.settings.gravity_ms2[2] == pytest.approx(-9.81)
    with pytest.raises(SceneError, match="say what melts"):
        plan({"motion": {"preset": "melt"}})


def test_obstacles_stand_where_the_scene_says(plan):
    boundaries = [
        {"kind": "plane", "point": [0.3, 0, 0], "normal": [-1, 0, 0]},
        {"kind": "sphere", "center": [0, 0, 0.5], "radius": 0.1, "velocity_ms": [0, 0, -1]},
        {"kind": "capsule", "start": [-1, 0, 0.4], "end": [1, 0, 0.4], "radius": 0.05},
        {"kind": "box", "center": [0, 1, 0], "size": [0.2, 0.4, 0.6], "rotation_deg": [0, 0, 90], "to_s": 0.5},
        {"kind": "container"},
    ]
    obstacles = plan(rest(gravity="on", boundaries=boundaries)).settings.obstacles
    assert len(obstacles) == 4 + 6
    at = np.array([[0.1, 0.05, 0.3]])
    wall, ball, rod, block = (obstacle.shape.distances(at)[0][0] for obstacle in obstacles[:4])
    assert wall == pytest.approx(0.2)
    assert ball == pytest.approx(np.sqrt(0.01 + 0.0025 + 0.04) - 0.1)
    assert rod == pytest.approx(np.hypot(0.05, 0.1) - 0.05)
    assert block == pytest.approx(1 - 0.05 - 0.1)  # turned by 90 degrees: 0.2 along y
    assert not obstacles[3].is_there(0.6)
    np.testing.assert_allclose(obstacles[1].shift_m(0.2), [0, 0, -0.2])
    inside = [obstacle.shape.distances(np.array([[0.0, 0, 0.1]]))[0][0] for obstacle in obstacles[4:]]
    assert min(inside) == pytest.approx(0.1, abs=0.004)  # its floor lies under the object


def _prestressed(plan, keys, *, progress=SILENT, **materials):
    found = plan({"motion": {"preset": "rest"}, **keys}, **materials)
    tree = {"input": "post.ply", "simulation": {"grid": 16, "chunks": 1}, "motion": {"preset": "rest"}, **keys}
    scene = validated_scene(tree, source="test", places={})
    asset = Asset(None, FRAME, np.array([-0.05, -0.05, 0]), np.array([0.05, 0.05, 0.2]), CELL_M)
    parts = Parts(np.arange(2, dtype=np.int32), ("foot", "post"), "test")
    book = _book(**{"foot": SOFT, "post": SOFT, **materials})
    return with_prestress(scene, asset, parts, book, found, progress)


def test_what_is_held_carries_its_weight_where_gravity_is_on(plan):
    held = {"gravity": "on", "parts": {"foot": {"hold": "fixed"}}}
    body = _prestressed(plan, held).assembly.body
    post = body.part == 1
    assert 0.01 < 1 - body.initial_gradients[post, 2, 2].min() < 0.05
    assert _prestressed(plan, {**held, "prestress": "off"}).assembly.body.initial_gradients is None
    assert _prestressed(plan, {**held, "gravity": "rest"}).assembly.body.initial_gradients is None
    assert _prestressed(plan, {"gravity": "on"}).assembly.body.initial_gradients is None
    facts = _prestressed(plan, held).facts.prestress
    assert facts.converged and facts.yielding == ()


def test_what_is_too_soft_to_stand_gets_a_prestress_only_where_that_is_asked_for(plan, monkeypatch):
    held = {"gravity": "on", "parts": {"foot": {"hold": "fixed"}}}
    sag_m = _prestressed(plan, held).facts.prestress.sag_m
    monkeypatch.setattr("phys4dgen.stages.prestress._LARGEST_SAG", 0.9 * sag_m / 0.2)
    soft = _prestressed(plan, held)
    assert soft.facts.prestress is None
    assert soft.assembly.body.initial_gradients is None
    asked = _prestressed(plan, {**held, "prestress": "on"})
    assert asked.facts.prestress.sag_m == pytest.approx(sag_m)


class Said(SilentProgress):
    """Keeps the warnings."""

    def __init__(self):
        self.warnings = []

    def warn(self, text):
        self.warnings.append(text)


HELD = {"gravity": "on", "parts": {"foot": {"hold": "fixed"}}}
GUESSED = {"youngs_modulus_pa": 4e3, "density_kgm3": 300.0, "source": "rule"}


def test_what_would_sag_too_much_is_as_stiff_as_its_standing_takes(plan):
    said = Said()
    own = _prestressed(plan, {**HELD, "prestress": "on"}, post={**GUESSED, "source": "user"})
    found = _prestressed(plan, HELD, post=GUESSED, progress=said)
    facts = found.facts.prestress
    times = own.facts.prestress.sag_m / (0.03 * 0.2)
    assert times > 1.2
    assert facts.stiffer_times == pytest.approx(times, rel=0.02)
    assert facts.sag_m == pytest.approx(0.03 * 0.2)
    assert (facts.stiffer_parts, facts.sag_as_given_m) == (("post",), pytest.approx(times * facts.sag_m))
    body = found.assembly.body
    np.testing.assert_allclose(body.youngs_modulus_pa[body.part == 1], facts.stiffer_times * 4e3)
    np.testing.assert_allclose(body.youngs_modulus_pa[body.part == 0], 5e4)
    (warning,) = said.warnings
    assert f"post now with {facts.stiffer_times:.2g} times the Young's modulus" in warning
    again = _prestressed(plan, HELD, post={**GUESSED, "youngs_modulus_pa": 4e3 * facts.stiffer_times, "source": "user"})
    assert again.facts.prestress.stiffer_times == 1
    np.testing.assert_allclose(
        body.initial_gradients, again.assembly.body.initial_gradients, atol=0.03 * facts.largest_strain
    )


def test_a_modulus_that_the_user_wrote_is_kept(plan):
    said = Said()
    found = _prestressed(plan, HELD, post={**GUESSED, "source": "user"}, progress=said)
    assert found.facts.prestress.stiffer_times == 1
    assert found.facts.prestress.stiffer_parts == ()
    assert found.facts.prestress.sag_m > 0.03 * 0.2
    assert not any("times the Young's modulus" in warning for warning in said.warnings)
    np.testing.assert_allclose(found.assembly.body.youngs_modulus_pa[found.assembly.body.part == 1], 4e3)


def test_a_library_material_that_the_user_named_may_be_stiffer(plan):
    foam = {"name": "foam", "youngs_modulus_pa": 5e4, "density_kgm3": 4000.0}
    assert find_entry("foam").youngs_modulus_pa.value == 5e4
    facts = _prestressed(plan, HELD, post=foam).facts.prestress
    assert facts.stiffer_parts == ("post",)


def test_no_guess_is_wrong_by_more_than_ten_times(plan):
    said = Said()
    soft = {**GUESSED, "youngs_modulus_pa": 150.0}
    found = _prestressed(plan, HELD, post=soft, progress=said)
    assert found.facts.prestress is None
    np.testing.assert_allclose(found.assembly.body.youngs_modulus_pa[found.assembly.body.part == 1], 150.0)
    (warning,) = said.warnings
    assert "even 10 times as stiff as their materials usually are" in warning


def test_a_prestress_that_cannot_be_is_refused(plan):
    with pytest.raises(SceneError, match="hold what carries the object"):
        _prestressed(plan, {"gravity": "on", "prestress": "on"})
    with pytest.raises(SceneError, match="add gravity: on"):
        _prestressed(plan, {"prestress": "on", "parts": {"foot": {"hold": "fixed"}}})
    with pytest.raises(SceneError, match="use gravity: on"):
        _prestressed(plan, {"prestress": "on", "gravity": "rest"})
