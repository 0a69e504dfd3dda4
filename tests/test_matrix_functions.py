"""Functions of small symmetric matrices in lanes against float64 eigen-decompositions, and closed-form eigenvalues."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from phys4dgen.mpm.laws.elastic_strain import principal_values
from phys4dgen.vector.batch import BATCH_LANES
from phys4dgen.vector.matrix_functions import (
    expm1_near_zero,
    half_log1p_near_zero,
    powers,
    root1p_near_zero,
    squared_norm,
)
from phys4dgen.vector.memory import load_columns, store, store_columns

UPPER = [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]
FLOAT64 = {"root": lambda x: np.expm1(np.log1p(x) / 2), "log": lambda x: np.log1p(x) / 2, "exp": np.expm1}
LARGEST = {"root": 0.4, "log": 0.4, "exp": 0.5}


@njit
def _apply(columns, root, logarithm, exponential, squares, norm):
    a = load_columns(columns, 0, BATCH_LANES, 6)
    squared, invariants = powers(a)
    store_columns(root, 0, BATCH_LANES, root1p_near_zero(a, squared, invariants))
    store_columns(logarithm, 0, BATCH_LANES, half_log1p_near_zero(a, squared, invariants))
    store_columns(exponential, 0, BATCH_LANES, expm1_near_zero(a))
    store_columns(squares, 0, BATCH_LANES, squared)
    store(norm, 0, squared_norm(a))


def applied(a):
    """Results [lanes, 6] by name, the squares and the squared norm of symmetric matrices [lanes, 3, 3]."""
    columns = np.ascontiguousarray(a[:, *UPPER].T, np.float32)
    root, logarithm, exponential, squares = np.full((4, 6, BATCH_LANES), np.inf, np.float32)
    norm = np.full(BATCH_LANES, np.inf, np.float32)
    _apply(columns.ravel(), root.ravel(), logarithm.ravel(), exponential.ravel(), squares.ravel(), norm)
    return {"root": root.T, "log": logarithm.T, "exp": exponential.T}, squares.T, norm


def symmetric(sizes, seed=0):
    """Random symmetric matrices of these Frobenius norms, as float32 holds them."""
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(len(sizes), 3, 3))
    a = a + a.transpose(0, 2, 1)
    a[: len(a) // 4] = np.diag([-1.0, 0, 0])  # the hardest: one stretch, compressed
    a[len(a) // 4 : len(a) // 3] = np.eye(3)
    a *= np.reshape(sizes, (-1, 1, 1)) / np.linalg.norm(a, axis=(1, 2), keepdims=True)
    return a.astype(np.float32).astype(float)


@pytest.mark.parametrize("name", list(FLOAT64))
def test_functions_equal_those_of_eigenvalues_at_every_size(name):
    a = symmetric(np.geomspace(1e-8, LARGEST[name], BATCH_LANES)[::-1])
    values, vectors = np.linalg.eigh(a)
    expected = ((vectors * FLOAT64[name](values)[:, None, :]) @ vectors.transpose(0, 2, 1))[:, *UPPER]
    found = applied(a)[0][name]
    error = np.abs(found - expected).max(1) / np.abs(expected).max(1)
    assert error.max() < 1e-6


def test_squares_and_norms():
    a = symmetric(np.full(BATCH_LANES, 0.3), seed=1)
    _, squares, norm = applied(a)
    np.testing.assert_allclose(squares, (a @ a)[:, *UPPER], atol=1e-8)
    np.testing.assert_allclose(norm, 0.09, rtol=1e-6)


@given(st.integers(0, 2**32 - 1), st.floats(-12, 4), st.sampled_from(["any", "two alike", "all alike"]))
def test_closed_form_eigenvalues_equal_lapack(seed, decades, kind):
    rng = np.random.default_rng(seed)
    axes, _ = np.linalg.qr(rng.normal(size=(20, 3, 3)))
    values = rng.normal(size=(20, 3))
    if kind != "any":
        values[:, 1] = values[:, 0]
    if kind == "all alike":
        values[:, 2] = values[:, 0]
    a = 10.0**decades * (axes * values[:, None, :]) @ axes.transpose(0, 2, 1)
    a = (a + a.transpose(0, 2, 1)) / 2
    found = principal_values(a[:, *UPPER].T)
    expected = np.linalg.eigvalsh(a)[:, ::-1]
    scale = np.linalg.norm(a, axis=(1, 2))[:, None]
    assert (np.abs(found - expected) <= 5e-8 * scale).all()
    # what is off in one is off in the other as well: a smooth function of all three is exact
    np.testing.assert_allclose((found**2).sum(1), (expected**2).sum(1), rtol=1e-13)
