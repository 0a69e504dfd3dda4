"""Each law's float32 vector function and its NumPy energy against the float64 reference."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from phys4dgen.mpm.laws import FIXED_COROTATED, LAWS, NEO_HOOKEAN, LawId
from phys4dgen.mpm.laws.law import respond
from phys4dgen.vector.lanes import like
from phys4dgen.vector.shuffles import load_transposed32, store_transposed
from reference.mpm_reference import kirchhoff_stress, stored_energy


@njit
def _at_32_points(law, rows, result):
    lanes = load_transposed32(rows, 0)
    h, tau = respond(law, lanes[:9], lanes[9], lanes[10])
    zero = like(lanes[0], np.float32(0))
    store_transposed(result, 0, (*tau, *h, zero))


def response(law, F, mu, lam):
    """tau [32, 3, 3] and F [32, 3, 3] from the vector function."""
    rows = np.zeros((32, 16), np.float32)
    rows[:, :9], rows[:, 9], rows[:, 10] = (F - np.eye(3)).reshape(32, 9), mu, lam
    result = np.full((32, 16), np.inf, np.float32)
    _at_32_points(law, rows.ravel(), result.ravel())
    return result[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(32, 3, 3), result[:, 6:15].reshape(32, 3, 3) + np.eye(3)


@pytest.fixture
def points():
    rng = np.random.default_rng(4)
    F = (np.eye(3) + 0.35 * rng.uniform(-1, 1, (32, 3, 3))).astype(np.float32)
    F[0] = np.eye(3)
    F[1:4] = np.eye(3) + 1e-4 * rng.normal(size=(3, 3, 3))
    F[4] = np.diag([0.4, 1.5, 1.2])
    return F, rng.uniform(1, 2, 32).astype(np.float32), rng.uniform(1, 3, 32).astype(np.float32)


@pytest.mark.parametrize("law", [NEO_HOOKEAN, FIXED_COROTATED], ids=lambda law: law.law_id.name)
def test_vector_stress_equals_the_reference(law, points):
    F, mu, lam = points
    tau, F_after = response(law, F, mu, lam)
    F64, laws = F.astype(float), np.full(32, law.law_id)
    np.testing.assert_allclose(tau, kirchhoff_stress(F64, mu.astype(float), lam.astype(float), laws), atol=1e-5)
    np.testing.assert_allclose(F_after, F, atol=1e-7)
    assert np.abs(tau[0]).max() < 1e-6  # no stress at rest


@pytest.mark.parametrize("law", [NEO_HOOKEAN, FIXED_COROTATED], ids=lambda law: law.law_id.name)
def test_energy_density_equals_the_reference(law, points):
    F, mu, lam = (a.astype(float) for a in points)
    laws = np.full(32, law.law_id)
    np.testing.assert_allclose(law.energy_density_pa(F, mu, lam), stored_energy(F, mu, lam, laws), atol=1e-12)


@pytest.mark.parametrize("law", [NEO_HOOKEAN, FIXED_COROTATED], ids=lambda law: law.law_id.name)
def test_vector_stress_turns_with_the_body(law, points):
    F, mu, lam = points
    Q, _ = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))
    Q *= np.sign(np.linalg.det(Q))
    tau, _ = response(law, F, mu, lam)
    turned, _ = response(law, (Q @ F.astype(float)).astype(np.float32), mu, lam)
    np.testing.assert_allclose(turned, Q @ tau @ Q.T, atol=2e-5)


def test_a_particle_turned_inside_out_gives_finite_stress():
    F = np.tile(np.diag([1, 1, -0.5]), (32, 1, 1))
    F[1:] = 0
    for law in LAWS.values():
        assert np.isfinite(response(law, F, np.ones(32), np.ones(32))[0]).all()


def test_every_law_id_has_a_law():
    assert set(LAWS) == set(LawId)
