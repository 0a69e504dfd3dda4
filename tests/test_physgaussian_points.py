"""PhysGaussian's formulas at material points, against transcriptions of its published equations, point by point."""

import dataclasses
import math

import numpy as np
import pytest

from phys4dgen.physgaussian.configuration import MATERIALS, Configuration
from phys4dgen.physgaussian.material_point import Points, respond, stress_excess

DT_S = 1e-4


def trials(count=200, *, size=0.25, seed=0):
    rng = np.random.default_rng(seed)
    gradients = np.eye(3) + size * rng.uniform(-1, 1, (count, 3, 3))
    return gradients[np.linalg.det(gradients) > 0.2]


def configuration(material, **values):
    usual = {"E": 1e5, "nu": 0.3, "yield_stress": 3e3, "plastic_viscosity": 5.0, "softening": 50.0}
    return Configuration(material=material, **(usual | values))


def svd(gradient):
    u, s, vt = np.linalg.svd(gradient)
    return u, s, vt.T


def transcribed(config, trial, yield_pa):
    """(F, tau, Y) of one trial F, as the source computes them, factor by factor."""
    mu = config.E / (2 * (1 + config.nu))
    lam = config.E * config.nu / ((1 + config.nu) * (1 - 2 * config.nu))
    u, s, v = svd(trial)
    f = trial
    eps = np.log(np.maximum(s, 0.01))
    mean = eps.sum() / 3
    hat = eps - mean
    norm = math.sqrt((hat**2).sum())
    if config.material in ("metal", "plasticine") and yield_pa > 0:
        tau = 2 * mu * eps + lam * eps.sum()
        if np.linalg.norm(tau - tau.sum() / 3) > yield_pa:
            flow = norm - yield_pa / (2 * mu)
            eps = eps - flow / norm * hat
            f = u @ np.diag(np.exp(eps)) @ v.T
            if config.material == "plasticine":
                yield_pa -= config.softening * np.linalg.norm(flow / norm * hat)
                if yield_pa <= 0:
                    mu = lam = 0.0
            elif config.hardening == 1:
                yield_pa += 2 * mu * config.xi * flow
    if config.material == "foam":
        s_trial = 2 * mu * hat
        excess = np.linalg.norm(s_trial) - math.sqrt(2 / 3) * yield_pa
        if excess > 0:
            mu_hat = mu * (s**2).sum() / 3
            left = np.linalg.norm(s_trial) - excess / (1 + config.plastic_viscosity / (2 * mu_hat * DT_S))
            eps = left / np.linalg.norm(s_trial) * s_trial / (2 * mu) + mean
            f = u @ np.diag(np.exp(eps)) @ v.T
    if config.material == "sand":
        sine = math.sin(math.radians(config.friction_angle))
        alpha = math.sqrt(2 / 3) * 2 * sine / (3 - sine)
        flow = norm + (3 * lam + 2 * mu) / (2 * mu) * eps.sum() * alpha
        if flow > 0:
            f = u @ v.T if eps.sum() > 0 else u @ np.diag(np.exp(eps - flow / norm * hat)) @ v.T
    u, s, v = svd(f)
    volume = np.linalg.det(f)
    if config.material in ("jelly", "plasticine"):
        return f, 2 * mu * (f - u @ v.T) @ f.T + lam * volume * (volume - 1) * np.eye(3), yield_pa
    if config.material == "snow":
        return f, np.zeros((3, 3)), yield_pa
    eps = np.log(np.maximum(s, 0.01))
    if config.material == "sand":
        center = np.diag(2 * mu * eps / s + lam * eps.sum() / s)
        return f, u @ center @ v.T @ f.T, yield_pa
    tau = np.diag(2 * mu * eps + lam * eps.sum())
    return f, u @ tau @ v.T @ f.T, yield_pa


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("size", [0.02, 0.25])
def test_compat_reproduces_the_formulas(material, size):
    config = configuration(material, hardening=1, xi=0.3, friction_angle=30.0, yield_stress=6e4 * size)
    gradients = trials(size=size)
    f, tau, after = respond(Points.of(config, len(gradients)), gradients, dt_s=DT_S, mode="compat")
    scale = config.E
    changed = 0
    for index, trial in enumerate(gradients):
        expected_f, expected_tau, expected_yield = transcribed(config, trial, config.yield_stress)
        np.testing.assert_allclose(f[index], expected_f, atol=1e-9)
        np.testing.assert_allclose(tau[index], expected_tau, atol=1e-6 * scale * 1e-3)
        assert after.yield_stress_pa[index] == pytest.approx(expected_yield, rel=1e-9)
        changed += bool(np.abs(expected_f - trial).max() > 1e-6)
    if material in ("metal", "foam", "sand", "plasticine"):
        assert changed > 20


