"""The ground and held parts as obstacles: resting, dropping, hanging leaves (B12, B17: ``test_validation.py``)."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mpm_bodies import body, lattice
from phys4dgen.errors import SimulationError
from phys4dgen.mpm import Acceleration, Ground, LawId, Settings, Simulator
from reference.mpm_reference import Reference

G = 9.81


def as_rigid(b):
    return replace(b, rigid_group=np.zeros(len(b), np.int32))


@pytest.mark.parametrize(("E", "fall"), [(3e4, 0.02), (3e4, 0.1), (3e5, 0.1)])
def test_a_soft_cube_comes_to_rest_on_the_ground(E, fall):
    dx = 0.02
    x = lattice((8, 8, 8), dx / 2, (0, 0, fall))
    settings = Settings(dx, 0.1, gravity_ms2=(0, 0, -G), ground=Ground(0.0), damping_per_s=4.0, cfl=0.6)
    simulator = Simulator(body(x, (dx / 2) ** 3, E=E), settings)
    frames = [simulator.advance() for _ in range(30)]
    underside = frames[-1].positions_m[:, 2].min() - dx / 4
    assert abs(underside) < 0.25 * dx
    assert frames[-1].max_speed_ms < 2e-3
    assert np.abs(frames[-1].positions_m - frames[-6].positions_m).max() < 0.01 * dx


def test_a_rigid_hammer_falls_rocks_and_comes_to_rest():
    dx = 0.01
    head, handle = lattice((16, 6, 6), dx / 2), lattice((4, 48, 4), dx / 2, (0.03, 0.03, 0.005))
    x = np.concatenate([head, handle])
    x = (x - x.mean(0)) @ Rotation.from_euler("xyz", [50, 20, 10], degrees=True).as_matrix().T
    x[:, 2] += 0.15 - x[:, 2].min()
    b = as_rigid(body(x, (dx / 2) ** 3, E=2e11, rho=np.repeat([7860.0, 700.0], [len(head), len(handle)])))
    simulator = Simulator(b, Settings(dx, 1 / 24, gravity_ms2=(0, 0, -G), ground=Ground(0.0)))
    frames = [simulator.frame, *(simulator.advance() for _ in range(48))]
    low = np.array([frame.positions_m[:, 2].min() for frame in frames]) - dx / 4
    assert low.min() > -0.1 * dx
    energy = np.array([f.kinetic_energy_j + G * b.mass_kg @ f.positions_m[:, 2] for f in frames])
    assert np.diff(energy).max() < 1e-3 * energy[0]
    assert frames[-1].kinetic_energy_j < 1e-12
    assert abs(low[-1]) < 0.05 * dx
    lying = frames[-1].positions_m[len(head) :]
    assert np.ptp(lying[:, 2]) < 0.6 * np.ptp(x[:, 2])  # the handle has come down


@pytest.mark.parametrize("contact", ["slip", "sticky"])
def test_ground_that_slips_and_ground_that_sticks(contact):
    for b in (body(lattice((6, 6, 6), 0.01), 1e-6, E=1e6), as_rigid(body(lattice((6, 6, 6), 0.01), 1e-6))):
        b = replace(b, velocities_ms=np.tile([0.5, 0.0, 0.0], (len(b), 1)))
        ground = Ground(0.0, contact=contact)
        simulator = Simulator(b, Settings(0.02, 0.05, gravity_ms2=(0, 0, -G), ground=ground, damping_per_s=0.0))
        for _ in range(8):
            frame = simulator.advance()
        speed = frame.momentum_kgms[0] / b.mass_kg.sum()
        assert speed == pytest.approx(0.5 if contact == "slip" else 0.0, abs=0.05)


@pytest.mark.parametrize("contact", ["slip", "sticky"])
def test_a_slender_rigid_rod_gains_no_energy_from_ground_that_does_not_let_go(contact):
    dx = 0.02
    x = lattice((2, 2, 10), dx / 2)
    x = (x - x.mean(0)) @ Rotation.from_euler("xy", [24, 18], degrees=True).as_matrix().T
    b = as_rigid(body(x - [0, 0, x[:, 2].min() - 0.03], (dx / 2) ** 3))
    simulator = Simulator(b, Settings(dx, 0.01, gravity_ms2=(0, 0, -G), ground=Ground(0.0, contact, restitution=0.6)))
    height = b.mass_kg * G @ b.positions_m[:, 2]
    fell = False
    for _ in range(30):
        frame = simulator.advance()
        energy = frame.kinetic_energy_j + b.mass_kg * G @ frame.positions_m[:, 2]
        assert energy < 1.01 * height
        fell = fell or frame.kinetic_energy_j > 0.1 * height
    assert fell
    lowest = frame.positions_m[:, 2].min()
    assert 0 < lowest < dx / 2  # the end that came down stays there


def test_water_runs_over_ground_on_which_a_block_stops_and_honey_clings_to_it():
    """Coulomb's friction is for solids; a fluid shears in the layer at the wall, at the rate eta / (rho h dx)."""
    dx = 0.02
    x = lattice((12, 12, 6), dx / 2, (0, 0, 0))
    v = np.tile([0.3, 0.0, 0.0], (len(x), 1))
    kept = {}
    for name, extra in {
        "block": {},
        "water": {"law": LawId.FLUID, "viscosity_pas": 1e-3},
        "honey": {"law": LawId.FLUID, "viscosity_pas": 10.0},
    }.items():
        b = body(x, (dx / 2) ** 3, E=1e5, rho=1400.0, nu=0.45, v=v, **extra)
        simulator = Simulator(b, Settings(dx, 0.05, gravity_ms2=(0, 0, -G), ground=Ground(0.0, friction=0.6)))
        frame = [simulator.advance() for _ in range(2)][-1]
        kept[name] = frame.momentum_kgms[0] / (0.3 * b.mass_kg.sum())
    assert kept["water"] > 0.97
    assert abs(kept["block"]) < 0.05  # v / mu g = 0.05 s
    assert kept["honey"] == pytest.approx(np.exp(-10 / 1400 / (6 * dx / 2 * dx) * 0.1), abs=0.15)


