"""Momentum under gravity and damping, and thin parts; the textbook cases are in ``test_validation.py``."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from validation.thin import ratio

from mpm_bodies import body, lattice
from phys4dgen.mpm import Settings, Simulator

G = 9.81


def spinning_cube():
    x = lattice((12, 12, 12), 0.01, (-0.06, -0.06, -0.06))
    return body(x, 1e-6, E=4e5, nu=0.3, v=np.cross([6.0, -3.0, 20.0], x) + np.array([0.3, 0.1, 0]))


def test_grid_mass_is_the_body_mass():
    b = spinning_cube()
    simulator = Simulator(b, Settings(0.02, 0.01, gravity_ms2=(0, 0, -G)))
    frame = simulator.advance()
    gained = frame.momentum_kgms - b.mass_kg @ b.velocities_ms
    np.testing.assert_allclose(gained, [0, 0, -G * 0.01 * b.mass_kg.sum()], atol=1e-6)


def test_damping_relative_to_rigid_motion_keeps_flight_and_spin():
    b = spinning_cube()
    free = Simulator(b, Settings(0.02, 0.05, gravity_ms2=(0, 0, -G)))
    damped = Simulator(
        b, Settings(0.02, 0.05, gravity_ms2=(0, 0, -G), damping_per_s=20, damping_relative_to_rigid=True)
    )
    for _ in range(4):
        truth, frame = free.advance(), damped.advance()
    np.testing.assert_allclose(frame.momentum_kgms, truth.momentum_kgms, atol=2e-4 * np.abs(truth.momentum_kgms).max())
    spin = np.abs(truth.angular_momentum_kgm2s).max()
    np.testing.assert_allclose(frame.angular_momentum_kgm2s, truth.angular_momentum_kgm2s, atol=1e-3 * spin)


@pytest.mark.parametrize("phase", list(itertools.product((0, 0.25), (0, 0.5))))
@pytest.mark.parametrize("shape", ["sheet", "rod"])
def test_thin_parts_bend_as_theory_says(shape, phase):
    """t/dx = 0.2 as the product simulates it: one cell thick, with the mass and bending stiffness of the thin one."""
    assert ratio(shape, t_dx=0.2, floor_cells=1.0, phase=phase, tilt_deg=0) == pytest.approx(1, abs=0.05)


def test_sheet_of_two_layers_bends_as_theory_says_where_its_particles_lie_on_nodes():
    """t/dx = 0.2 as it is."""
    assert ratio("sheet", t_dx=0.2, floor_cells=0, phase=(0.25, 0), tilt_deg=0) == pytest.approx(1, abs=0.05)


def test_sheet_between_nodes_is_too_stiff_by_the_fault_of_the_linear_fit():
    """By 1 + 12 (G / E) (2 m3)^2 (dx / t)^2, the spurious shear of the MLS gradient (``validation.thin``)."""
    m3 = 0.25 / 4 - 0.25**3
    predicted = math.sqrt(1 + 12 * 0.5 * (2 * m3) ** 2 / 0.2**2)
    assert ratio("sheet", t_dx=0.2, floor_cells=0, phase=(0, 0), tilt_deg=0) == pytest.approx(predicted, rel=0.06)
