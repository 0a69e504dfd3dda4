"""Textbook cases (PHYSICS table B): free fall, momentum, self-weight, bars, sheet, stability limit."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from benchmarks.thin import ratio

from mpm_bodies import body, lattice
from phys4dgen.errors import SimulationError
from phys4dgen.mpm import LawId, Settings, Simulator
from reference.mpm_reference import kirchhoff_stress

G = 9.81


def frequency_hz(signal, frame_time_s):
    """Mean frequency of an oscillation from its interpolated upward zero crossings."""
    s = signal - signal.mean()
    up = np.flatnonzero((s[:-1] < 0) & (s[1:] >= 0))
    assert len(up) >= 2
    crossings = up + s[up] / (s[up] - s[up + 1])
    return 1 / (np.diff(crossings).mean() * frame_time_s)


def test_b1_free_fall():
    x = lattice((6, 6, 6), 0.01)
    simulator = Simulator(body(x, 1e-6, E=2e5), Settings(0.02, 0.05, gravity_ms2=(0, 0, -G)))
    squares, fallen, substeps = 0.0, 0.0, 0
    while substeps < 1000:
        frame = simulator.advance()
        substeps += frame.substeps
        squares += frame.substeps * frame.dt_s**2
        fallen = -G * (frame.time_s**2 + squares) / 2  # symplectic Euler, sum of t_i dt_i
    np.testing.assert_allclose(frame.positions_m - x, np.broadcast_to([0, 0, fallen], x.shape), atol=1e-4 * abs(fallen))
    np.testing.assert_allclose(frame.deformation_gradients, np.tile(np.eye(3), (len(x), 1, 1)), atol=1e-4)


def spinning_cube(**keywords):
    x = lattice((12, 12, 12), 0.01, (-0.06, -0.06, -0.06))
    omega = np.array([6.0, -3.0, 20.0])
    return body(x, 1e-6, E=4e5, nu=0.3, v=np.cross(omega, x) + np.array([0.3, 0.1, 0]), **keywords), omega


def test_b2_spinning_cube_keeps_mass_momentum_and_energy():
    b, _ = spinning_cube()
    simulator = Simulator(b, Settings(0.02, 0.0375))
    start = simulator.frame
    affine = 0.02**2 / 2 * b.mass_kg.sum() * np.array([6.0, -3.0, 20.0])  # what C adds once the grid has seen it
    momentum = b.mass_kg @ b.velocities_ms
    first = simulator.advance()
    energies = [first.kinetic_energy_j + first.elastic_energy_j]
    frames, substeps = [first], first.substeps
    while substeps < 2500:
        frames.append(simulator.advance())
        substeps += frames[-1].substeps
        energies.append(frames[-1].kinetic_energy_j + frames[-1].elastic_energy_j)
    last = frames[-1]
    scale = np.linalg.norm(first.angular_momentum_kgm2s)
    assert np.abs(last.momentum_kgms - momentum).max() < 1e-4 * np.linalg.norm(momentum)
    assert np.abs(last.angular_momentum_kgm2s - first.angular_momentum_kgm2s).max() < 1e-4 * scale
    assert np.abs(last.angular_momentum_kgm2s - start.angular_momentum_kgm2s).max() < 1e-4 * scale
    assert np.linalg.norm(affine) > 1e-3 * scale  # the term is not negligible: leaving it out would be seen
    turns = last.time_s * np.linalg.norm([6, -3, 20]) / (2 * np.pi)
    assert np.diff(energies).max() < 1e-4 * energies[0]
    assert energies[-1] > energies[0] * (1 - 0.01 * turns)


def test_grid_mass_is_the_body_mass():
    b, _ = spinning_cube()
    simulator = Simulator(b, Settings(0.02, 0.01, gravity_ms2=(0, 0, -G)))
    frame = simulator.advance()
    gained = frame.momentum_kgms - b.mass_kg @ b.velocities_ms
    np.testing.assert_allclose(gained, [0, 0, -G * 0.01 * b.mass_kg.sum()], atol=1e-6)


def test_damping_relative_to_rigid_motion_keeps_flight_and_spin():
    b, _ = spinning_cube()
    free = Simulator(b, Settings(0.02, 0.05, gravity_ms2=(0, 0, -G)))
    damped = Simulator(
        b, Settings(0.02, 0.05, gravity_ms2=(0, 0, -G), damping_per_s=20, damping_relative_to_rigid=True)
    )
    for _ in range(4):
        truth, frame = free.advance(), damped.advance()
    np.testing.assert_allclose(frame.momentum_kgms, truth.momentum_kgms, atol=2e-4 * np.abs(truth.momentum_kgms).max())
    spin = np.abs(truth.angular_momentum_kgm2s).max()
    np.testing.assert_allclose(frame.angular_momentum_kgm2s, truth.angular_momentum_kgm2s, atol=1e-3 * spin)


def clamped(free_positions, held_positions, dx):
    """Joined positions, who is held, and a marker below that puts a grid node 0.05 dx inside the clamp at z = 0."""
    marker = np.array([[free_positions[:, 0].min(), free_positions[:, 1].min(), -8.05 * dx]])
    x = np.concatenate([free_positions, held_positions, marker])
    return x, np.arange(len(x)) >= len(free_positions)


def test_b3_column_under_its_own_weight():
    dx, H, E, rho = 1 / 16, 1.0, 1e5, 1000.0
    h = dx / 2
    free, foot = lattice((8, 8, 32), h), lattice((8, 8, 6), h, (0, 0, -6 * h))
    x, held = clamped(free, foot, dx)
    b = body(x, h**3, E=E, rho=rho, nu=0.0, held=held)
    omega = np.pi / 2 * np.sqrt(E / rho) / H
    simulator = Simulator(b, Settings(dx, 0.5, gravity_ms2=(0, 0, -G), damping_per_s=2 * omega))
    for _ in range(4):
        frame = simulator.advance()
    assert frame.max_speed_ms < 1e-3
    z = free[:, 2]
    sunk = -(frame.positions_m - x)[~held, 2]
    top = z > H - h
    expected = rho * G * (H * z - z**2 / 2) / E
    assert sunk[top].mean() == pytest.approx(expected[top].mean(), rel=0.05)
    F = frame.deformation_gradients[~held].astype(float)
    tau = kirchhoff_stress(F, b.lame_mu_pa[~held], b.lame_lambda_pa[~held], b.law[~held])
    stress = -tau[:, 2, 2] / np.linalg.det(F)
    inside = z > 2 * dx  # the clamp and one cell above it
    assert np.sqrt(np.mean((stress - rho * G * (H - z))[inside] ** 2)) < 0.08 * rho * G * H


@pytest.mark.parametrize("law", list(LawId))
def test_b4_free_bar_rings_at_its_axial_frequency(law):
    dx, cells, E, rho = 0.01, 32, 1e5, 1000.0
    L, c = cells * dx, np.sqrt(E / rho)
    x = lattice((2 * cells, 6, 6), dx / 2)
    v = np.zeros_like(x)
    v[:, 0] = 0.01 * np.cos(np.pi * x[:, 0] / L)
    period = 2 * L / c
    simulator = Simulator(body(x, (dx / 2) ** 3, E=E, rho=rho, nu=0.0, law=law, v=v), Settings(dx, period / 20))
    right, left = x[:, 0] > L - dx, x[:, 0] < dx
    length = []
    for _ in range(80):
        positions = simulator.advance().positions_m
        length.append(positions[right, 0].mean() - positions[left, 0].mean())
    assert frequency_hz(np.array(length), period / 20) == pytest.approx(1 / period, rel=0.01)


@pytest.mark.parametrize(("wall_dx", "rel"), [(0.0, 0.02), (0.5, 1 / 32)])
def test_b5_bar_held_at_one_end_rings_at_a_quarter_of_its_wave(wall_dx, rel):
    """The wall is where the held nodes end: first order in dx, exact to 2 % where it lies on a node."""
    dx, cells, E, rho = 0.01, 32, 1e5, 1000.0
    L, c = cells * dx, np.sqrt(E / rho)
    period = 4 * L / c
    x = lattice((2 * cells + 8, 6, 6), dx / 2, (-4 * dx, 0, 0))
    x = np.concatenate([x, [[-(8 + wall_dx) * dx, 0, 0]]])  # a crumb that sets where the grid's nodes lie
    held = x[:, 0] < 0
    v = np.zeros_like(x)
    v[:, 0] = np.where(held, 0, 0.01 * np.sin(np.pi * x[:, 0] / (2 * L)))
    simulator = Simulator(body(x, (dx / 2) ** 3, E=E, rho=rho, nu=0.0, held=held, v=v), Settings(dx, period / 20))
    end = x[:, 0] > L - dx
    reached = np.array([simulator.advance().positions_m[end, 0].mean() for _ in range(60)])
    assert frequency_hz(reached, period / 20) == pytest.approx(1 / period, rel=rel)


@pytest.mark.parametrize("phase", list(itertools.product((0, 0.25), (0, 0.5))))
@pytest.mark.parametrize("shape", ["sheet", "rod"])
def test_thin_parts_bend_as_theory_says(shape, phase):
    """t/dx = 0.2 as the product simulates it: one cell thick, with the mass and bending stiffness of the thin one."""
    assert ratio(shape, t_dx=0.2, floor_cells=1.0, phase=phase, tilt_deg=0) == pytest.approx(1, abs=0.05)


def test_sheet_of_two_layers_bends_as_theory_says_where_its_particles_lie_on_nodes():
    """t/dx = 0.2 as it is."""
    assert ratio("sheet", t_dx=0.2, floor_cells=0, phase=(0.25, 0), tilt_deg=0) == pytest.approx(1, abs=0.05)


def test_sheet_between_nodes_is_too_stiff_by_the_fault_of_the_linear_fit():
    """By 1 + 12 (G / E) (2 m3)^2 (dx / t)^2, the spurious shear of the MLS gradient (benchmarks/thin.py)."""
    m3 = 0.25 / 4 - 0.25**3
    predicted = math.sqrt(1 + 12 * 0.5 * (2 * m3) ** 2 / 0.2**2)
    assert ratio("sheet", t_dx=0.2, floor_cells=0, phase=(0, 0), tilt_deg=0) == pytest.approx(predicted, rel=0.06)


def random_cube(cfl, E=1e6):
    x = np.random.default_rng(0).random((262, 3)) * 3.2 * 0.01
    v = np.random.default_rng(1).normal(0, 0.5, x.shape)
    b = body(x, (0.032**3) / 262, E=E, v=v, names=("jelly",))
    return Simulator(b, Settings(0.01, 0.02, cfl=cfl))


@pytest.mark.parametrize("cfl", [0.3, 0.5])
def test_b18_stable_below_the_limit(cfl):
    simulator = random_cube(cfl)
    energy = 0.5 * simulator.body.mass_kg @ (simulator.body.velocities_ms**2).sum(1)
    for _ in range(5):
        frame = simulator.advance()
    assert np.isfinite(frame.positions_m).all()
    assert frame.kinetic_energy_j + frame.elastic_energy_j < 1.01 * energy


def test_b18_beyond_the_limit_the_error_names_part_frame_and_cause():
    simulator = random_cube(3.0)
    with pytest.raises(SimulationError, match=r"frame \d+ at .* s.*'jelly'.*cfl 3") as caught:
        for _ in range(50):
            simulator.advance()
    assert "\n" not in str(caught.value)
    assert np.isfinite(simulator.frame.positions_m).all()
