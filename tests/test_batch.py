"""Lanes of a batch: how many a processor gets, and that the simulation does not depend on it."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from phys4dgen.mpm import Body, LawId, Settings, Simulator
from phys4dgen.vector.batch import BATCH_LANES, batch_lanes_of


@pytest.mark.parametrize(
    ("processor", "lanes"),
    [
        ("skylake", 16),
        ("skylake-avx512", 32),
        ("icelake-server", 32),
        ("sapphirerapids", 32),
        ("arrowlake", 16),
        ("znver3", 16),
        ("znver4", 16),
        ("generic", 16),
        ("apple-m1", 16),
        ("", 16),
    ],
)
def test_only_processors_that_compute_16_at_once_get_32_lanes(processor, lanes):
    assert batch_lanes_of(processor) == lanes


def dropped_cube():
    """Positions [P, 3] and deformation gradients of a cube of two laws that fell and was sheared, after two frames."""
    count = 3001
    one = np.ones(count)
    rng = np.random.default_rng(0)
    law = np.where(np.arange(count) % 3 > 0, LawId.FIXED_COROTATED, LawId.VON_MISES).astype(np.int32)
    part, held = np.zeros(count, np.int32), np.zeros(count, bool)
    body = Body(
        0.3 + rng.random((count, 3)) / 10, 1e-3 / count * one, 1e3 * one, 1e5 * one, 0.3 * one, law, part, held,
        ("cube",), rng.normal(size=(count, 3)) / 10, law_numbers={"yield_stress_pa": 2e3 * one},
    )  # fmt: skip
    simulator = Simulator(body, Settings(0.01, 0.01, gravity_ms2=(0, 0, -9.8), chunks=2))
    simulator.advance()
    frame = simulator.advance()
    return np.concatenate([frame.positions_m, frame.deformation_gradients.reshape(count, 9)], 1)


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="the other processor is one of x86")
def test_a_simulation_is_the_same_in_batches_of_another_width(tmp_path):
    other = "skylake-avx512" if BATCH_LANES == 16 else "x86-64-v3"
    assert batch_lanes_of(other) != BATCH_LANES
    environment = dict(os.environ, NUMBA_CPU_NAME=other, PYTHONPATH=str(Path(__file__).parent))
    path = tmp_path / "cube.npy"
    code = f"import numpy, test_batch; numpy.save({str(path)!r}, test_batch.dropped_cube())"
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stderr
    np.testing.assert_allclose(np.load(path), dropped_cube(), rtol=0, atol=2e-6)