def test_a_body_below_the_ground_is_refused():
    with pytest.raises(SimulationError, match=r"'part_0' starts 0.0\d+ m below the ground at z = 0.1 m"):
        Simulator(body(lattice((4, 4, 4), 0.01), 1e-6), Settings(0.02, 0.01, ground=Ground(0.1)))


def pot_and_leaf(*, bonded, away_m=0.001, speed_ms=0.0):
    """A round held pot of 30 mm radius and a leaf of two layers, free in the air ``away_m`` from its wall."""
    dx = 0.005
    h = dx / 2
    pot = lattice((24, 24, 20), h, (-12 * h, -12 * h, -20 * h))
    pot = pot[np.linalg.norm(pot[:, :2], axis=1) < 0.03]
    thickness = 0.0025
    first = pot[:, 0].max() + h / 2 + away_m + thickness / 4
    y, z = np.meshgrid((np.arange(8) - 3.5) * h, (np.arange(12) - 15.5) * h, indexing="ij")
    layers = [np.stack([np.full(y.size, first + shift), y.ravel(), z.ravel()], 1) for shift in (0, thickness / 2)]
    x = np.concatenate([pot, *layers])
    is_leaf = np.arange(len(x)) >= len(pot)
    v = np.where(is_leaf[:, None], [-speed_ms, 0, 0], 0.0)
    volume = np.where(is_leaf, h * h * thickness / 2, h**3)
    b = body(x, volume, E=5e4, rho=500.0, part=is_leaf.astype(int), held=~is_leaf, names=("pot", "leaf"), v=v)
    return replace(b, bonded_to_held=~is_leaf | bonded), is_leaf


