"""The lane type and its mathematics against float64 NumPy."""

from __future__ import annotations

import os
import platform
import subprocess
import sys

import numpy as np
import pytest
from numba import njit

from phys4dgen.vector import math as lane_math
from phys4dgen.vector.batch import BATCH_LANES
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
    sqrt,
    to_float,
    to_int,
    where,
)
from phys4dgen.vector.matrix import (
    determinant,
    symmetric_eigen,
    symmetric_from_eigen,
)
from phys4dgen.vector.memory import load16, load_batch, load_columns, prefetch_columns, store, store_columns
from phys4dgen.vector.shuffles import (
    group_last,
    load_group_each,
    load_group_moments,
    load_group_repeated,
    load_transposed16,
    place_of_four,
    store_in_fours,
    store_transposed,
)

N = BATCH_LANES
ramp = constant16(range(16))


@pytest.fixture
def pairs():
    rng = np.random.default_rng(0)
    x = rng.normal(0, 3, N).astype(np.float32)
    y = rng.normal(0, 3, N).astype(np.float32)
    return x, y


@njit
def _arithmetic(x, y, out):
    a, b = load_batch(x, 0), load_batch(y, 0)
    store(out, 0, a + b)
    store(out, N, a - b)
    store(out, 2 * N, a * b)
    store(out, 3 * N, a / b)
    store(out, 4 * N, -a)
    store(out, 5 * N, np.float32(2) * a + 1)
    store(out, 6 * N, minimum(a, b))
    store(out, 7 * N, maximum(a, b))
    store(out, 8 * N, sqrt(absolute(a)))
    store(out, 9 * N, floor(a))
    store(out, 10 * N, where((a > b) & (a > np.float32(0)), a, b))
    store(out, 11 * N, where((a <= b) | (a >= np.float32(1)), a, like(b, np.float32(7))))
    store(out, 12 * N, to_float(to_int(a)))
    store(out, 13 * N, as_float_bits(as_int_bits(a)))
    store(out, 14 * N, to_float(minimum(maximum(to_int(a), -1), 2)))
    store(out, 15 * N, to_float((to_int(a) + 5) * 3 - 1))
    store(out, 16 * N, like(b, np.float32(4.5)))


def test_lane_arithmetic_equals_numpy(pairs):
    x, y = pairs
    out = np.full(17 * N, np.inf, np.float32)
    _arithmetic(x, y, out)
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
        np.full(N, 4.5),
    ]
    np.testing.assert_allclose(out.reshape(17, N), np.array(expected), rtol=3e-7, atol=1e-7)


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
    return any_lane(load_batch(x, 0) > limit)


def test_any_lane_sees_a_single_lane():
    x = np.zeros(N, np.float32)
    assert not _any(x, np.float32(0.5))
    x[N - 1] = 1
    assert _any(x, np.float32(0.5))


@njit
def _groups(x, out):
    store(out, 0, load_group_repeated(x, 1))
    store(out, 16, load_group_each(x, 1))
    a = load16(x, 0)
    store(out, 32, group_last(a))
    store(out, 48, ramp())


def test_group_shuffles():
    x = np.random.default_rng(1).normal(size=20).astype(np.float32)
    out = np.full(64, np.inf, np.float32)
    _groups(x, out)
    rows = out.reshape(4, 16)
    np.testing.assert_array_equal(rows[0], np.tile(x[1:5], 4))
    np.testing.assert_array_equal(rows[1], np.repeat(x[1:5], 4))
    np.testing.assert_array_equal(rows[2], np.repeat(x[3:16:4], 4))
    np.testing.assert_array_equal(rows[3], np.arange(16))


@njit
def _moments(rows, out):
    for k, column in enumerate(load_group_moments(rows, 16)):
        store(out, k * N, column)


