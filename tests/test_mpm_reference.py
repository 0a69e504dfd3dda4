"""The float32 engine against the float64 reference, substep for substep."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mpm_bodies import body, lattice
from phys4dgen.mpm import Acceleration, LawId, Settings, Simulator
from reference.mpm_reference import Reference, kirchhoff_stress, stored_energy

DX = 0.02


def mixed_cube(seed=0):
    """A cube of 8 dx with random particles, laws and materials, that shears, spins and is thrown."""
    rng = np.random.default_rng(seed)
    side = 8 * DX
    x = rng.random((2500, 3)) * side
    r = x - side / 2
    v = np.stack([-9 * r[:, 1] + 14 * r[:, 2], 9 * r[:, 0], 0 * r[:, 0]], 1) + np.array([0.4, 0, 0.2])
    p = len(x)
    return body(
        x,
        side**3 / p * rng.uniform(0.7, 1.3, p),
        E=10 ** rng.uniform(4, 5.3, p),
        rho=rng.uniform(500, 1500, p),
        nu=rng.uniform(0.1, 0.4, p),
        law=rng.integers(0, 2, p),
        part=rng.integers(0, 2, p),
        v=v,
    )


def reference_of(b, pad=6):
    nodes = np.ceil(np.ptp(b.positions_m, axis=0) / DX).astype(int) + 2 * pad
    origin = b.positions_m.min(0) - pad * DX
    free = ~b.held
    return Reference(
        b.positions_m[free],
        b.velocities_ms[free],
        b.mass_kg[free],
        b.volume_m3[free],
        b.lame_mu_pa[free],
        b.lame_lambda_pa[free],
        b.law[free],
        dx=DX,
        origin=origin,
        nodes=nodes,
    )


@pytest.fixture(scope="module")
def hundred_substeps():
    b = mixed_cube()
    gust = Acceleration((3.0, -1.0, 0.5), to_s=0.0151, part=1)
    settings = dict(gravity_ms2=(0, 0, -9.81), loads=(gust,), damping_per_s=1.5, cfl=0.3)
    frame = Simulator(b, Settings(DX, 0.0231, **settings)).advance()
    dt = frame.dt_s
    truth = reference_of(b)
    for n in range(frame.substeps):
        seconds = np.diff(np.clip(dt * np.array([n, n + 1]), 0, gust.to_s))[0]
        kick = np.where((b.part == 1)[:, None], seconds * np.array(gust.value_ms2), 0)
        truth.substep(dt, (0, 0, -9.81), kick, np.exp(-1.5 * dt))
    return frame, truth, b


def test_hundred_substeps_of_mixed_laws(hundred_substeps):
    frame, truth, b = hundred_substeps
    assert 100 <= frame.substeps <= 120
    size = np.ptp(b.positions_m)
    speed = np.linalg.norm(truth.v, axis=1).max()
    assert np.abs(truth.F - np.eye(3)).max() > 0.1  # it does deform
    assert np.abs(frame.positions_m - truth.x).max() < 2e-6 * size
    assert np.abs(frame.velocities_ms - truth.v).max() < 1e-5 * speed
    assert np.abs(frame.deformation_gradients - truth.F).max() < 5e-6


def test_energies_of_the_frame(hundred_substeps):
    frame, truth, b = hundred_substeps
    stored = b.volume_m3 @ stored_energy(truth.F, b.lame_mu_pa, b.lame_lambda_pa, b.law)
    kinetic = b.mass_kg @ ((truth.v**2).sum(1) / 2 + DX**2 / 8 * (truth.C**2).sum((1, 2)))
    assert frame.elastic_energy_j == pytest.approx(stored, rel=1e-4)
    assert frame.kinetic_energy_j == pytest.approx(kinetic, rel=1e-5)


@pytest.mark.parametrize("law", [LawId.NEO_HOOKEAN, LawId.FIXED_COROTATED])
def test_reference_stress_is_the_derivative_of_the_energy(law):
    rng = np.random.default_rng(1)
    F = np.eye(3) + 0.3 * rng.uniform(-1, 1, (50, 3, 3))
    mu, lam, laws = rng.uniform(1, 2, 50), rng.uniform(1, 3, 50), np.full(50, law)
    tau = kirchhoff_stress(F, mu, lam, laws)
    step = 1e-6
    for i in range(3):
        for j in range(3):
            nudge = np.zeros((3, 3))
            nudge[i, j] = step
            up = stored_energy((np.eye(3) + nudge) @ F, mu, lam, laws)
            down = stored_energy((np.eye(3) - nudge) @ F, mu, lam, laws)
            np.testing.assert_allclose(tau[:, i, j], (up - down) / (2 * step), rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("law", [LawId.NEO_HOOKEAN, LawId.FIXED_COROTATED])
def test_reference_stress_turns_with_the_body(law):
    rng = np.random.default_rng(2)
    F = np.eye(3) + 0.3 * rng.uniform(-1, 1, (20, 3, 3))
    mu, lam, laws = np.full(20, 2.0), np.full(20, 3.0), np.full(20, law)
    Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    Q *= np.sign(np.linalg.det(Q))
    turned = kirchhoff_stress(Q @ F, mu, lam, laws)
    np.testing.assert_allclose(turned, Q @ kirchhoff_stress(F, mu, lam, laws) @ Q.T, atol=1e-12)


def test_held_nodes_and_damping_against_the_reference():
    x = lattice((14, 6, 6), DX / 2)
    held = x[:, 0] < 4 * DX / 2
    b = body(x, (DX / 2) ** 3, E=2e4, rho=800.0, nu=0.2, held=held, law=LawId.FIXED_COROTATED)
    settings = Settings(DX, 0.02, gravity_ms2=(0, 0, -9.81), damping_per_s=4.0)
    simulator = Simulator(b, settings)
    frame = simulator.advance()
    truth = reference_of(b)
    # the rules, written anew: held where more than half of the mass around the node is held; held particles that touch
    # a node that is not are simulated beside the moving ones
    mass = {True: np.zeros(truth.nodes), False: np.zeros(truth.nodes)}
    for is_held in (True, False):
        truth.x = b.positions_m[held == is_held]
        for node, w, _ in truth._stencil():
            np.add.at(mass[is_held].reshape(-1), node, w)
    held_nodes = mass[True] > mass[False]
    truth.x = b.positions_m[held]
    touches_free = np.zeros(held.sum(), bool)
    for node, w, _ in truth._stencil():
        touches_free |= (w > 0) & ~held_nodes.reshape(-1)[node]
    skin = np.flatnonzero(held)[touches_free]
    assert 0 < len(skin) < held.sum()
    still = held.copy()
    still[skin] = False
    truth = reference_of(replace(b, held=still))
    truth.held_nodes = held_nodes
    for _ in range(frame.substeps):
        truth.substep(frame.dt_s, (0, 0, -9.81), keep=np.exp(-4 * frame.dt_s))
    moving = ~held[~still]  # of what the reference simulates
    assert np.abs(truth.x[moving] - b.positions_m[~held]).max() > 1e-4
    np.testing.assert_allclose(frame.positions_m[~held], truth.x[moving], atol=2e-6 * np.ptp(x))
    np.testing.assert_allclose(frame.deformation_gradients[~held], truth.F[moving], atol=5e-6)
    np.testing.assert_array_equal(frame.positions_m[held], x[held])
    np.testing.assert_array_equal(frame.deformation_gradients[held], np.tile(np.eye(3), (held.sum(), 1, 1)))
