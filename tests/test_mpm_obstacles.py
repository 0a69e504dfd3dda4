"""Walls, boxes, balls, plates and containers: friction, restitution, the force that they take; nothing passes them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mpm_bodies import body, lattice
from phys4dgen.mpm import (
    Drive,
    Ground,
    HalfSpace,
    HollowBall,
    Motion,
    Obstacle,
    Push,
    RoundedBox,
    Settings,
    Simulator,
)

G = 9.81


def as_rigid(b):
    return replace(b, rigid_group=np.zeros(len(b), np.int32))


def block(*, rigid, n=(8, 8, 6), dx=0.02, at=(0.0, 0.0, 0.0), E=1e6, v=None, rho=1000.0, nu=0.3):
    x = lattice(n, dx / 2, at)
    v = None if v is None else np.tile(np.asarray(v, float), (len(x), 1))
    b = body(x, (dx / 2) ** 3, E=E, v=v, rho=rho, nu=nu)
    return as_rigid(b) if rigid else b


@pytest.mark.parametrize("rigid", [False, True])
def test_b17_block_on_a_tilted_wall(rigid):
    slope = np.radians(24)
    turn = Rotation.from_euler("y", slope).as_matrix()  # z leans towards +x
    b = block(rigid=rigid, n=(12, 12, 8))
    b = replace(b, positions_m=b.positions_m @ turn.T)
    normal = tuple(turn[:, 2].tolist())
    theory = G * 0.5**2 / 2 * (np.sin(slope) - np.tan(np.radians(15)) * np.cos(slope))

    def slid(friction, frames):
        wall = Obstacle(HalfSpace((0.0, 0.0, 0.0), normal), friction=friction)
        simulator = Simulator(b, Settings(0.02, 0.05, gravity_ms2=(0, 0, -G), obstacles=(wall,)))
        moved = [simulator.advance().positions_m - b.positions_m for _ in range(frames)]
        return np.array([m.mean(0) @ turn[:, 0] for m in moved])

    assert slid(np.tan(np.radians(15)), 10)[-1] == pytest.approx(theory, rel=0.06)
    stuck = slid(np.tan(np.radians(30)), 12)
    assert np.ptp(stuck[8:]) < 2e-4


@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.9])
def test_a_rigid_block_leaves_a_wall_with_its_restitution(restitution):
    b = block(rigid=True, at=(0.02, 0, 0), v=(-1.0, 0.0, 0.0))
    wall = Obstacle(HalfSpace((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), restitution=restitution, friction=0.0)
    simulator = Simulator(b, Settings(0.02, 0.01, obstacles=(wall,)))
    for _ in range(6):
        frame = simulator.advance()
    assert frame.momentum_kgms[0] / b.mass_kg.sum() == pytest.approx(restitution, abs=0.01)


@pytest.mark.parametrize("rigid", [False, True])
def test_a_wall_takes_the_momentum_that_a_block_loses(rigid):
    b = block(rigid=rigid, at=(0.02, 0, 0), v=(-1.0, 0.3, 0.0), E=2e5)
    wall = Obstacle(HalfSpace((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), friction=0.3)
    simulator = Simulator(b, Settings(0.02, 0.01, obstacles=(wall,)))
    before = simulator.frame.momentum_kgms
    taken = np.zeros(3)
    for _ in range(8):
        frame = simulator.advance()
        taken += frame.reactions_n[0] * 0.01
    np.testing.assert_allclose(before - frame.momentum_kgms, taken, atol=2e-3 * np.abs(before).max())
    assert taken[0] < -0.5 * b.mass_kg.sum()


@pytest.mark.parametrize("rigid", [False, True])
def test_a_moving_plate_pushes_a_block_to_its_own_speed(rigid):
    b = block(rigid=rigid, at=(0.01, 0, 0), E=3e5)
    plate = RoundedBox((-0.06, 0.04, 0.03), (0.06, 0.1, 0.1))
    pusher = Obstacle(plate, motion=Motion.steady((0.4, 0, 0), from_s=0.0, to_s=10.0), restitution=0.0)
    simulator = Simulator(b, Settings(0.02, 0.02, obstacles=(pusher,), damping_per_s=0.0))
    frames = [simulator.advance() for _ in range(15)]
    assert frames[-1].obstacle_shifts_m[0, 0] == pytest.approx(0.4 * 0.3, rel=1e-6)
    gap = frames[-1].positions_m[:, 0].min() - 0.005 - frames[-1].obstacle_shifts_m[0, 0]
    assert gap > -0.02 * 0.75
    speed = frames[-1].momentum_kgms[0] / b.mass_kg.sum()
    assert 0.39 < speed < (0.41 if rigid else 0.75)  # what is soft bounces off


def pressed(obstacles, *, frames, E=1e5):
    """A block of 24 x 24 x 24 particles, 0.12 m on a side, nu = 0, on a ground without friction, under obstacles."""
    x = lattice((24, 24, 24), 0.005)
    b = body(x, 1.25e-7, E=E, nu=0.0, rho=300.0)
    settings = Settings(0.01, 0.02, ground=Ground(0.0, friction=0.0), obstacles=obstacles, damping_per_s=60.0, cfl=0.6)
    simulator = Simulator(b, settings)
    return b, [simulator.advance() for _ in range(frames)]


def strain_of(b, frame):
    middle = np.abs(b.positions_m[:, 2] - 0.06) < 0.035
    return 1 - frame.deformation_gradients[middle, 2, 2].astype(float).mean()


def test_the_force_of_a_press_is_stress_times_area():
    way = Motion(np.array([0.0, 0.5]), np.array([[0.0, 0, 0], [0, 0, -0.02]]))
    plate = Obstacle(RoundedBox((0.06, 0.06, 0.18), (0.1, 0.1, 0.06)), motion=way, friction=0.0)
    b, frames = pressed((plate,), frames=30)
    strain = strain_of(b, frames[-1])
    assert strain == pytest.approx(0.02 / 0.12, abs=0.01 / 0.12)  # the two contacts are right to half a cell each
    # Neo-Hookean with nu = 0: P = mu (s - 1/s) with mu = E / 2
    s = 1 - strain
    nominal_pa = -1e5 / 2 * (s - 1 / s)
    force = frames[-1].reactions_n
    assert force[0, 2] == pytest.approx(nominal_pa * 0.12**2, rel=0.1)
    assert force[1, 2] == pytest.approx(-force[0, 2], rel=0.02)  # action is reaction


def test_a_plate_that_pushes_comes_to_rest_where_stress_times_area_is_its_force():
    push = Push((0.0, 0, -1.0), force_n=150.0, mass_kg=3.0, ramp_s=0.3)
    plate = Obstacle(RoundedBox((0.06, 0.06, 0.18), (0.1, 0.1, 0.06)), push=push, friction=0.0)
    b, frames = pressed((plate,), frames=40)
    assert frames[-1].reactions_n[0, 2] == pytest.approx(150.0, rel=0.02)
    s = 1 - strain_of(b, frames[-1])
    assert -1e5 / 2 * (s - 1 / s) * 0.12**2 == pytest.approx(150.0, rel=0.1)
    still = frames[-1].obstacle_shifts_m[0, 2], frames[-4].obstacle_shifts_m[0, 2]
    assert still[0] == pytest.approx(still[1], abs=2e-4)


@pytest.mark.parametrize("rigid", [False, True])
def test_a_container_keeps_what_flies_about_inside(rigid):
    half = 0.1
    walls = [
        Obstacle(HalfSpace((0.0, 0.0, 0.0) if s > 0 else (2 * half,) * 3, tuple(s * e for e in np.eye(3)[k].tolist())))
        for k in range(3)
        for s in (1.0, -1.0)
    ]
    b = block(rigid=rigid, n=(6, 6, 6), at=(0.07, 0.07, 0.07), E=1e5, v=(2.0, 1.3, -0.7))
    simulator = Simulator(b, Settings(0.02, 0.02, obstacles=tuple(walls)))
    for _ in range(20):
        frame = simulator.advance()
        assert frame.positions_m.min() > -0.015
        assert frame.positions_m.max() < 2 * half + 0.015


@pytest.mark.parametrize("rigid", [False, True])
def test_nothing_leaves_a_hollow_ball_and_nothing_enters_a_ball(rigid):
    bowl = Obstacle(HollowBall((0.0, 0.0, 0.15), 0.15), friction=0.1)
    stone = Obstacle(RoundedBox((0.0, 0.0, 0.0), radius_m=0.06), friction=0.1)
    b = block(rigid=rigid, n=(6, 6, 6), at=(-0.02, -0.03, 0.1), E=5e4, v=(0.0, 0.0, -1.0))
    simulator = Simulator(b, Settings(0.02, 0.02, gravity_ms2=(0, 0, -G), obstacles=(bowl, stone)))
    for _ in range(25):
        frame = simulator.advance()
        assert np.linalg.norm(frame.positions_m - [0, 0, 0.15], axis=1).max() < 0.15 + 0.02
        assert np.linalg.norm(frame.positions_m, axis=1).min() > 0.06 - 0.02


def test_what_touches_a_sticky_plate_goes_with_it():
    b = block(rigid=False, E=1e5)
    way = Motion(np.array([0.0, 0.2]), np.array([[0.0, 0, 0], [0.05, 0, 0.03]]))
    plate = Obstacle(RoundedBox((0.04, 0.04, -0.06), (0.1, 0.1, 0.06)), contact="sticky", motion=way)
    simulator = Simulator(b, Settings(0.02, 0.02, obstacles=(plate,), damping_per_s=20.0))
    for _ in range(20):
        frame = simulator.advance()
    np.testing.assert_allclose(frame.positions_m.mean(0) - b.positions_m.mean(0), [0.05, 0, 0.03], atol=0.5 * 0.02)


def test_a_rigid_block_that_lands_flat_is_not_turned_by_rounding():
    """Its corners come to the ground in one substep or, told apart by rounding, in two: some would bounce alone."""
    for k in range(0, 20, 2):
        b = block(rigid=True, at=(0, 0, 0.05 + 0.0007 * (k % 5)))
        drive = Drive(velocity_ms=(0.5, 0.0, -1 - 0.013 * k))
        simulator = Simulator(b, Settings(0.02, 0.02, ground=Ground(0.0, friction=0.0), drives=(drive,)))
        for _ in range(5):
            frame = simulator.advance()
        assert np.abs(frame.deformation_gradients - np.eye(3)).max() < 1e-5


@pytest.mark.parametrize("rigid", [False, True])
def test_a_driven_part_stops_at_the_ground_and_goes_on_along_it(rigid):
    b = block(rigid=rigid, at=(0, 0, 0.05))
    drive = Drive(velocity_ms=(0.5, 0.0, -1.0))
    simulator = Simulator(b, Settings(0.02, 0.02, ground=Ground(0.0, friction=0.0), drives=(drive,)))
    frames = [simulator.advance() for _ in range(10)]
    way = frames[-1].positions_m - b.positions_m
    assert way[:, 0] == pytest.approx(0.1, abs=1e-3)
    assert way[:, 2] == pytest.approx(-0.05, abs=2e-3)  # the lowest faces of its particles touch the ground
    assert np.abs(frames[-1].deformation_gradients - np.eye(3)).max() < 1e-3


def test_a_pinned_part_does_not_give_way_to_what_moves_against_it():
    b = block(rigid=False)
    plate = Obstacle(
        RoundedBox((0.04, 0.04, -0.08), (0.2, 0.2, 0.06)), motion=Motion.steady((0, 0, 0.2), from_s=0, to_s=1)
    )
    simulator = Simulator(b, Settings(0.02, 0.02, obstacles=(plate,), drives=(Drive(),)))
    for _ in range(5):
        frame = simulator.advance()
    assert np.abs(frame.positions_m - b.positions_m).max() < 1e-6


def test_an_obstacle_acts_only_while_it_is_there():
    b = block(rigid=False, at=(0, 0, 0.001))
    floor = Obstacle(HalfSpace((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), to_s=0.2)
    simulator = Simulator(b, Settings(0.02, 0.02, gravity_ms2=(0, 0, -G), obstacles=(floor,)))
    frames = [simulator.advance() for _ in range(20)]
    assert frames[9].positions_m[:, 2].min() > -0.015
    assert frames[-1].positions_m[:, 2].mean() - b.positions_m[:, 2].mean() == pytest.approx(-G * 0.04 / 2, rel=0.1)


def test_a_pushed_plate_goes_on_from_a_checkpoint():
    push = Push((0.0, 0, -1.0), force_n=50.0, mass_kg=1.0, ramp_s=0.1)
    plate = Obstacle(RoundedBox((0.04, 0.04, 0.13), (0.1, 0.1, 0.06)), push=push)
    b = block(rigid=False, E=1e5)
    settings = Settings(0.02, 0.02, ground=Ground(0.0), obstacles=(plate,))
    first = Simulator(b, settings)
    for _ in range(3):
        first.advance()
    second = Simulator(b, settings)
    second.restore(first.checkpoint())
    np.testing.assert_array_equal(first.advance().positions_m, second.advance().positions_m)
    np.testing.assert_array_equal(first.frame.reactions_n, second.frame.reactions_n)


@pytest.mark.parametrize(
    "shape",
    [
        RoundedBox((0.1, 0.2, 0.3), (0.3, 0.2, 0.1), 0.05, rotation=Rotation.from_rotvec([0.3, 0.2, -0.5]).as_matrix()),
        RoundedBox((0.1, 0.2, 0.3), (0, 0, 0.2), 0.1),
        RoundedBox((0.1, 0.2, 0.3), radius_m=0.2),
        HollowBall((0.1, 0.2, 0.3), 0.5),
        HalfSpace((0.1, 0.2, 0.3), (1.0, 2.0, 3.0)),
    ],
    ids=["box", "rod", "ball", "hollow", "wall"],
)
def test_distances_and_normals_are_those_of_the_shape(shape):
    from phys4dgen.mpm.kernels.rigid_contact import _surface
    from phys4dgen.mpm.solids import Solids

    points = np.random.default_rng(0).uniform(-0.6, 0.9, (400, 3))
    distance, normals = shape.distances(points)
    step = 1e-6
    slope = np.stack([(shape.distances(points + step * e)[0] - distance) / step for e in np.eye(3)], 1)
    smooth = np.abs(np.linalg.norm(slope, axis=1) - 1) < 1e-3
    assert smooth.mean() > 0.95
    np.testing.assert_allclose(normals[smooth], slope[smooth], atol=1e-3)
    surface = points - distance[:, None] * normals
    outside = smooth & (distance > 0)
    np.testing.assert_allclose(shape.distances(surface[outside])[0], 0, atol=1e-9)

    settings = Settings(0.02, 0.01, obstacles=(Obstacle(shape),))
    solids = Solids(settings, origin_m=np.array([-1.0, -1.0, -1.0]), mass_unit_kg=1.0)
    solids.begin(0.0, 0.01)
    row = solids.table()[0]
    same = np.array([_surface(row, *(point + 1.0)) for point in points])
    np.testing.assert_allclose(same[:, 0], distance, atol=1e-12)
    np.testing.assert_allclose(same[:, 1:], normals, atol=1e-9)
