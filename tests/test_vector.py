"""The lane type and its mathematics against float64 NumPy."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from numba import njit

from phys4dgen.vector import math as lane_math
from phys4dgen.vector.float_state import begin_flush_to_zero, restore_float_state
from phys4dgen.vector.lanes import (
    absolute,
    any_lane,
    as_float_bits,
    as_int_bits,
    constant16,
    floor,
    like,
    maximum,
    minimum,
    splat16,
    splat32,
    sqrt,
    to_float,
    to_int,
    where,
)
from phys4dgen.vector.matrix import (
    determinant,
    left_cauchy_green,
    polar_rotation,
    singular_value_decomposition,
    symmetric_eigen,
    symmetric_from_eigen,
)
from phys4dgen.vector.memory import load16, load32, load_columns32, store, store_columns
from phys4dgen.vector.shuffles import (
    group_last,
    group_sums,
    load_group_each,
    load_group_repeated,
    load_transposed16,
    load_transposed32,
    store_transposed,
)

ramp = constant16(range(16))


@pytest.fixture
def pairs():
    rng = np.random.default_rng(0)
    x = rng.normal(0, 3, 32).astype(np.float32)
    y = rng.normal(0, 3, 32).astype(np.float32)
    return x, y


@njit
def _arithmetic32(x, y, out):
    a, b = load32(x, 0), load32(y, 0)
    store(out, 0, a + b)
    store(out, 32, a - b)
    store(out, 64, a * b)
    store(out, 96, a / b)
    store(out, 128, -a)
    store(out, 160, np.float32(2) * a + 1)
    store(out, 192, minimum(a, b))
    store(out, 224, maximum(a, b))
    store(out, 256, sqrt(absolute(a)))
    store(out, 288, floor(a))
    store(out, 320, where((a > b) & (a > np.float32(0)), a, b))
    store(out, 352, where((a <= b) | (a >= np.float32(1)), a, like(b, np.float32(7))))
    store(out, 384, to_float(to_int(a)))
    store(out, 416, as_float_bits(as_int_bits(a)))
    store(out, 448, to_float(minimum(maximum(to_int(a), -1), 2)))
    store(out, 480, to_float((to_int(a) + 5) * 3 - 1))
    store(out, 512, splat32(np.float32(4.5)))


def test_lane_arithmetic_equals_numpy(pairs):
    x, y = pairs
    out = np.full(17 * 32, np.inf, np.float32)
    _arithmetic32(x, y, out)
    whole = x.astype(np.int32)
    expected = [
        x + y,
        x - y,
        x * y,
        x / y,
        -x,
        2 * x + 1,
        np.minimum(x, y),
        np.maximum(x, y),
        np.sqrt(np.abs(x)),
        np.floor(x),
        np.where((x > y) & (x > 0), x, y),
        np.where((x <= y) | (x >= 1), x, 7),
        whole,
        x,
        np.clip(whole, -1, 2),
        (whole + 5) * 3 - 1,
        np.full(32, 4.5),
    ]
    np.testing.assert_allclose(out.reshape(17, 32), np.array(expected), rtol=3e-7, atol=1e-7)


@njit
def _integers(x, out):
    a = load16(x, 0)
    store(out, 0, (a & 7) | 8)
    store(out, 16, a << 2)
    store(out, 32, a >> 1)


def test_integer_lanes():
    x = np.arange(-8, 8, dtype=np.int32)
    out = np.full(48, -99, np.int32)
    _integers(x, out)
    np.testing.assert_array_equal(out.reshape(3, 16), [(x & 7) | 8, x << 2, x >> 1])


@njit
def _any(x, limit):
    return any_lane(load32(x, 0) > limit)


def test_any_lane_sees_a_single_lane():
    x = np.zeros(32, np.float32)
    assert not _any(x, np.float32(0.5))
    x[31] = 1
    assert _any(x, np.float32(0.5))


@njit
def _groups(x, out):
    store(out, 0, load_group_repeated(x, 1))
    store(out, 16, load_group_each(x, 1))
    a = load16(x, 0)
    store(out, 32, group_last(a))
    store(out, 48, group_sums(a, a + 1, a * 2, splat16(np.float32(1))))
    store(out, 64, ramp())


def test_group_shuffles():
    x = np.random.default_rng(1).normal(size=20).astype(np.float32)
    out = np.full(80, np.inf, np.float32)
    _groups(x, out)
    rows = out.reshape(5, 16)
    np.testing.assert_array_equal(rows[0], np.tile(x[1:5], 4))
    np.testing.assert_array_equal(rows[1], np.repeat(x[1:5], 4))
    np.testing.assert_array_equal(rows[2], np.repeat(x[3:16:4], 4))
    first_three = x[:12].reshape(3, 4).sum(0)
    np.testing.assert_allclose(
        rows[3], np.concatenate([first_three, first_three + 3, 2 * first_three, [3] * 4]), rtol=1e-6
    )
    np.testing.assert_array_equal(rows[4], np.arange(16))


@njit
def _transpose16(x, columns, rows):
    lanes = load_transposed16(x, 0)
    store(columns, 0, lanes[0])
    store(columns, 16, lanes[5])
    store(columns, 32, lanes[15])
    store_transposed(rows, 0, lanes)


@njit
def _transpose32(x, columns, rows):
    lanes = load_transposed32(x, 0)
    store(columns, 0, lanes[0])
    store(columns, 32, lanes[5])
    store(columns, 64, lanes[15])
    store_transposed(rows, 0, lanes)


@pytest.mark.parametrize("count", [16, 32])
def test_transposition_and_back(count):
    x = np.random.default_rng(2).normal(size=(count, 16)).astype(np.float32)
    columns = np.full((3, count), np.inf, np.float32)
    rows = np.full((count, 16), np.inf, np.float32)
    (_transpose16 if count == 16 else _transpose32)(x.ravel(), columns.ravel(), rows.ravel())
    np.testing.assert_array_equal(columns, x.T[[0, 5, 15]])
    np.testing.assert_array_equal(rows, x)


@njit
def _log_exp(x, logs, exps):
    for i in range(0, x.size, 16):
        a = load16(x, i)
        store(logs, i, lane_math.log(absolute(a) + np.float32(1e-30)))
        store(exps, i, lane_math.exp(a))


def test_log_and_exp():
    x = np.concatenate([np.linspace(-60, 60, 2000), np.linspace(0.9, 1.1, 2000), 10.0 ** np.linspace(-20, 20, 96)])
    x = np.minimum(x, 79).astype(np.float32)[:4096]
    logs, exps = np.full_like(x, np.inf), np.full_like(x, np.inf)
    _log_exp(x, logs, exps)
    true_log = np.log(np.abs(x.astype(np.float64)) + 1e-30)
    np.testing.assert_allclose(logs, true_log, rtol=2.5e-7, atol=1e-9)
    np.testing.assert_allclose(exps, np.exp(x.astype(np.float64)), rtol=6e-7)


@njit
def _log1p_expm1(x, logs, exps):
    for i in range(0, x.size, 16):
        a = load16(x, i)
        store(logs, i, lane_math.log1p(maximum(a, like(a, np.float32(-0.999)))))
        store(exps, i, lane_math.expm1(a))


def test_log1p_and_expm1_keep_the_digits_of_small_numbers():
    small = 10.0 ** np.linspace(-12, -1, 500)
    x = np.concatenate([small, -small, np.linspace(-0.999, 3, 2000), np.linspace(-20, 40, 1096)]).astype(np.float32)
    logs, exps = np.full_like(x, np.inf), np.full_like(x, np.inf)
    _log1p_expm1(x, logs, exps)
    exact = x.astype(np.float64)
    np.testing.assert_allclose(logs, np.log1p(np.maximum(exact, float(np.float32(-0.999)))), rtol=6e-7)
    np.testing.assert_allclose(exps, np.expm1(exact), rtol=6e-7)


@njit
def _columns(x, out):
    a, b, c = load_columns32(x, 1, 40, 3)
    store_columns(out, 2, 50, (c, a + b))
    store_columns(out, 0, 50, load_columns32(x, 0, 40, 0))


def test_columns_of_lanes():
    x = np.random.default_rng(7).normal(size=120).astype(np.float32)
    out = np.full(100, np.inf, np.float32)
    _columns(x, out)
    a, b, c = x[1:33], x[41:73], x[81:113]
    np.testing.assert_array_equal(out[2:34], c)
    np.testing.assert_array_equal(out[52:84], a + b)
    assert np.isinf(out[[0, 1, 34, 51, 84, 99]]).all()


@njit
def _decompose(f, u, s, v, r, lam, q, b, det):
    rows = load_transposed32(f, 0)
    matrix = rows[:9]
    zero = like(rows[0], np.float32(0))
    pad = (zero, zero, zero, zero, zero, zero, zero)
    left, values, right = singular_value_decomposition(matrix)
    store_transposed(u, 0, left + pad)
    store_transposed(v, 0, right + pad)
    store_transposed(r, 0, polar_rotation(matrix) + pad)
    eigenvalues, vectors = symmetric_eigen(left_cauchy_green(matrix), 5)
    store_transposed(q, 0, vectors + pad)
    store_transposed(b, 0, (*symmetric_from_eigen(eigenvalues, vectors), zero, zero, zero, *pad))
    for k in range(3):
        store(s, 32 * k, values[k])
        store(lam, 32 * k, eigenvalues[k])
    store(det, 0, determinant(matrix))


def decompose(f):
    """Run every decomposition on 32 matrices [32, 3, 3]."""
    packed = np.zeros((32, 16), np.float32)
    packed[:, :9] = f.reshape(32, 9)
    u, v, r, q, b = (np.full((32, 16), np.inf, np.float32) for _ in range(5))
    s, lam, det = (
        np.full((3, 32), np.inf, np.float32),
        np.full((3, 32), np.inf, np.float32),
        np.full(32, np.inf, np.float32),
    )
    _decompose(packed.ravel(), u.ravel(), s.ravel(), v.ravel(), r.ravel(), lam.ravel(), q.ravel(), b.ravel(), det)
    square = [a[:, :9].reshape(32, 3, 3).astype(np.float64) for a in (u, v, r, q)]
    return *square, s.T, lam.T, b[:, :6], det, packed[:, :9].reshape(32, 3, 3).astype(np.float64)


def special_matrices():
    rng = np.random.default_rng(3)
    f = np.eye(3) + 0.4 * rng.normal(size=(32, 3, 3))
    f[0] = np.eye(3)
    f[1] = np.diag([1, 1, -0.7])
    f[2] = np.diag([2.0, 0.5, 0])
    f[3] = np.diag([0, 0, 1.5])
    f[4] = 0
    f[5] = -np.eye(3)
    f[6] = np.eye(3) + 1e-6 * rng.normal(size=(3, 3))
    f[7] = np.diag([1e-3, 2, 3.0])
    return f


def test_singular_value_decomposition_is_proper_for_every_matrix():
    u, v, _, _, s, _, _, det, f = decompose(special_matrices())
    eye = np.eye(3)
    assert np.abs(u @ u.transpose(0, 2, 1) - eye).max() < 3e-6
    assert np.abs(v @ v.transpose(0, 2, 1) - eye).max() < 3e-6
    assert np.all(np.linalg.det(u) > 0.99)
    assert np.all(np.linalg.det(v) > 0.99)
    np.testing.assert_allclose((u * s[:, None, :]) @ v.transpose(0, 2, 1), f, atol=5e-6)
    true = np.linalg.svd(f, compute_uv=False)
    true[:, 2] *= np.where(np.linalg.det(f) < 0, -1, 1)
    np.testing.assert_allclose(s, true, atol=2e-6)
    np.testing.assert_allclose(det, np.linalg.det(f), atol=2e-5, rtol=2e-6)


def test_polar_rotation_equals_lapack_where_it_is_defined():
    _, _, r, _, _, _, _, _, f = decompose(special_matrices())
    u, s, vt = np.linalg.svd(f)
    sign = np.where(np.linalg.det(u @ vt) < 0, -1.0, 1.0)
    u[:, :, 2] *= sign[:, None]
    defined = (s[:, 1] + sign * s[:, 2] > 0.05) & (np.linalg.det(f) != 0)
    assert defined.sum() > 20
    np.testing.assert_allclose(r[defined], (u @ vt)[defined], atol=2e-5)
    assert np.abs(r @ r.transpose(0, 2, 1) - np.eye(3)).max() < 5e-6


def test_symmetric_eigen_decomposition():
    _, _, _, q, _, eigenvalues, b, _, f = decompose(special_matrices())
    true_b = f @ f.transpose(0, 2, 1)
    scale = np.maximum(np.trace(true_b, axis1=1, axis2=2), 1e-12)
    np.testing.assert_allclose(np.sort(eigenvalues, 1), np.linalg.eigvalsh(true_b), atol=2e-6 * scale.max())
    assert np.abs(q @ q.transpose(0, 2, 1) - np.eye(3)).max() < 3e-6
    upper = true_b[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    assert (np.abs(b - upper).max(1) / scale).max() < 2e-6


@njit
def _half_of_the_smallest(x, flush):
    if flush:
        state = begin_flush_to_zero()
        y = x[0] * np.float32(0.5)
        restore_float_state(state)
        return y
    return x[0] * np.float32(0.5)


def test_flush_to_zero_is_restored():
    smallest = np.array([np.finfo(np.float32).tiny], np.float32)
    _half_of_the_smallest(smallest, True)
    assert _half_of_the_smallest(smallest, False) > 0
    assert smallest[0] * np.float32(0.5) > 0


@pytest.mark.skipif(os.environ.get("NUMBA_CPU_NAME") == "generic", reason="already the generic run")
def test_same_results_on_a_processor_without_vector_extensions():
    environment = dict(
        os.environ, NUMBA_CPU_NAME="generic", NUMBA_CPU_FEATURES="", NUMBA_DISABLE_PERFORMANCE_WARNINGS="1"
    )
    selected = "arithmetic or integer or any or group or transposition or log"
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", __file__, "-k", selected]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout[-2000:]
