"""Loads and set velocities beside what Newton says of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mpm_bodies import body, lattice
from phys4dgen.errors import SimulationError
from phys4dgen.mpm import (
    Acceleration,
    Attractor,
    Drive,
    Impulse,
    Noise,
    PerParticleForce,
    Settings,
    Simulator,
    TotalForce,
    Vortex,
    Wind,
)
from phys4dgen.mpm.fields import Sample

DX = 0.02
G = 9.81


def two_blocks(*, rho=(1000.0, 500.0), E=1e5):
    """Two blocks of 6 x 6 x 6 particles, 20 cells apart, parts 0 and 1."""
    x = np.concatenate([lattice((6, 6, 6), DX / 2), lattice((6, 6, 6), DX / 2, (0.4, 0, 0))])
    part = np.repeat([0, 1], 216)
    return body(x, (DX / 2) ** 3, E=E, part=part, rho=np.repeat(rho, 216))


def run(b, *, frames, frame_s=0.02, **settings):
    simulator = Simulator(b, Settings(DX, frame_s, **settings))
    return [simulator.advance() for _ in range(frames)]


def momentum(b, frame, part):
    mine = b.part == part
    return b.mass_kg[mine] @ frame.velocities_ms[mine].astype(float)


def test_a_total_force_gives_force_times_time_and_is_shared_by_mass():
    b = two_blocks()
    b = replace(b, density_kgm3=b.density_kgm3 * np.linspace(0.5, 1.5, len(b)))
    frame = run(b, frames=3, loads=(TotalForce((2.0, 0, -1.0), part=1, from_s=0.01, to_s=0.05),))[-1]
    np.testing.assert_allclose(momentum(b, frame, 1), [0.08, 0, -0.04], atol=2e-6)
    assert np.abs(momentum(b, frame, 0)).max() < 1e-7
    assert np.ptp(frame.velocities_ms[b.part == 1, 0]) < 1e-3 * frame.velocities_ms[b.part == 1, 0].mean()


def test_a_blow_changes_momentum_by_what_it_is():
    b = two_blocks()
    blows = (Impulse((0.1, 0, 0), part=0, from_s=0.0), Impulse((0, 0.03, 0), part=0, from_s=0.03))
    first, second = run(b, frames=2, loads=blows)
    np.testing.assert_allclose(momentum(b, first, 0), [0.1, 0, 0], atol=2e-6)
    np.testing.assert_allclose(momentum(b, second, 0), [0.1, 0.03, 0], atol=2e-6)


def test_a_force_per_particle_depends_on_how_many_there_are():
    b = two_blocks()
    chosen = b.positions_m[:, 0] < 0.03
    frame = run(b, frames=1, loads=(PerParticleForce((1e-3, 0, 0), part=0, chosen=chosen),))[-1]
    np.testing.assert_allclose(momentum(b, frame, 0), [1e-3 * chosen.sum() * 0.02, 0, 0], rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose(momentum(b, frame, 1), 0, atol=1e-9)


def test_uniform_loads_beside_fields_keep_their_impulse():
    b = two_blocks()
    loads = (Acceleration((1.0, 0, 0), part=0, from_s=0.004, to_s=0.031), PerParticleForce((0, 0, 1e-4), part=1))
    frame = run(b, frames=2, loads=loads)[-1]
    mass = b.mass_kg[b.part == 0].sum()
    np.testing.assert_allclose(momentum(b, frame, 0), [0.027 * mass, 0, 0], rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize("kind", ["linear", "quadratic"])
def test_terminal_velocity_under_drag(kind):
    b = two_blocks()
    drag = {"drag_per_s": 20.0} if kind == "linear" else {"drag_per_m": 40.0}
    frames = run(b, frames=20, gravity_ms2=(0, 0, -G), loads=(Wind((0, 0, 0), **drag),))
    speed = -np.array([frame.momentum_kgms[2] for frame in frames]) / b.mass_kg.sum()
    t = 0.02 * np.arange(1, 21)
    terminal = G / 20 if kind == "linear" else np.sqrt(G / 40)
    theory = terminal * (1 - np.exp(-20 * t) if kind == "linear" else np.tanh(G * t / terminal))
    assert speed[-1] == pytest.approx(terminal, rel=8e-3)  # g dt of weight comes between two pulls of drag
    np.testing.assert_allclose(speed, theory, atol=0.03 * terminal)


def test_wind_carries_what_it_blows_on_to_its_own_speed():
    b = two_blocks()
    frame = run(b, frames=10, loads=(Wind((1.5, 0, 0.5), drag_per_s=60.0, part=1),))[-1]
    np.testing.assert_allclose(frame.velocities_ms[b.part == 1].mean(0), [1.5, 0, 0.5], atol=0.01)
    assert np.abs(frame.velocities_ms[b.part == 0]).max() < 1e-6


def test_a_strong_wind_does_not_shorten_the_time_step_or_overshoot():
    b = two_blocks()
    frames = run(b, frames=3, loads=(Wind((1.0, 0, 0), drag_per_s=1e5),))
    assert max(frame.velocities_ms[:, 0].max() for frame in frames) < 1.001
    assert frames[-1].velocities_ms[:, 0].min() > 0.999


def one_block(at=(0.0, 0.0, 0.0), *, v=None):
    x = lattice((4, 4, 4), DX / 2)
    x = x - x.mean(0) + np.asarray(at, float)
    return body(x, (DX / 2) ** 3, E=1e5, v=None if v is None else np.tile(np.asarray(v, float), (64, 1)))


def test_a_spring_like_attractor_swings_with_its_period():
    b = one_block((0.1, 0, 0))
    spring = Attractor((0.0, 0.0, 0.0), 4.0, 0.1, falloff=-1.0)  # 40 1/s2
    period = 2 * np.pi / np.sqrt(40)
    frames = run(b, frames=40, frame_s=period / 40, loads=(spring,))
    x = np.array([frame.positions_m[:, 0].mean() for frame in frames])
    np.testing.assert_allclose(x, 0.1 * np.cos(2 * np.pi * np.arange(1, 41) / 40), atol=1.5e-3)


def test_an_orbit_round_an_attractor_keeps_its_energy():
    # a = k / r^2 at r = 0.2 m with the softening of the formula
    strength, radius = 2.0, 0.2
    s = radius * np.sqrt(1.01)
    speed = np.sqrt(strength * (radius / s) ** 3 * radius)
    b = one_block((radius, 0, 0), v=(0, speed, 0))
    period = 2 * np.pi * radius / speed
    frames = run(b, frames=30, frame_s=period / 30, loads=(Attractor((0.0, 0.0, 0.0), strength, radius),))
    centre = np.array([frame.positions_m.mean(0) for frame in frames])
    assert np.abs(np.linalg.norm(centre, axis=1) / radius - 1).max() < 0.02  # tides take a little
    assert np.linalg.norm(centre[-1] - [radius, 0, 0]) < 0.08 * radius
    velocity = np.array([frame.momentum_kgms for frame in frames]) / b.mass_kg.sum()
    potential = -strength * radius**2 / np.sqrt((centre**2).sum(1) + 0.01 * radius**2)
    energy = 0.5 * (velocity**2).sum(1) + potential
    assert np.ptp(energy) < 0.02 * abs(energy[0])


def test_a_vortex_that_turns_like_a_solid_gives_torque_times_time():
    x = lattice((6, 6, 6), DX / 2)
    b = body(x - x.mean(0), (DX / 2) ** 3, E=1e5)
    whirl = Vortex((0.0, 0.0, 0.0), (0.0, 0.0, 2.0), 3.0, 0.05, falloff=-1.0)  # 60 1/s2
    frame = run(b, frames=2, loads=(whirl,))[-1]
    inertia = b.mass_kg @ (b.positions_m[:, :2] ** 2).sum(1)
    assert frame.angular_momentum_kgm2s[2] == pytest.approx(inertia * 60 * 0.04, rel=0.01)
    assert np.abs(frame.angular_momentum_kgm2s[:2]).max() < 1e-3 * frame.angular_momentum_kgm2s[2]
    with_affine = inertia + b.mass_kg.sum() * DX**2 / 2  # of APIC's velocity gradients
    work = frame.angular_momentum_kgm2s[2] ** 2 / (2 * with_affine)
    assert frame.kinetic_energy_j + frame.elastic_energy_j == pytest.approx(work, rel=0.01)


def test_noise_has_its_strength_no_sources_and_is_the_same_again():
    noise = Noise(3.0, 0.2, time_scale_s=0.3, seed=5)
    rng = np.random.default_rng(0)
    points = rng.uniform(-5, 5, (4000, 3))

    def felt(points, time_s=0.7, field=noise):
        return field.at(Sample(points, np.zeros_like(points), np.ones(len(points)), time_s)).acceleration_ms2

    at = felt(points)
    assert np.sqrt((at**2).sum(1).mean()) == pytest.approx(3.0, rel=0.05)
    np.testing.assert_array_equal(at, felt(points, field=Noise(3.0, 0.2, time_scale_s=0.3, seed=5)))
    assert np.abs(at - felt(points, field=Noise(3.0, 0.2, time_scale_s=0.3, seed=6))).max() > 1
    step = 1e-5
    slopes = np.stack([(felt(points + step * e) - felt(points - step * e)) / (2 * step) for e in np.eye(3)], -1)
    divergence = np.trace(slopes, axis1=1, axis2=2)
    assert np.abs(divergence).max() < 1e-6 * np.abs(slopes).max() + 1e-3
    near = felt(points + 0.01)
    assert np.linalg.norm(near - at, axis=1).mean() < 0.3 * 3.0


def test_fields_do_not_depend_on_threads():
    import numba

    b = two_blocks()
    loads = (Noise(20.0, 0.05, seed=1), Wind((1, 0, 0), drag_per_m=2.0, part=0))

    def last(threads):
        before = numba.get_num_threads()
        numba.set_num_threads(threads)
        try:
            return run(b, frames=3, loads=loads, chunks=2)[-1]
        finally:
            numba.set_num_threads(before)

    one, two = last(1), last(min(2, numba.config.NUMBA_NUM_THREADS))
    np.testing.assert_array_equal(one.positions_m, two.positions_m)
    np.testing.assert_array_equal(one.velocities_ms, two.velocities_ms)


def test_a_load_on_a_part_that_does_not_exist_is_refused():
    with pytest.raises(SimulationError, match="TotalForce names part 7; the body has parts 0 to 1"):
        Simulator(two_blocks(), Settings(DX, 0.01, loads=(TotalForce((1.0, 0, 0), part=7),)))


# ------------------------------------------------------------------------------------------------ set velocities


def bar(*, E=1e5, held_end=True):
    """A bar of 48 x 6 x 6 particles along x, its first eighth held if asked for; nu = 0."""
    x = lattice((48, 6, 6), DX / 2)
    return body(x, (DX / 2) ** 3, E=E, nu=0.0, held=held_end & (x[:, 0] < 0.06))


def test_an_end_that_is_drawn_follows_exactly_and_stretches_the_rest():
    b = bar()
    end = b.positions_m[:, 0] > 0.42
    drive = Drive(velocity_ms=(0.04, 0.0, 0.0), chosen=end)
    frames = run(b, frames=15, drives=(drive,), damping_per_s=30.0)
    inside = b.positions_m[:, 0] > 0.45
    moved = frames[-1].positions_m - b.positions_m
    np.testing.assert_allclose(moved[inside], np.tile([0.012, 0, 0], (inside.sum(), 1)), atol=1e-6)
    middle = (b.positions_m[:, 0] > 0.2) & (b.positions_m[:, 0] < 0.28)
    strain = frames[-1].deformation_gradients[middle, 0, 0].mean() - 1
    assert 0.9 < strain / (0.012 / 0.36) < 1.02  # a clamp ends within a cell of what it holds
    np.testing.assert_allclose(
        frames[-1].deformation_gradients[inside], np.tile(np.eye(3), (inside.sum(), 1, 1)), atol=1e-5
    )


def test_an_end_that_is_turned_turns_like_a_solid():
    b = bar()
    end = b.positions_m[:, 0] > 0.42
    axis_at = (0.0, 0.03, 0.03)
    spin = Drive(spin_rad_s=(4.0, 0, 0), center_m=axis_at, to_s=0.2, chosen=end)
    frames = run(b, frames=10, drives=(spin,), damping_per_s=10.0)
    inside = b.positions_m[:, 0] > 0.45
    arms = b.positions_m[inside] - axis_at
    c, s = np.cos(0.8), np.sin(0.8)
    turned = np.stack([arms[:, 0], c * arms[:, 1] - s * arms[:, 2], s * arms[:, 1] + c * arms[:, 2]], 1)
    np.testing.assert_allclose(frames[-1].positions_m[inside] - axis_at, turned, atol=0.02 * 0.04)
    half = (b.positions_m[:, 0] > 0.23) & (b.positions_m[:, 0] < 0.25)
    away = frames[-1].positions_m[half] - axis_at
    before = b.positions_m[half] - axis_at
    angle = np.arctan2(
        before[:, 1] * away[:, 2] - before[:, 2] * away[:, 1], before[:, 1] * away[:, 1] + before[:, 2] * away[:, 2]
    )
    assert np.average(angle, weights=(before[:, 1:] ** 2).sum(1)) == pytest.approx(0.4, rel=0.1)  # linear along the bar


def test_what_is_let_go_layer_by_layer_falls_in_that_order():
    x = lattice((6, 6, 12), DX / 2)
    b = body(x, (DX / 2) ** 3, E=2e4)
    let_go_s = 0.2 * x[:, 2] / x[:, 2].max()
    frames = run(b, frames=15, gravity_ms2=(0, 0, -G), drives=(Drive(to_s=0.2, let_go_s=let_go_s),))
    top, bottom = x[:, 2] > 0.1, x[:, 2] < 0.02
    at = frames[3].positions_m - x  # at 0.08 s
    assert np.abs(at[top]).max() < 1e-6
    assert at[bottom, 2].mean() < -1e-4  # it hangs on the rest
    speed = frames[-1].momentum_kgms[2] / b.mass_kg.sum()
    assert speed < -0.1 * G  # all of it falls at last


def test_a_driven_rigid_part_moves_as_told():
    b = replace(one_block(), rigid_group=np.zeros(64, np.int32))
    frame = run(b, frames=5, gravity_ms2=(0, 0, -G), drives=(Drive(velocity_ms=(0.1, 0, 0)),))[-1]
    np.testing.assert_allclose(frame.positions_m - b.positions_m, np.tile([0.01, 0, 0], (64, 1)), atol=1e-5)


def test_twice_the_force_moves_a_stalk_twice_as_far_and_the_opposite_force_the_other_way():
    """The paper's three forces f1 = (1, 0, 0), f2 = (2, 0, 0), f3 = (-1, 0, 0) on a stalk of jelly."""
    x = lattice((6, 6, 24), DX / 2)
    b = body(x, (DX / 2) ** 3, E=2e5, rho=500.0, nu=0.3, held=x[:, 2] < 0.03)
    top = x[:, 2] > 0.2

    def farthest(force_n):
        push = TotalForce((force_n, 0.0, 0.0), chosen=top, to_s=0.1)
        moved = [frame.positions_m[top, 0].mean() - x[top, 0].mean() for frame in run(b, frames=10, loads=(push,))]
        return max(moved, key=abs)

    one = farthest(1.0)
    assert one > 0.1 * DX
    assert 1.6 < farthest(2.0) / one < 2.4
    assert farthest(-1.0) == pytest.approx(-one, rel=0.1)


@pytest.mark.parametrize("alike", [False, True])
def test_under_one_force_the_soft_layer_gives_way_and_the_stiff_one_does_not(alike):
    """The paper's hamburger: bun over patty over bun, pressed from above, with and without materials by part."""
    x = lattice((8, 8, 12), DX / 2)
    layer = np.digitize(x[:, 2], [0.04, 0.08])
    E = np.where(layer == 1, 2e4 if alike else 1e5, 2e4)
    b = body(x, (DX / 2) ** 3, E=E, nu=0.2, rho=300.0, part=layer, held=x[:, 2] < 0.01)
    push = TotalForce((0, 0, -10.0), part=2, ramp_s=0.1)
    frame = run(b, frames=25, loads=(push,), damping_per_s=30.0)[-1]

    def strain(part):
        mine = b.part == part
        heights = [points[mine, 2] for points in (frame.positions_m, b.positions_m)]
        return 1 - np.ptp(heights[0]) / np.ptp(heights[1])

    ratio = strain(0) / strain(1)
    assert (0.7 < ratio < 1.25) if alike else ratio >= 1.5
