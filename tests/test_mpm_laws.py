"""The elastic laws and the fluid: engine against float64 reference, energies, objectivity, digits of small strains."""

from __future__ import annotations

import numpy as np
import pytest

from law_points import COUNT, Points
from phys4dgen.mpm.laws import LAWS, LawId
from phys4dgen.types import LAW_NUMBERS
from reference.law_reference import energy, kirchhoff

ELASTIC = ["neo_hookean", "fixed_corotated", "stvk_hencky"]
GIVEN = {
    "yield_stress_pa": 500.0,
    "friction_angle_deg": 30.0,
    "critical_compression": 0.025,
    "critical_stretch": 0.0075,
    "hardening_coefficient": 10.0,
    "consistency_pasn": 10.0,
    "flow_exponent": 0.5,
    "viscosity_pas": 1.0,
}


def points_of(law, **numbers):
    law_id = LawId[law.upper()]
    needed = {number.name for number in LAW_NUMBERS[law] if number.default is None}
    return Points(law_id, **{name: GIVEN[name] for name in needed} | numbers)


def rotation(seed=5):
    Q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return Q * np.sign(np.linalg.det(Q))


@pytest.fixture
def gradients():
    rng = np.random.default_rng(4)
    F = np.eye(3) + 0.35 * rng.uniform(-1, 1, (COUNT, 3, 3))
    F[0] = np.eye(3)
    F[1:4] = np.eye(3) + 1e-4 * rng.normal(size=(3, 3, 3))
    F[4] = np.diag([0.4, 1.5, 1.2])
    F[5] = np.diag([1.2, 1.2, 0.9])  # two equal stretches
    F[6] = 1.1 * rotation(6)
    return F.astype(np.float32).astype(float)


def test_every_law_has_a_kernel_and_a_list_of_numbers():
    assert set(LAWS) == set(LawId)
    assert {law.name.lower() for law in LawId} == set(LAW_NUMBERS)