def test_many_substeps_with_state():
    config = configuration("plasticine", softening=4000.0, yield_stress=2e3)
    points = Points.of(config, 1)
    f, yield_pa, broken = np.eye(3), config.yield_stress, False
    step = np.array([[1.0, 0.02, 0], [0, 1.0, 0], [0, 0, 1.0]])
    expected = np.eye(3)
    for _ in range(60):
        got, tau, points = respond(points, (step @ f)[None], dt_s=DT_S, mode="compat")
        f = got[0]
        if broken:
            assert np.abs(tau).max() == 0
            continue
        expected, expected_tau, yield_pa = transcribed(config, step @ expected, yield_pa)
        broken = yield_pa <= 0
        np.testing.assert_allclose(f, expected, atol=1e-9)
        np.testing.assert_allclose(tau[0], expected_tau, atol=1e-4)
    assert broken
    assert points.mu_pa[0] == points.lam_pa[0] == 0


def energy(config, f):
    """Stored energy per rest volume of an elastic F."""
    mu = config.E / (2 * (1 + config.nu))
    lam = config.E * config.nu / ((1 + config.nu) * (1 - 2 * config.nu))
    s = np.linalg.svd(f, compute_uv=False)
    if config.material in ("jelly", "plasticine"):
        return mu * ((s - 1) ** 2).sum() + lam / 2 * (s.prod() - 1) ** 2
    eps = np.log(s)
    return mu * (eps**2).sum() + lam / 2 * eps.sum() ** 2


@pytest.mark.parametrize("material", ["jelly", "plasticine", "metal", "foam", "sand"])
def test_corrected_stress_is_the_derivative_of_an_energy_and_compat_is_not_for_two(material):
    config = configuration(material)
    points = dataclasses.replace(Points.of(config, 1), yield_stress_pa=np.full(1, np.inf))
    worst = {"corrected": 0.0, "compat": 0.0}
    for trial in trials(20, size=0.15):
        if material == "sand":
            trial = trial * 0.8  # under pressure, where sand is elastic
        elastic = respond(points, trial[None], dt_s=DT_S, mode="corrected")[0][0]
        first_piola = np.zeros((3, 3))
        for i in range(3):
            for j in range(3):
                bump = np.zeros((3, 3))
                bump[i, j] = 1e-6
                first_piola[i, j] = (energy(config, elastic + bump) - energy(config, elastic - bump)) / 2e-6
        expected = first_piola @ elastic.T
        for mode in worst:
            tau = respond(points, elastic[None], dt_s=DT_S, mode=mode)[1][0]
            off = np.linalg.norm(tau - expected) / np.linalg.norm(expected)
            worst[mode] = max(worst[mode], off)
    assert worst["corrected"] < 1e-6
    assert (worst["compat"] > 0.05) == (material in ("metal", "foam"))


def test_how_far_the_stress_is_off():
    assert stress_excess(configuration("metal"), 0.017) == pytest.approx(0.017, rel=0.1)
    assert stress_excess(configuration("foam"), 0.3) > 0.2
    assert stress_excess(configuration("jelly"), 0.3) == 0
