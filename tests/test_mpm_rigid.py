"""Rigid groups: shape, tumbling, a float64 twin, a weight on something soft; momenta are in ``test_validation.py``."""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np
import pytest
from scipy.spatial.distance import pdist

from mpm_bodies import body, lattice
from phys4dgen.mpm import Ground, LawId, Settings, Simulator, stiff_parts
from reference.mpm_reference import Reference

DX = 0.02


def rigid(b, where=True):
    return replace(b, rigid_group=np.where(np.broadcast_to(where, len(b)), 0, -1).astype(np.int32))


def half_rigid_bar():
    """A bar of 12 x 3 x 3 cells, its lower half in x rigid, thrown and spinning."""
    x = lattice((24, 6, 6), DX / 2)
    v = np.cross([2.0, -3.0, 8.0], x - x.mean(0)) + np.array([0.5, 0.2, 0.1])
    return rigid(body(x, (DX / 2) ** 3, E=2e5, law=LawId.FIXED_COROTATED, v=v), x[:, 0] < 12 * DX / 2)


def test_the_rigid_half_of_a_bar_keeps_its_shape_and_the_soft_half_does_not():
    b = half_rigid_bar()
    simulator = Simulator(b, Settings(DX, 0.02))
    last = [simulator.advance() for _ in range(15)][-1]
    is_rigid = b.rigid_group == 0
    before, after = pdist(b.positions_m[is_rigid][::5]), pdist(last.positions_m[is_rigid][::5])
    assert np.abs(after - before).max() < 1e-10
    F = last.deformation_gradients[is_rigid].astype(float)
    assert np.abs(F - F[0]).max() == 0
    np.testing.assert_allclose(F[0] @ F[0].T, np.eye(3), atol=3e-7)
    moved = last.positions_m[is_rigid] - last.positions_m[is_rigid].mean(0)
    rest = b.positions_m[is_rigid] - b.positions_m[is_rigid].mean(0)
    np.testing.assert_allclose(moved, rest @ F[0].T, atol=1e-7)
    soft = pdist(last.positions_m[~is_rigid][::5])
    assert np.abs(soft - pdist(b.positions_m[~is_rigid][::5])).max() > 1e-5


def test_a_tumbling_box_keeps_its_energy_and_angular_momentum():
    """About its middle axis the spin is unstable: the box flips, which a wrong gyroscopic term would not survive."""
    x = lattice((12, 8, 4), DX / 2)
    v = np.cross([0.02, 12.0, 0.05], x - x.mean(0))
    simulator = Simulator(rigid(body(x, (DX / 2) ** 3, E=2e11, v=v)), Settings(DX, 0.01))
    frames = [simulator.frame, *(simulator.advance() for _ in range(250))]
    upside_down = min(frame.deformation_gradients[0, 1, 1] for frame in frames)
    assert upside_down < -0.8
    energy = [frame.kinetic_energy_j for frame in frames]
    assert np.ptp(energy) < 2e-3 * energy[0]
    spin = frames[0].angular_momentum_kgm2s
    assert np.abs(frames[-1].angular_momentum_kgm2s - spin).max() < 1e-5 * np.linalg.norm(spin)
    assert frames[-1].elastic_energy_j == 0


def test_rigid_against_the_reference():
    """Hundred substeps of a bar that is half rigid, beside the projection written apart in float64."""
    b = half_rigid_bar()
    simulator = Simulator(b, Settings(DX, 0.04, gravity_ms2=(0, 0, -9.81), cfl=0.3))
    start = simulator.frame
    frame = simulator.advance()
    pad = 6
    truth = Reference(
        b.positions_m,
        start.velocities_ms,
        b.mass_kg,
        b.volume_m3,
        np.where(b.rigid_group == 0, 0, b.lame_mu_pa),
        np.where(b.rigid_group == 0, 0, b.lame_lambda_pa),
        b.law,
        dx=DX,
        origin=b.positions_m.min(0) - pad * DX,
        nodes=np.ceil(np.ptp(b.positions_m, axis=0) / DX).astype(int) + 2 * pad,
    )
    truth.make_rigid(b.rigid_group == 0)
    for _ in range(frame.substeps):
        truth.substep(frame.dt_s, (0, 0, -9.81))
    assert frame.substeps >= 90
    size = np.ptp(b.positions_m)
    assert np.abs(frame.positions_m - truth.x).max() < 2e-6 * size
    assert np.abs(frame.velocities_ms - truth.v).max() < 1e-5 * np.linalg.norm(truth.v, axis=1).max()
    assert np.abs(frame.deformation_gradients - truth.F).max() < 5e-6


