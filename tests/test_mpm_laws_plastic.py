"""The laws that flow: engine against float64 reference along paths, yield surfaces, and numbers known from theory."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from law_points import COUNT, Points, deviator
from phys4dgen.mpm.laws import LawId
from reference.law_reference import DruckerPrager, HerschelBulkley, Snow, VonMises

FACTOR = np.sqrt(2 / 3)
SHEAR = np.zeros((3, 3))
SHEAR[0, 1] = 1.0
ISOCHORIC = np.diag([-1.0, 0.5, 0.5])


def pairs():
    """(name, engine's points, reference) of every law that flows."""
    mu, lam = 1e5 / 2.6, 1e5 * 0.3 / (1.3 * 0.4)
    base = (COUNT, mu, lam)
    return {
        "perfectly plastic": (
            Points(LawId.VON_MISES, yield_stress_pa=2e3),
            VonMises(*base, yield_stress=2e3),
        ),
        "hardening": (
            Points(LawId.VON_MISES, yield_stress_pa=2e3, hardening_modulus_pa=2e4),
            VonMises(*base, yield_stress=2e3, hardening=2e4),
        ),
        "softening": (
            Points(LawId.VON_MISES, yield_stress_pa=3e3, hardening_modulus_pa=-2e4, residual_yield_stress_pa=1e3),
            VonMises(*base, yield_stress=3e3, hardening=-2e4, residual=1e3),
        ),
        "dry sand": (Points(LawId.DRUCKER_PRAGER, friction_angle_deg=30), DruckerPrager(*base, angle_deg=30)),
        "damp sand": (
            Points(LawId.DRUCKER_PRAGER, friction_angle_deg=37, cohesion_pa=800),
            DruckerPrager(*base, angle_deg=37, cohesion=800.0),
        ),
        "snow": (
            Points(LawId.SNOW, critical_compression=0.025, critical_stretch=0.0075, hardening_coefficient=10),
            Snow(*base, compression=0.025, stretch=0.0075, hardening=10),
        ),
        "bingham": (
            Points(LawId.VISCOPLASTIC, yield_stress_pa=1e3, viscosity_pas=300),
            HerschelBulkley(*base, yield_stress=1e3, consistency=300),
        ),
        "thinning": (
            Points(LawId.HERSCHEL_BULKLEY, yield_stress_pa=1e3, consistency_pasn=500, flow_exponent=0.4),
            HerschelBulkley(*base, yield_stress=1e3, consistency=500, exponent=0.4),
        ),
        "thickening": (
            Points(LawId.HERSCHEL_BULKLEY, yield_stress_pa=1e3, consistency_pasn=100, flow_exponent=1.6),
            HerschelBulkley(*base, yield_stress=1e3, consistency=100, exponent=1.6),
        ),
    }


@pytest.mark.parametrize("name", list(pairs()))
def test_a_path_of_sixty_steps_equals_the_reference(name):
    points, reference = pairs()[name]
    rng = np.random.default_rng(9)
    C, turn = rng.normal(0, 6, (2, COUNT, 3, 3))
    C -= np.eye(3)  # more pressing than pulling
    peak = 0.0
    for k in range(60):
        now = (np.cos(k / 9) * C + np.sin(k / 9) * turn).astype(np.float32).astype(float)
        tau, expected = points.step(now, dt=2e-3), reference.step(now, float(np.float32(2e-3)))
        peak = max(peak, np.abs(expected).max())
        np.testing.assert_allclose(tau, expected, atol=1e-4 * peak)
    # b rather than F is kept, and E = b - 1
    np.testing.assert_allclose(points.elastic_b, reference.F @ reference.F.transpose(0, 2, 1), atol=2e-5)
    assert np.abs(points.F - np.eye(3)).max() > 0.2  # the total F shows what the elastic state forgot


@pytest.mark.parametrize("name", list(pairs()))
def test_asking_again_without_time_changes_nothing(name):
    points, _ = pairs()[name]
    rng = np.random.default_rng(10)
    tau = points.step(rng.normal(0, 3, (COUNT, 3, 3)), dt=0.02)
    before = points.state
    again = points.step(np.zeros((3, 3)), dt=0.0)
    np.testing.assert_allclose(again, tau, atol=2e-5 * np.abs(tau).max())
    for key, values in points.state.items():
        np.testing.assert_allclose(values, before[key], atol=3e-6)


@pytest.mark.parametrize("name", [n for n in pairs() if n not in ("dry sand", "snow")])
def test_below_the_yield_stress_nothing_is_kept(name):
    points, _ = pairs()[name]
    for k in range(400):
        tau = points.step(SHEAR * (1 if k < 200 else -1), dt=2e-5)
        if k == 199:
            assert tau[0, 0, 1] == pytest.approx(1e5 / 2.6 * 0.004, rel=1e-3)
    # Euler forward: F returns to 1 up to the square of a step
    assert np.abs(points.elastic_b - np.eye(3)).max() < 1e-6
    assert np.abs(tau).max() < 1e5 * 1e-6


strains = st.lists(st.floats(-0.6, 0.6), min_size=9, max_size=9)


@settings(max_examples=60, deadline=None)
@given(strains, st.floats(0.3, 30), st.floats(-0.9, 2.0))
def test_von_mises_lands_on_its_surface(gradient, yield_per_mille, hardening):
    E, yield_stress = 1e5, 1e2 * yield_per_mille
    residual = 0.2 * yield_stress
    points = Points(
        LawId.VON_MISES,
        E=E,
        yield_stress_pa=yield_stress,
        hardening_modulus_pa=hardening * E / 1.3 * 0.9,
        residual_yield_stress_pa=residual,
    )
    _, norm = deviator(points.deform(np.eye(3) + np.reshape(gradient, (3, 3))))
    flow = points.state["flow"]
    strength = np.maximum(yield_stress + hardening * E / 1.3 * 0.9 * FACTOR * flow, residual)
    allowed = FACTOR * strength
    round_off = 2e-6 * E
    assert (norm <= allowed * (1 + 1e-5) + round_off).all()
    assert (np.abs(norm - allowed)[flow > 0] <= 1e-5 * allowed[flow > 0] + round_off).all()


@settings(max_examples=60, deadline=None)
@given(strains, st.floats(5, 50), st.floats(0, 2e3))
def test_drucker_prager_stays_in_its_cone(gradient, angle, cohesion):
    points = Points(LawId.DRUCKER_PRAGER, friction_angle_deg=angle, cohesion_pa=cohesion)
    tau = points.deform(np.eye(3) + np.reshape(gradient, (3, 3)))
    sine = np.sin(np.radians(angle))
    alpha = FACTOR * 2 * sine / (3 - sine)
    _, norm = deviator(tau)
    pressed = -np.trace(tau, axis1=1, axis2=2)
    torn = points.state["gap"] > 0
    assert (tau[torn] == 0).all()
    allowed = alpha * (pressed + 3 * cohesion / np.tan(np.radians(angle)))
    assert (norm <= allowed * (1 + 1e-5) + 0.3).all()


@settings(max_examples=60, deadline=None)
@given(strains)
def test_snow_stays_within_its_critical_stretches(gradient):
    points = Points(LawId.SNOW, critical_compression=0.025, critical_stretch=0.0075, hardening_coefficient=10)
    F = np.eye(3) + np.reshape(gradient, (3, 3))
    points.deform(F)
    s = np.sqrt(np.linalg.eigvalsh(points.elastic_b))
    assert s.min() >= 0.975 - 1e-6
    assert s.max() <= 1.0075 + 1e-6


@settings(max_examples=40, deadline=None)
@given(strains, st.floats(0.2, 2.0), st.floats(-1, 4), st.floats(-5, -1))
def test_herschel_bulkley_solves_its_equation(gradient, exponent, log_consistency, log_dt):
    mu = 1e5 / 2.6
    consistency, dt, yield_stress = 10**log_consistency, 10**log_dt, 500.0
    points = Points(
        LawId.HERSCHEL_BULKLEY, yield_stress_pa=yield_stress, consistency_pasn=consistency, flow_exponent=exponent
    )
    F = np.eye(3) + np.reshape(gradient, (3, 3))
    s = np.linalg.svd(F, compute_uv=False)
    if s[-1] < 0.2:
        return
    tau = points.step((F - np.eye(3)) / dt, dt=dt)
    reference = HerschelBulkley(
        COUNT, mu, points.lam, yield_stress=yield_stress, consistency=consistency, exponent=exponent
    )
    expected = reference.step(np.tile((F - np.eye(3)) / dt, (COUNT, 1, 1)), dt)
    np.testing.assert_allclose(tau, expected, atol=2e-5 * max(np.abs(expected).max(), 1e5))


# -------------------------------------------- known numbers; tables B10, B11 and B20 are in ``validation.yielding``


def mises_stress(tau):
    return np.sqrt(1.5) * deviator(tau)[1]


def test_hardening_slope_is_the_hardening_modulus():
    E, H = 1e6, 5e4
    points = Points(LawId.VON_MISES, E=E, yield_stress_pa=1e4, hardening_modulus_pa=H)
    found = []
    for _ in range(2):
        for _ in range(2000):
            tau = points.step(ISOCHORIC, dt=1e-5)
        found.append((FACTOR * points.state["flow"][0], mises_stress(tau)[0]))
    (a0, q0), (a1, q1) = found
    assert (q1 - q0) / (a1 - a0) == pytest.approx(H, rel=1e-3)
    assert q1 == pytest.approx(1e4 + H * a1, rel=1e-4)


def test_softened_to_nothing_is_broken():
    E = 1e6
    points = Points(LawId.VON_MISES, E=E, yield_stress_pa=1e4, hardening_modulus_pa=-2e5)
    for _ in range(4000):
        tau = points.step(ISOCHORIC, dt=3e-5)
    assert mises_stress(tau)[0] < 1  # no shear
    assert np.abs(points.step(np.eye(3) * 0.02)).max() < 1  # no tension
    assert np.abs(points.step(np.eye(3) * -0.015)).max() < 20  # the gap is not closed yet
    bulk = E / (3 * (1 - 0.6))
    tau = points.step(np.eye(3) * -0.01)
    beyond = 3 * np.log(1.02 * 0.985 * 0.99)
    assert tau[0, 0, 0] == pytest.approx(bulk * beyond, rel=0.02)


def test_cohesion_carries_tension_until_it_is_torn():
    points = Points(LawId.DRUCKER_PRAGER, friction_angle_deg=35, cohesion_pa=1000)
    limit = 1000 / np.tan(np.radians(35))
    peak = 0.0
    for _ in range(100):
        tau = points.step(np.eye(3), dt=2e-4)
        peak = max(peak, tau[0, 0, 0])
    assert 0.9 * limit < peak <= limit * (1 + 1e-4)
    assert (tau == 0).all()
    # pressed back to where it began the gap is closed, and it resists again from there
    for _ in range(100):
        tau = points.step(-np.eye(3), dt=2e-4)
    assert abs(tau[0, 0, 0]) < 0.1 * limit
    assert points.step(-np.eye(3), dt=0.01)[0, 0, 0] == pytest.approx(-1e5 / 1.2 * 0.03, rel=0.1)


@pytest.mark.parametrize("exponent", [0.3, 1.0, 1.8])
def test_steady_shear_of_a_herschel_bulkley_fluid(exponent):
    rate = 5.0
    points = Points(LawId.HERSCHEL_BULKLEY, yield_stress_pa=100, consistency_pasn=40, flow_exponent=exponent)
    for _ in range(2000):
        tau = points.step(SHEAR * rate, dt=1e-4)
    expected = np.sqrt(2) * (100 / np.sqrt(3) + 40 * rate**exponent)  # |dev tau| of the shear stress
    assert deviator(tau)[1][0] == pytest.approx(expected, rel=5e-3)
