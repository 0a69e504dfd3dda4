"""A body in equilibrium with its weight in the shape that it has: its stress is theory's, and it stays still."""

from dataclasses import replace

import numba
import numpy as np
import pytest

from mpm_bodies import body, lattice
from phys4dgen.mpm import Drive, LawId, Settings, Simulator, prestress, since_start, stiffened
from phys4dgen.mpm.laws import LAWS

DX, G = 0.02, 9.81
STEP = DX / 2
WEIGHT = (0.0, 0.0, -G)
SETTINGS = Settings(DX, 0.05, gravity_ms2=WEIGHT, cfl=0.6, damping_per_s=1.0)
RHO = 1000.0


def column(*, E=2e5, nu=0.0, law=LawId.NEO_HOOKEAN, hangs=False):
    """A bar of 4 x 4 x 20 particles, 0.2 m long, held over two cells at its lower or upper end."""
    x = lattice((4, 4, 24), STEP)
    held = x[:, 2] > 0.2 if hangs else x[:, 2] < 0.04
    return body(x, STEP**3, E=E, nu=nu, rho=RHO, law=law, held=held)


def beam(E=1.5e6):
    """A horizontal beam, 0.04 m thick and 0.24 m long, clamped at one end."""
    x = lattice((28, 4, 4), STEP)
    return body(x, STEP**3, E=E, nu=0.0, rho=RHO, held=x[:, 0] < 0.04)


def found(b, settings=SETTINGS, **options):
    result = prestress(b, settings, gravity_ms2=WEIGHT, **{"tolerance_m": 1e-6, **options})
    assert result is not None
    return result, replace(b, initial_gradients=result.deformation_gradients)


def farthest_m(b, settings, frames):
    simulator = Simulator(b, settings)
    return max(np.abs(simulator.advance().positions_m - b.positions_m).max() for _ in range(frames))


@pytest.mark.parametrize("hangs", [False, True])
def test_stress_of_a_bar_is_the_weight_beyond(hangs):
    b = column(hangs=hangs)
    result, _ = found(b)
    assert result.converged
    z = b.positions_m[:, 2]
    inner = result.carried & (z > 0.07) & (z < 0.17)
    beyond = z.max() + STEP / 2 - z if not hangs else -(z - z.min() + STEP / 2)
    stress = 2e5 * result.strains[:, 2, 2]
    layers = np.unique(z[inner])
    expected = np.array([-RHO * G * beyond[inner & (z == layer)].mean() for layer in layers])
    mean = np.array([stress[inner & (z == layer)].mean() for layer in layers])
    np.testing.assert_allclose(mean, expected, rtol=0.05)


@pytest.mark.parametrize("law", ["neo_hookean", "fixed_corotated", "stvk_hencky", "von_mises", "viscoplastic"])
def test_a_soft_column_keeps_still_whatever_its_law(law):
    numbers = {"yield_stress_pa": 1e5, "viscosity_pas": 10.0}
    b = column(E=4e4, nu=0.3)
    b = replace(
        b,
        law=np.full(len(b), LawId[law.upper()], np.int32),
        law_numbers={name: np.full(len(b), value) for name, value in numbers.items()},
    )
    result, strained = found(b)
    assert 0.03 < result.largest_strain < 0.1
    assert farthest_m(strained, SETTINGS, 8) < 2e-4 * 0.2
    assert farthest_m(b, SETTINGS, 8) > 20e-4


def test_a_beam_keeps_still_and_would_sag_as_theory_says():
    b = beam()
    result, strained = found(b)
    length_m, thickness_m = 0.255, 0.04  # from the last held node
    second_moment = thickness_m**4 / 12
    sag_m = RHO * G * thickness_m**2 * length_m**4 / (8 * 1.5e6 * second_moment)
    assert result.sag_m == pytest.approx(sag_m, rel=0.12)
    assert farthest_m(strained, SETTINGS, 20) < 1e-4 * length_m
    assert farthest_m(b, replace(SETTINGS, damping_per_s=0.0), 10) == pytest.approx(2 * result.sag_m, rel=0.05)


def test_weight_does_not_rest_on_what_only_comes_close():
    b = beam()
    n = len(b)
    block = lattice((8, 4, 4), STEP) + np.array([0.28 + 1.5 * DX, 0, 0])
    held = np.concatenate([b.held, block[:, 0] > block[:, 0].mean()])
    both = body(np.concatenate([b.positions_m, block]), STEP**3, E=1.5e6, nu=0.0, rho=RHO, held=held)
    alone, beside = found(b)[0], found(both)[0]
    worst = np.abs(alone.strains).max()
    np.testing.assert_allclose(beside.strains[:n], alone.strains, atol=0.01 * worst)
    assert farthest_m(replace(both, initial_gradients=beside.deformation_gradients), SETTINGS, 4) < 1e-4