def test_a_rigid_weight_presses_a_soft_column_as_theory_says():
    """Shortening of a column of height H under a rigid block of mass M: (M g H / A + rho g H^2 / 2) / E."""
    E, rho, g = 2e5, 1000.0, 9.81
    h = DX / 2
    foot, column, block = (lattice((8, 8, n), h, (0, 0, z)) for n, z in ((6, -6 * h), (24, 0), (6, 24 * h)))
    marker = np.array([[0.0, 0.0, -8.05 * DX]])  # puts a grid node just inside the clamp
    x = np.concatenate([foot, column, block, marker])
    kind = np.repeat([0, 1, 2, 0], [len(foot), len(column), len(block), 1])
    b = body(x, h**3, E=E, nu=0.0, rho=np.where(kind == 2, 4 * rho, rho), held=kind == 0)
    b = replace(b, rigid_group=np.where(kind == 2, 3, -1).astype(np.int32))
    H, area = 24 * h, (8 * h) ** 2
    M = b.mass_kg[kind == 2].sum()
    simulator = Simulator(b, Settings(DX, 0.2, gravity_ms2=(0, 0, -g), damping_per_s=60.0))
    for _ in range(8):
        frame = simulator.advance()
    assert frame.max_speed_ms < 1e-3
    sunk = (x - frame.positions_m)[kind == 2, 2].mean()
    assert sunk == pytest.approx((M * g * H / area + rho * g * H**2 / 2) / E, rel=0.08)
    later = simulator.advance()
    assert np.abs(later.positions_m - frame.positions_m).max() < 1e-3 * sunk  # it does not creep on


def test_rigid_parts_set_no_time_step_but_their_speed_does():
    x = lattice((6, 6, 6), DX / 2)
    steel = rigid(body(x, (DX / 2) ** 3, E=2e11, v=np.tile([3.0, 0, 0], (len(x), 1))))
    assert stiff_parts(steel, Settings(DX, 1 / 24)) == []
    assert Simulator(steel, Settings(DX, 1 / 24)).estimate().substeps_per_frame == np.ceil(3 / 24 / (0.4 * DX))
    assert Simulator(replace(steel, velocities_ms=None), Settings(DX, 1 / 24)).estimate().substeps_per_frame == 2


def test_two_groups_move_apart():
    cube = lattice((6, 6, 6), DX / 2)
    x = np.concatenate([cube, cube + np.array([0.2, 0, 0])])
    v = np.repeat([[0.0, 0.3, 0.0], [0.5, 0.0, 0.1]], len(cube), axis=0)
    b = replace(body(x, (DX / 2) ** 3, v=v), rigid_group=np.repeat([7, 3], len(cube)).astype(np.int32))
    frame = Simulator(b, Settings(DX, 0.1)).advance()
    np.testing.assert_allclose(frame.positions_m, x + 0.1 * v, atol=1e-6)


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="needs two threads")
def test_one_and_two_threads_give_the_same_bits():
    before = numba.get_num_threads()
    results = []
    try:
        for threads in (1, 2):
            numba.set_num_threads(threads)
            b = half_rigid_bar()
            settings = Settings(DX, 0.02, gravity_ms2=(0, 0, -9.81), ground=Ground(-0.01), chunks=3)
            simulator = Simulator(b, settings)
            results.append([simulator.advance() for _ in range(4)][-1])
    finally:
        numba.set_num_threads(before)
    np.testing.assert_array_equal(results[0].positions_m, results[1].positions_m)
    np.testing.assert_array_equal(results[0].deformation_gradients, results[1].deformation_gradients)