def blown(push_ms2, **keywords):
    b, is_leaf = pot_and_leaf(**keywords)
    gust = Acceleration((push_ms2, 0, 0), to_s=0.1, part=1)
    simulator = Simulator(b, Settings(0.005, 0.025, loads=(gust,)))
    frames = [simulator.advance() for _ in range(6)]
    moved = (frames[-1].positions_m - b.positions_m)[is_leaf, 0]
    nearest = min(np.linalg.norm(frame.positions_m[is_leaf, :2], axis=1).min() for frame in frames)
    return moved, nearest


def test_a_leaf_one_millimetre_from_the_pot_leaves_it_when_blown_away():
    moved, _ = blown(4.0, bonded=False)
    free_flight = 4.0 * 0.1 * (0.15 - 0.05)
    assert moved.mean() == pytest.approx(free_flight, rel=0.1)
    stuck, _ = blown(4.0, bonded=True)
    assert np.abs(stuck).max() < 1e-3 * free_flight  # as everything was before


def test_a_leaf_blown_towards_the_pot_does_not_enter_it():
    _, nearest = blown(-4.0, bonded=False)
    assert nearest > 0.03 - 0.25 * 0.005
    _, nearest = blown(0.0, bonded=False, away_m=0.012, speed_ms=0.5)
    assert 0.03 - 0.25 * 0.005 < nearest < 0.03 + 1.5 * 0.005  # it comes near, and no farther


def ground_scene(law):
    x = lattice((8, 8, 8), 0.01) + np.random.default_rng(0).uniform(-1e-3, 1e-3, (512, 3)) + [0, 0, 0.005]
    return body(x, 1e-6, E=2e5, nu=0.3, law=law, v=np.tile([0.3, 0.1, -1.0], (512, 1)))


def check_against_the_reference(law):
    """Substeps of a soft cube that hits the ground with friction, beside the float64 twin."""
    b = ground_scene(law)
    dx = 0.02
    simulator = Simulator(b, Settings(dx, 0.02, gravity_ms2=(0, 0, -G), ground=Ground(0.0, friction=0.4), cfl=0.3))
    frame = simulator.advance()
    origin = simulator._origin_m - 6 * dx
    nodes = np.ceil(np.ptp(b.positions_m, axis=0) / dx).astype(int) + 14
    truth = Reference(
        b.positions_m, b.velocities_ms, b.mass_kg, b.volume_m3, b.lame_mu_pa, b.lame_lambda_pa, b.law,
        dx=dx, origin=origin, nodes=nodes,
    )  # fmt: skip
    truth.ground = (-0.7 * dx, 0.4)
    for _ in range(frame.substeps):
        truth.substep(frame.dt_s, (0, 0, -G))
    assert frame.substeps > 40
    assert frame.momentum_kgms[2] > -0.3 * b.mass_kg.sum()  # it has hit
    assert np.abs(frame.positions_m - truth.x).max() < 2e-6 * np.ptp(b.positions_m)
    assert np.abs(frame.velocities_ms - truth.v).max() < 2e-5 * np.linalg.norm(truth.v, axis=1).max()
    assert np.abs(frame.deformation_gradients - truth.F).max() < 5e-6


def test_ground_against_the_reference():
    check_against_the_reference(law=np.arange(512) % 2)


def test_without_avx_and_without_flush_to_zero(tmp_path):
    """The same in a process that compiles for any x86-64 processor and lets denormal numbers be."""
    script = (
        "import phys4dgen.vector.float_state as state; state._IS_X86 = False\n"
        "import test_mpm_contact; test_mpm_contact.check_against_the_reference(law=0)"
    )
    here = Path(__file__).parent
    environment = dict(
        os.environ,
        NUMBA_CPU_NAME="generic",
        NUMBA_CPU_FEATURES="",
        NUMBA_CACHE_DIR=str(tmp_path),
        PYTHONPATH=os.pathsep.join([str(here), os.environ.get("PYTHONPATH", "")]),
    )
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
