"""Nothing but contact crosses from one object to another: joints, clamps, what is held, and the skin."""

import numpy as np
import pytest

from phys4dgen.scene import Scene
from phys4dgen.stages.apart import (
    bodies_apart,
    body_numbers,
    bonded_by_body,
    held_by_body,
    rigid_by_body,
    skin_by_body,
    starting_velocities,
)
from phys4dgen.stages.asset import Asset
from phys4dgen.types import Continuum, Frame, Gaussians, Parts

SPACING = 0.01
NAMES = ("left/foot", "left/top", "right/foot", "right/top")


@pytest.fixture
def blocks():
    """Two blocks of 6 x 6 x 12 particles side by side that touch, each of a foot and a top; as several and as one."""
    axis = (np.arange(6) + 0.5) * SPACING
    block = np.stack(np.meshgrid(axis, axis, (np.arange(12) + 0.5) * SPACING, indexing="ij"), -1).reshape(-1, 3)
    points = np.concatenate([block, block + np.array([0.06, 0, 0])])
    p = len(points)
    part = (points[:, 2] > 0.03).astype(np.int32) + 2 * (np.arange(p) >= p // 2)
    continuum = Continuum(
        positions=points,
        part=part.astype(np.int32),
        is_interior=np.zeros(p, bool),
        volume_m3=np.full(p, SPACING**3),
        gaussian_index=np.full(p, -1, np.int32),
        piece=np.zeros(p, np.int32),
        shape=np.zeros(p, np.int8),
        thickness_m=np.full(p, np.nan),
        thickness_measured=np.zeros(p, bool),
        offset_m=np.zeros((p, 3)),
        site=np.arange(p),
        spacing_m=SPACING,
    )
    rng = np.random.default_rng(0)
    means = points + rng.normal(0, 0.2 * SPACING, points.shape)
    gaussians = Gaussians(
        means=means,
        quats_wxyz=np.tile([1, 0, 0, 0], (p, 1)),
        scales=np.full((p, 3), SPACING),
        opacities=np.full(p, 0.9),
        sh=np.zeros((p, 1, 3)),
    )
    asset = Asset(gaussians, Frame(np.eye(3), 1.0), points.min(0), points.max(0), 2 * SPACING)
    told = {"left": {"input": "a.ply", "velocity_ms": [1, 0, 0], "spin_deg_s": [0, 0, 180]}}
    several = Scene.model_validate({"objects": {**told, "right": {"input": "b.ply"}}})
    return several, Scene.model_validate({"input": "a.ply"}), asset, Parts(part, NAMES, "file"), continuum


def test_rigid_objects_that_touch_are_two_bodies(blocks):
    several, one, asset, parts, continuum = blocks
    nothing = np.zeros(len(continuum), bool)
    bodies, stuck = rigid_by_body(several, asset, parts, continuum, rigid_parts=[0, 1, 2, 3], held=nothing)
    assert [np.unique(bodies[own.particles]).tolist() for own in bodies_apart(several, parts, continuum)] == [[0], [1]]
    assert not stuck.any()
    joined, _ = rigid_by_body(one, asset, parts, continuum, rigid_parts=[0, 1, 2, 3], held=nothing)
    assert np.unique(joined).tolist() == [0]


def test_what_is_held_of_one_object_neither_holds_nor_clamps_another(blocks):
    several, one, asset, parts, continuum = blocks
    held = continuum.part == 0
    _, stuck = rigid_by_body(several, asset, parts, continuum, rigid_parts=[2], held=held)
    assert not stuck.any()
    _, stuck = rigid_by_body(one, asset, parts, continuum, rigid_parts=[2], held=held)
    assert stuck[continuum.part == 2].all()
    bonded = bonded_by_body(several, asset, parts, continuum, held=held)
    assert bonded[continuum.part == 1].all()
    assert not bonded[continuum.part > 1].any()
    assert bonded_by_body(several, asset, parts, continuum, held=np.zeros(len(continuum), bool)).all()


def test_each_object_is_held_as_it_would_be_alone(blocks):
    several, _, asset, parts, continuum = blocks
    asked = {"automatic": True, "lowest_share": 0.1}
    held = held_by_body(several, asset, parts, continuum, holds={}, **asked)
    assert held.parts == ("left/foot", "right/foot")
    assert held.reason.startswith("left: left/foot: stands on the ground")
    held = held_by_body(several, asset, parts, continuum, holds={"left/top": "fixed"}, **asked)
    assert held.parts == ("left/top", "right/foot")
    held = held_by_body(several, asset, parts, continuum, holds={}, automatic=False, lowest_share=0.1)
    assert (held.parts, held.reason) == ((), "nothing is held")


def test_no_object_carries_gaussians_of_another(blocks):
    several, one, asset, parts, continuum = blocks
    skin = skin_by_body(several, asset, parts, continuum, held_parts=[])
    assert (continuum.part[skin.particles] // 2 == parts.labels[:, None] // 2).all()
    alone = skin_by_body(one, asset, parts, continuum, held_parts=[])
    np.testing.assert_array_equal(skin.particles, alone.particles)
    np.testing.assert_array_equal(skin.weights, alone.weights)


def test_objects_start_with_their_velocity_and_spin(blocks):
    several, one, asset, parts, continuum = blocks
    mass_kg = np.full(len(continuum), 0.001)
    velocities = starting_velocities(several, asset, parts, continuum, mass_kg=mass_kg)
    left = continuum.part < 2
    assert not velocities[~left].any()
    np.testing.assert_allclose(velocities[left].mean(0), [1, 0, 0], atol=1e-12)
    arm = continuum.positions[left] - continuum.positions[left].mean(0)
    np.testing.assert_allclose(velocities[left, 1], np.pi * arm[:, 0], atol=1e-12)
    np.testing.assert_allclose(velocities[left, 0], 1 - np.pi * arm[:, 1], atol=1e-12)
    assert not starting_velocities(one, asset, parts, continuum, mass_kg=mass_kg).any()


def test_a_separate_part_is_a_body_that_nothing_but_a_name_holds(blocks):
    _, _, asset, parts, continuum = blocks
    scene = Scene.model_validate({"input": "a.ply", "parts": {"right/top": {"separate": True}}})
    bodies = bodies_apart(scene, parts, continuum)
    assert [(own.name, own.is_separate, own.numbers.tolist()) for own in bodies] == [
        ("", False, [0, 1, 2]),
        ("right/top", True, [3]),
    ]
    assert body_numbers(scene, parts, continuum).tolist() == (continuum.part == 3).astype(int).tolist()
    asked = {"automatic": True, "lowest_share": 0.1}
    assert "right/top" not in held_by_body(scene, asset, parts, continuum, holds={}, **asked).parts
    held = held_by_body(scene, asset, parts, continuum, holds={"right/top": "fixed"}, **asked)
    assert held.particles[continuum.part == 3].all()
    bonded = bonded_by_body(scene, asset, parts, continuum, held=continuum.part == 2)
    assert not bonded[continuum.part == 3].any()
    skin = skin_by_body(scene, asset, parts, continuum, held_parts=[])
    assert ((continuum.part[skin.particles] == 3) == (parts.labels[:, None] == 3)).all()