def test_group_moments_are_those_of_the_first_three_groups():
    rows = np.random.default_rng(4).normal(size=(N + 1, 4, 4)).astype(np.float32)
    out = np.full((8, N), np.inf, np.float32)
    _moments(rows.ravel(), out.ravel())
    np.testing.assert_allclose(out[:4], rows[1:, :3].sum(1).T, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(out[4:], (rows[1:, 2] - rows[1:, 0]).T)


@njit
def _fours(columns, out, places):
    store_in_fours(out, 8, load_columns(columns, 0, N, 4))
    for lane in range(N):
        places[lane] = place_of_four(lane)


def test_fours_are_where_they_are_said_to_be():
    columns = np.random.default_rng(5).normal(size=(4, N)).astype(np.float32)
    out, places = np.full(4 * N + 16, np.inf, np.float32), np.zeros(N, np.int64)
    _fours(columns.ravel(), out, places)
    np.testing.assert_array_equal(np.sort(places), np.arange(0, 4 * N, 4))
    np.testing.assert_array_equal(out[8 + places[:, None] + np.arange(4)], columns.T)
    assert np.isinf(out[:8]).all()
    assert np.isinf(out[8 + 4 * N :]).all()


@njit
def _sum_of_columns(x, stride, ahead, out):
    for i in range(0, stride, N):
        prefetch_columns(x, i + ahead, stride, 3)
        a, b, c = load_columns(x, i, stride, 3)
        store(out, i, a + b + c)


@pytest.mark.parametrize("ahead", [0, 64, 2**40, -(2**40)])
def test_prefetching_changes_nothing_wherever_it_points(ahead):
    x = np.random.default_rng(3).normal(size=(3, 128)).astype(np.float32)
    out = np.full(128, np.inf, np.float32)
    _sum_of_columns(x.ravel(), 128, ahead, out)
    np.testing.assert_array_equal(out, x[0] + x[1] + x[2])


@njit
def _transpose16(x, columns, rows):
    lanes = load_transposed16(x, 0)
    store(columns, 0, lanes[0])
    store(columns, 16, lanes[5])
    store(columns, 32, lanes[15])
    store_transposed(rows, 0, lanes)


def test_transposition_and_back():
    x = np.random.default_rng(2).normal(size=(16, 16)).astype(np.float32)
    columns = np.full((3, 16), np.inf, np.float32)
    rows = np.full((16, 16), np.inf, np.float32)
    _transpose16(x.ravel(), columns.ravel(), rows.ravel())
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
    a, b, c = load_columns(x, 1, 40, 3)
    store_columns(out, 2, 50, (c, a + b))
    store_columns(out, 0, 50, load_columns(x, 0, 40, 0))


def test_columns_of_lanes():
    x = np.random.default_rng(7).normal(size=120).astype(np.float32)
    out = np.full(100, np.inf, np.float32)
    _columns(x, out)
    a, b, c = (x[start : start + N] for start in (1, 41, 81))
    np.testing.assert_array_equal(out[2 : 2 + N], c)
    np.testing.assert_array_equal(out[52 : 52 + N], a + b)
    assert np.isinf(out[[0, 1, 2 + N, 51, 52 + N, 99]]).all()


@njit
def _determinants(a, out):
    store(out, 0, determinant(load_columns(a, 0, N, 9)))


def test_determinant():
    a = np.random.default_rng(3).normal(size=(N, 3, 3)).astype(np.float32)
    out = np.full(N, np.inf, np.float32)
    _determinants(a.reshape(N, 9).T.ravel(), out)
    np.testing.assert_allclose(out, np.linalg.det(a.astype(np.float64)), rtol=2e-6, atol=2e-6)


@njit
def _decompose(a, vectors, values, again):
    a00, a01, a02, _, a11, a12, _, _, a22 = load_columns(a, 0, N, 9)
    found, axes = symmetric_eigen((a00, a01, a02, a11, a12, a22))
    store_columns(vectors, 0, N, axes)
    store_columns(again, 0, N, symmetric_from_eigen(found, axes))
    store_columns(values, 0, N, found)


def decompose(a):
    """Eigenvalues [N, 3], vectors [N, 3, 3] and U diag U^T of N symmetric matrices [N, 3, 3]."""
    values, vectors, again = (np.full((count, N), np.inf, np.float32) for count in (3, 9, 6))
    _decompose(a.reshape(N, 9).T.ravel(), vectors.ravel(), values.ravel(), again.ravel())
    again = again.T[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(N, 3, 3).astype(np.float64)
    return values.T.astype(np.float64), vectors.T.reshape(N, 3, 3).astype(np.float64), again


def rotated(values, rng):
    """Symmetric matrices with these eigenvalues [P, 3] along random axes, rounded to float32."""
    axes = np.linalg.qr(rng.normal(size=(len(values), 3, 3)))[0]
    a = (axes * values[:, None]) @ axes.transpose(0, 2, 1)
    return ((a + a.transpose(0, 2, 1)) / 2).astype(np.float32)


def symmetric_matrices(kind, rng):
    """N of a kind: what makes an eigen-decomposition hard."""
    ones = np.ones((N, 3))
    values = {
        "any": rng.normal(size=(N, 3)),
        "two alike": rng.normal(size=(N, 1)) + rng.normal(size=(N, 1)) * np.where(np.arange(3) == 2, 1.0, 0.0),
        "nearly alike": ones + 1e-6 * rng.normal(size=(N, 3)),
        "alike": 0.3 * ones,
        "two nearly alike": np.array([0.02, 0.02, -0.05]) + 1e-7 * rng.normal(size=(N, 3)),
        "yielding snow": np.clip(0.05 * rng.normal(size=(N, 3)), -0.049, 0.015),
        "evenly spaced": np.array([-1.0, 0.0, 1.0]) * rng.uniform(0.1, 1, (N, 1)),
        "squeezed and drawn": np.exp(rng.uniform(np.log(0.0025), np.log(400), (N, 3))) - 1,
        "small": 1e-7 * rng.normal(size=(N, 3)),
        "tiny": 1e-13 * rng.normal(size=(N, 3)),
        "nought": 0 * ones,
    }
    return rotated(values[kind], rng)


@pytest.mark.parametrize(
    "kind",
    [
        "any", "two alike", "nearly alike", "alike", "two nearly alike", "yielding snow", "evenly spaced",
        "squeezed and drawn", "small", "tiny", "nought",
    ],
)  # fmt: skip
@pytest.mark.parametrize("along_the_axes", [False, True])
def test_symmetric_eigen_decomposition(kind, along_the_axes):
    for seed in range(20):
        a = symmetric_matrices(kind, np.random.default_rng(seed))
        if along_the_axes:
            a = a * np.eye(3, dtype=np.float32)
        values, vectors, again = decompose(a)
        a = a.astype(np.float64)
        size = np.abs(a).max((1, 2), keepdims=True) + 1e-30
        assert np.abs(vectors.transpose(0, 2, 1) @ vectors - np.eye(3)).max() < 1.5e-6
        assert np.all(np.linalg.det(vectors) > 0.99)
        assert (np.abs(again - a) / size).max() < 2e-6
        assert (np.abs(np.sort(values, 1) - np.linalg.eigvalsh(a)) / size[:, 0]).max() < 2e-6


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


def other_processors():
    """Environments by name in which Numba compiles for a processor that is not this one."""
    plain = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": "", "NUMBA_DISABLE_PERFORMANCE_WARNINGS": "1"}
    other_width = {"NUMBA_CPU_NAME": "skylake-avx512" if N == 16 else "x86-64-v3"}
    is_x86 = pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="the other width is one of x86")
    return [pytest.param(plain, id="no vectors"), pytest.param(other_width, id="other width", marks=is_x86)]


@pytest.mark.skipif("NUMBA_CPU_NAME" in os.environ, reason="already a run for another processor")
@pytest.mark.parametrize("processor", other_processors())
def test_same_results_on_other_processors(processor):
    selected = "arithmetic or integer or any or group or fours or transposition or columns or log"
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", __file__, "-k", selected]
    environment = os.environ | processor
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout[-2000:]
