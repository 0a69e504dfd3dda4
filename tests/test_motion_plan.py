"""From a scene to what the solver gets: presets, rigid parts, ground, gravity."""

import numpy as np
import pytest

from phys4dgen.errors import SimulationError
from phys4dgen.progress import SILENT
from phys4dgen.scene.model import validated_scene
from phys4dgen.stages.asset import Asset
from phys4dgen.stages.motion_plan import plan_motion
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
        spacing_m=STEP_M,
    )
    gaussians = random_gaussians(10)
    parts = Parts(np.arange(10, dtype=np.int32) % 2, ("foot", "post"), "test")
    asset = Asset(gaussians, FRAME, np.array([-0.05, -0.05, 0]), np.array([0.05, 0.05, 0.2]), CELL_M)

    def make(keys, *, foot=SOFT, post=SOFT):
        materials = {}
        for name, values in (("foot", foot), ("post", post)):
            material = Material(name=name, law="neo_hookean", poisson_ratio=0.2, source="user", **values)
            materials[name] = PartMaterials(material, material)
        tree = {"input": "post.ply", "simulation": {"grid": 16, "chunks": 1}, **keys}
        scene = validated_scene(tree, source="test", places={})
        return plan_motion(scene, asset, parts, continuum, MaterialBook(materials), SILENT)

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
