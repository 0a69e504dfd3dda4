"""Up is found from how things stand, whichever way the file is turned; where it is not, that is said."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from phys4dgen.formats import load_gaussians
from phys4dgen.types import Gaussians
from phys4dgen.upright import guess_up
from phys4dgen.upright.contact import candidate_downs, fitted_to_base
from phys4dgen.upright.cues import stand_on
from phys4dgen.upright.occupied import occupied_cells
from phys4dgen.zoo.captured import as_captured
from phys4dgen.zoo.catalogue import bundled


def gaussians_at(points, *, colors: object = 0.5):
    n = len(points)
    return Gaussians(
        means=points,
        quats_wxyz=np.tile([1, 0, 0, 0], (n, 1)),
        scales=np.full((n, 3), 0.01),
        opacities=np.full(n, 0.9),
        sh=np.broadcast_to((np.asarray(colors) - 0.5) / 0.28209479, (n, 3))[:, None].copy(),
    )


def turned(gaussians, rotation):
    quats = rotation * Rotation.from_quat(np.roll(gaussians.quats_wxyz, -1, axis=1))
    return Gaussians(
        means=rotation.apply(gaussians.means),
        quats_wxyz=np.roll(quats.as_quat(), 1, axis=1),
        scales=gaussians.scales,
        opacities=gaussians.opacities,
        sh=gaussians.sh[:, :1],
    )


def error_deg(guess, up):
    return np.degrees(np.arccos(np.clip(guess.up @ up, -1, 1)))


def lamp(rng):
    """A disc on the ground, a thin pole and a small ball on top, z up."""
    disc = rng.uniform(-1, 1, size=(4000, 2))
    disc = disc[np.linalg.norm(disc, axis=1) < 1]
    ball = rng.normal(size=(800, 3))
    return np.concatenate(
        [
            np.c_[0.5 * disc, rng.uniform(0, 0.03, len(disc))],
            np.c_[rng.normal(0, 0.02, size=(500, 2)), rng.uniform(0, 1.7, 500)],
            0.3 * ball / np.linalg.norm(ball, axis=1, keepdims=True) + np.array([0, 0, 2.0]),
        ]
    )


@pytest.mark.parametrize("turn", list(Rotation.create_group("O"))[::4], ids=lambda turn: str(turn.as_rotvec().round(1)))
def test_up_of_a_lamp_is_found_on_every_axis_and_is_exact(turn):
    guess = guess_up(turned(gaussians_at(lamp(np.random.default_rng(0))), turn))
    np.testing.assert_allclose(guess.up, turn.apply([0, 0, 1]), atol=1e-12)
    assert guess.is_sure
    assert not guess.reason.startswith("unsure")


def test_haze_below_the_ground_does_not_tilt_it():
    rng = np.random.default_rng(1)
    haze = np.c_[rng.uniform(-0.4, -0.1, (12, 1)), rng.normal(0, 0.1, (12, 1)), rng.uniform(-0.12, 0, (12, 1))]
    points = np.concatenate([lamp(rng), np.repeat(haze, 3, axis=0)])
    guess = guess_up(turned(gaussians_at(points), Rotation.from_rotvec([0.4, 0.2, 0])))
    assert error_deg(guess, Rotation.from_rotvec([0.4, 0.2, 0]).apply([0, 0, 1])) < 2


@pytest.mark.parametrize("points", [np.zeros((1, 3)), np.zeros((9, 3)), np.c_[np.arange(9), np.zeros((9, 2))]])
def test_next_to_nothing_is_a_guess(points):
    guess = guess_up(gaussians_at(points))
    assert np.linalg.norm(guess.up) == 1
    assert not guess.is_sure
    assert guess.reason.startswith("unsure")


def test_a_flat_sheet_is_a_guess():
    rng = np.random.default_rng(2)
    assert not guess_up(gaussians_at(np.c_[rng.uniform(-1, 1, (3000, 2)), np.zeros(3000)])).is_sure


def test_a_ball_has_no_up():
    points = np.random.default_rng(1).normal(size=(5000, 3))
    guess = guess_up(gaussians_at(points / np.linalg.norm(points, axis=1, keepdims=True)))
    assert not guess.is_sure
    assert guess.reason.startswith("unsure")


def test_where_the_object_does_not_tell_a_usual_axis_is_taken():
    """A plain cube: six sides alike, of which -y, +y and +z are usual."""
    rng = np.random.default_rng(3)
    points = rng.uniform(-1, 1, (6000, 3))
    points[np.arange(6000), rng.integers(0, 3, 6000)] = rng.choice([-1, 1], 6000)
    guess = guess_up(gaussians_at(points))
    assert not guess.is_sure
    assert guess.up.tolist() in ([0, -1, 0], [0, 1, 0], [0, 0, 1])


@pytest.mark.parametrize(
    ("name", "captured"),
    [("snowman", False), ("cup", True), ("sandcastle", False), ("balloon", False), ("rubber_duck", False)],
)
def test_bundled_objects_tilted_by_25_degrees(name, captured):
    thing = bundled(name)
    tilt = Rotation.from_rotvec(np.radians(25) * np.array([0.6, -0.8, 0]))
    gaussians = as_captured(thing.gaussians, thing.labels)[0] if captured else thing.gaussians
    guess = guess_up(turned(gaussians, tilt))
    assert error_deg(guess, tilt.apply(thing.up.copy())) < 5
    assert guess.is_sure, guess


def test_what_could_only_stand_on_a_tip_is_not_trusted():
    """A ball on a thin stick, the stick down."""
    rng = np.random.default_rng(6)
    ball = rng.normal(size=(4000, 3))
    ball = ball / np.linalg.norm(ball, axis=1, keepdims=True) + np.array([0, 0, 2.9])
    stick = np.c_[rng.normal(0, 0.02, (1500, 2)), rng.uniform(0, 2, 1500)]
    colors = np.where(np.arange(5500) < 4000, 0.3 + 0.3 * np.r_[ball[:, 2] - 1.9, np.zeros(1500)] / 2, 0.3)
    assert not guess_up(gaussians_at(np.concatenate([ball, stick]), colors=colors[:, None])).is_sure


@pytest.mark.parametrize("name", ["plant.splat", "ponytail_palm.splat"])
def test_real_captures(shared_data, name):
    gaussians = load_gaussians(shared_data / "splats" / name)
    assert guess_up(gaussians).up.tolist() == [0, -1, 0]
    tilt = Rotation.from_rotvec([0, 0, np.radians(25)])
    assert error_deg(guess_up(turned(gaussians, tilt)), tilt.apply([0, -1, 0])) < 5


def test_a_lying_hammer_is_unsure(shared_data):
    assert not guess_up(load_gaussians(shared_data / "interior" / "hammer_10k.splat")).is_sure


def test_the_same_file_gives_the_same_answer():
    first, second = (guess_up(gaussians_at(lamp(np.random.default_rng(5)))) for _ in range(2))
    assert first.up.tolist() == second.up.tolist()
    assert (first.confidence, first.reason) == (second.confidence, second.reason)


def test_how_a_box_stands():
    """A box of 1 x 1 x 3: on its end it falls at 18 degrees, on its side at 45."""
    rng = np.random.default_rng(4)
    points = rng.uniform(-1, 1, (20000, 3))
    points[np.arange(20000), rng.integers(0, 3, 20000)] = rng.choice([-1, 1], 20000)
    cells = occupied_cells(gaussians_at(points * [1, 1, 3]))
    assert cells is not None
    downs = candidate_downs(cells)
    for down, tip_deg in (([0, 0, -1], np.degrees(np.arctan(1 / 3))), ([1, 0, 0], 45)):
        found = downs[(downs @ down).argmax()]
        assert found @ down > np.cos(np.radians(1))
        stand = stand_on(cells, found)
        assert stand.tip_deg == pytest.approx(tip_deg, abs=3)
        assert stand.support_share == pytest.approx(1, abs=0.1)
        assert stand.filled_share > 0.8
        assert stand.offset < 0.03
        assert abs(stand.lift) < 0.02


def test_a_table_stands_on_feet_that_keep_it_off_the_ground():
    rng = np.random.default_rng(7)
    legs = np.repeat([[0.9, 0.9], [0.9, -0.9], [-0.9, 0.9], [-0.9, -0.9]], 800, axis=0)
    legs = np.c_[legs + rng.uniform(-0.05, 0.05, (3200, 2)), rng.uniform(0, 1, 3200)]
    top = np.c_[rng.uniform(-1, 1, (9000, 2)), rng.uniform(0.97, 1.0, 9000)]
    cells = occupied_cells(gaussians_at(np.concatenate([top, legs])))
    assert cells is not None
    feet, upside_down = (stand_on(cells, np.array([0, 0, z])) for z in (-1.0, 1.0))
    assert feet.filled_share < 0.2
    assert feet.lift > 0.02
    assert feet.support_share > 0.8
    assert upside_down.filled_share > 0.8
    assert upside_down.lift < 0.01


def test_a_narrow_base_does_not_turn_the_direction():
    """A post of 0.1 x 0.1 x 2 with its lower end cut off slantwise."""
    rng = np.random.default_rng(8)
    points = rng.uniform(-1, 1, (9000, 3)) * [0.05, 0.05, 1]
    points = points[points[:, 2] > -0.95 + points[:, 0]]
    cells = occupied_cells(gaussians_at(points))
    assert cells is not None
    np.testing.assert_array_equal(fitted_to_base(cells, np.array([0.0, 0, -1])), [0, 0, -1])