def test_a_crumb_beside_a_beam_rests_on_it():
    b = beam()
    crumb = lattice((2, 2, 2), STEP) + np.array([0.28 + 0.8 * DX, 0.01, 0.01])
    held = np.concatenate([b.held, np.zeros(len(crumb), bool)])
    both = body(np.concatenate([b.positions_m, crumb]), STEP**3, E=1.5e6, nu=0.0, rho=RHO, held=held)
    result, strained = found(both)
    assert result.carried[len(b) :].all()
    assert result.sag_m > found(b)[0].sag_m
    assert farthest_m(strained, SETTINGS, 4) < 2e-4


def test_a_stiffer_body_has_the_same_stress():
    soft, stiff = found(beam())[0], found(beam(E=4.5e6))[0]
    again = stiffened(soft, 3.0)
    assert again.sag_m == pytest.approx(stiff.sag_m, rel=1e-3)
    assert again.largest_strain == pytest.approx(stiff.largest_strain, rel=1e-3)
    np.testing.assert_allclose(
        again.deformation_gradients, stiff.deformation_gradients, atol=1e-3 * stiff.largest_strain
    )


def test_a_pin_carries_as_well():
    b = column(hangs=True)
    pin = Drive(chosen=b.held)
    free = replace(b, held=np.zeros(len(b), bool))
    settings = replace(SETTINGS, drives=(pin,))
    result, strained = found(free, settings)
    assert result.carried.sum() == len(b)
    assert farthest_m(strained, settings, 8) < 1e-4
    assert farthest_m(free, settings, 8) > 5e-4


def test_what_hangs_on_nothing_has_none():
    b = column()
    assert prestress(replace(b, held=np.zeros(len(b), bool)), SETTINGS, gravity_ms2=WEIGHT, tolerance_m=1e-6) is None
    fluid = replace(b, law=np.full(len(b), LawId.FLUID, np.int32), law_numbers={"viscosity_pas": np.ones(len(b))})
    assert prestress(fluid, SETTINGS, gravity_ms2=WEIGHT, tolerance_m=1e-6) is None
    crumb = b.positions_m + np.array([0.3, 0, 0])
    both = body(np.concatenate([b.positions_m, crumb]), STEP**3, E=2e5, held=np.concatenate([b.held, b.held & False]))
    result, _ = found(both)
    assert not result.carried[len(b) :].any() and result.carried[: len(b)][~b.held].all()
    np.testing.assert_array_equal(result.deformation_gradients[len(b) :], np.tile(np.eye(3), (len(b), 1, 1)))
    assert result.hanging_share > 0.4


def test_one_and_two_threads_give_the_same_bits():
    most = numba.get_num_threads()
    results = []
    for threads in (1, min(2, most)):
        numba.set_num_threads(threads)
        results.append(found(beam(), tolerance_m=1e-4)[0].deformation_gradients)
    numba.set_num_threads(most)
    np.testing.assert_array_equal(*results)


def test_a_prestressed_simulation_goes_on_from_a_checkpoint():
    _, strained = found(beam(), tolerance_m=1e-4)
    settings = replace(SETTINGS, gravity_ms2=(2.0, 0.0, -G))
    simulator = Simulator(strained, settings)
    simulator.advance()
    saved = simulator.checkpoint()
    expected = simulator.advance()
    other = Simulator(strained, settings)
    other.restore(saved)
    again = other.advance()
    np.testing.assert_array_equal(again.positions_m, expected.positions_m)
    np.testing.assert_array_equal(again.deformation_gradients, expected.deformation_gradients)


def test_the_deformation_since_the_start_begins_with_the_identity():
    _, strained = found(beam(), tolerance_m=1e-4)
    simulator = Simulator(strained, SETTINGS)
    total = simulator.frame.deformation_gradients
    assert np.abs(total - np.eye(3)).max() > 1e-3
    np.testing.assert_allclose(since_start(total, strained), np.tile(np.eye(3), (len(strained), 1, 1)), atol=2e-7)


@pytest.mark.parametrize("law", [law for law in LAWS.values() if law.stretches is not None], ids=lambda law: law.name)
@pytest.mark.parametrize("nu", [0.0, 0.3, 0.45])
def test_stretches_have_the_stress_that_they_are_asked_for(law, nu):
    rng = np.random.default_rng(3)
    stretch = np.exp(rng.uniform(-0.2, 0.2, (50, 3)))
    mu, lam = np.full(50, 1e5 / (2 * (1 + nu))), np.full(50, 1e5 * nu / ((1 + nu) * (1 - 2 * nu)))
    parameters = np.stack([mu, lam, *[mu] * (len(law.parameters) - 2)])

    def energy(stretch):
        state = np.zeros((len(law.state), 50))
        if law.state:
            state[[0, 3, 5]] = (stretch**2 - 1).T
        return law.energy_density_pa(stretch[:, None, :] * np.eye(3), parameters, state)

    step = 1e-6 * np.eye(3)
    tau = [(energy(stretch * np.exp(h)) - energy(stretch * np.exp(-h))) / 2e-6 for h in step]
    np.testing.assert_allclose(law.stretches(np.stack(tau, 1), mu, lam), stretch, atol=1e-7)