@pytest.mark.parametrize("law", [*ELASTIC, "fluid"])
def test_reference_stress_is_the_derivative_of_the_energy(law):
    rng = np.random.default_rng(1)
    F = np.eye(3) + 0.3 * rng.uniform(-1, 1, (50, 3, 3))
    mu, lam, step = rng.uniform(1, 2, 50), rng.uniform(1, 3, 50), 1e-6
    tau = kirchhoff(law, F, mu, lam)
    for i in range(3):
        for j in range(3):
            nudge = np.zeros((3, 3))
            nudge[i, j] = step
            up, down = (energy(law, (np.eye(3) + sign * nudge) @ F, mu, lam) for sign in (1, -1))
            np.testing.assert_allclose(tau[:, i, j], (up - down) / (2 * step), rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("law", ELASTIC)
def test_stress_and_energy_equal_the_reference(law, gradients):
    rng = np.random.default_rng(2)
    points = points_of(law, E=rng.uniform(1, 2, COUNT), nu=rng.uniform(0, 0.45, COUNT))
    tau = points.deform(gradients)
    np.testing.assert_allclose(tau, kirchhoff(law, gradients, points.mu, points.lam), atol=1e-5)
    np.testing.assert_allclose(points.F, gradients, atol=1e-7)
    np.testing.assert_allclose(points.energy_pa(), energy(law, points.F, points.mu, points.lam), atol=1e-12)
    assert np.abs(tau[0]).max() < 1e-6  # no stress at rest


@pytest.mark.parametrize("law", ELASTIC)
def test_small_strains_keep_their_digits(law):
    strain = 10.0 ** np.linspace(-9, -3, COUNT)
    rng = np.random.default_rng(3)
    small = rng.normal(size=(COUNT, 3, 3)) * strain[:, None, None]
    points = points_of(law, E=1.0)
    tau = points.deform(np.eye(3) + small)
    symmetric = (small + small.transpose(0, 2, 1)) / 2
    hooke = 2 * points.mu[0] * symmetric + points.lam[0] * np.eye(3) * np.trace(small, axis1=1, axis2=2)[:, None, None]
    error = np.abs(tau - hooke).max((1, 2)) / np.abs(hooke).max((1, 2))
    assert (error < 1e-6 + 10 * strain).all()


@pytest.mark.parametrize("law", ELASTIC)
@pytest.mark.parametrize("size", [0.003, 0.03, 0.1, 0.19, 0.21, 0.3])
def test_stress_is_right_on_both_sides_of_where_eigenvectors_take_over(law, size):
    # |b - I| = 0.4 in a batch decides (elastic_strain.NEAR_ZERO); a stretch of about 0.19
    rng = np.random.default_rng(9)
    H = rng.normal(size=(COUNT, 3, 3))
    F = (np.eye(3) + size * H / np.linalg.norm(H, axis=(1, 2), keepdims=True)) @ rotation(7)
    points = points_of(law, E=1.0)
    tau = points.deform(F)
    expected = kirchhoff(law, points.F, points.mu, points.lam)
    assert np.abs(tau - expected).max() < 2e-6 * np.abs(expected).max() + 2e-7


@pytest.mark.parametrize("law", list(LAW_NUMBERS))
def test_stress_turns_with_the_body(law, gradients):
    C = 0.1 * (gradients - np.eye(3))
    Q = rotation()
    # E = 1e5, so stresses of some kPa; the second set of points sees the world turned by Q from the start
    a, b = points_of(law), points_of(law)
    for k in range(12):
        push = C * (1 if k < 8 else -1)
        tau, turned = a.step(push), b.step(Q @ push @ Q.T)
    np.testing.assert_allclose(turned, Q @ tau @ Q.T, atol=2e-4 * np.abs(tau).max())


@pytest.mark.parametrize("law", list(LAW_NUMBERS))
def test_a_rigid_turn_makes_no_stress(law):
    points = points_of(law, E=1e5)
    spin = np.zeros((3, 3))
    spin[0, 1], spin[1, 0] = -1, 1
    for _ in range(200):
        tau = points.step(spin, dt=0.002)  # each step stretches by (0.002)^2 / 2
    assert np.abs(tau).max() < 1e5 * 200 * 0.002**2
    assert points.F[0, 1, 0] == pytest.approx(np.sin(0.4), abs=1e-3)


@pytest.mark.parametrize("law", list(LAW_NUMBERS))
def test_a_particle_turned_inside_out_or_flat_gives_finite_stress(law):
    points = points_of(law)
    F = np.tile(np.diag([1, 1, -0.5]), (COUNT, 1, 1))
    F[1:] = 0
    F[2:] = np.diag([1e3, 1e-3, 1.0])
    F[3:] = np.diag([1.0, 1.0, 0.0])
    assert np.isfinite(points.deform(F)).all()
    assert np.isfinite(points.energy_pa()).all()


@pytest.mark.parametrize("law", [*ELASTIC, "von_mises"])
def test_damping_adds_a_viscous_stress(law, gradients):
    rng = np.random.default_rng(8)
    C = rng.normal(size=(COUNT, 3, 3))
    plain, damped = points_of(law, E=2.0), points_of(law, E=2.0, damping_time_s=0.3)
    assert damped.law.damped
    for points in (plain, damped):
        points.deform(gradients)
    viscous = damped.step(C, dt=1e-6) - plain.step(C, dt=1e-6)
    J = np.linalg.det(damped.F)[:, None, None]
    np.testing.assert_allclose(viscous, J * 2.0 * 0.3 * (C + C.transpose(0, 2, 1)), atol=3e-5)
    assert (damped.body.kinematic_viscosity_m2s == 2.0 * 0.3 / 1e3).all()


def test_fluid_pressure_follows_tait():
    J = np.linspace(0.7, 1.0, COUNT)
    bulk = 1e5
    points = Points(LawId.FLUID, E=3 * bulk * (1 - 2 * 0.49), nu=0.49, viscosity_pas=0.0)
    tau = points.deform(np.eye(3) * np.cbrt(J)[:, None, None])
    trace = 3 * (np.cbrt(J) - 1)  # J <- J (1 + dt tr C) in one big step
    expected = kirchhoff("fluid", np.eye(3) * np.cbrt(1 + trace)[:, None, None], 0.0, bulk)
    np.testing.assert_allclose(tau, expected, rtol=2e-6, atol=1e-3)
    np.testing.assert_allclose(
        points.energy_pa(),
        energy("fluid", np.eye(3) * np.cbrt(1 + trace)[:, None, None], 0, bulk),
        rtol=1e-4,
        atol=1e-6,
    )
    # the last digits of J count: 1e-6 of volume is a pressure of 0.1 Pa
    small = Points(LawId.FLUID, E=3 * bulk * (1 - 2 * 0.49), nu=0.49, viscosity_pas=0.0)
    for _ in range(1000):
        tau = small.step(np.eye(3) * -1e-9 / 3)
    np.testing.assert_allclose(tau[:, 0, 0], -bulk * 1e-6, rtol=1e-4)


def test_fluid_does_not_pull_and_does_not_remember():
    points = Points(LawId.FLUID, E=6000, nu=0.49, viscosity_pas=0.0)
    assert np.abs(points.deform(np.eye(3) * 1.2)).max() == 0
    tau = points.step(np.diag([-0.01, 0.0, 0.0]))
    assert tau[0, 0, 0] < -0.9e5 * 0.01  # pressed from where it came apart
    assert np.abs(tau - np.eye(3) * tau[:, :1, :1]).max() < 1e-6 * abs(tau[0, 0, 0])


def test_fluid_viscosity_is_newtons():
    points = Points(LawId.FLUID, E=6000, nu=0.49, viscosity_pas=3.0)
    shear = np.zeros((3, 3))
    shear[0, 1] = 7.0
    tau = points.step(shear, dt=1e-4)
    assert tau[0, 0, 1] == pytest.approx(21.0, rel=1e-5)
