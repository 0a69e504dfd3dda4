"""The simulator's promises: determinism, held parts, loads, guards, moving grid, estimates."""

from __future__ import annotations

import numba
import numpy as np
import pytest

from mpm_bodies import body, lattice
from phys4dgen.errors import SimulationError
from phys4dgen.mpm import Acceleration, Body, LawId, Settings, Simulator, affordable_modulus_pa, stiff_parts
from phys4dgen.mpm.timestep import sort_interval

DX = 0.02


def two_cubes(gap=6 * DX, **keywords):
    cube = lattice((8, 8, 8), DX / 2)
    x = np.concatenate([cube, cube + np.array([8 * DX / 2 + gap, 0, 0])])
    return body(x, (DX / 2) ** 3, part=np.repeat([0, 1], len(cube)), names=("stem", "leaf"), **keywords)


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="needs two threads")
@pytest.mark.parametrize("chunks", [1, 3])
def test_one_and_two_threads_give_the_same_bits(chunks):
    rng = np.random.default_rng(0)
    x = rng.random((2000, 3)) * 8 * DX
    b = body(x, 1e-6, law=rng.integers(0, 2, 2000), v=rng.normal(0, 0.3, x.shape))
    before = numba.get_num_threads()
    results = []
    try:
        for threads in (1, 2, 2):
            numba.set_num_threads(threads)
            simulator = Simulator(b, Settings(DX, 0.01, gravity_ms2=(0, 0, -9.81), chunks=chunks))
            simulator.advance()
            frame = simulator.advance()
            results.append((frame.positions_m, frame.deformation_gradients, frame.velocities_ms))
    finally:
        numba.set_num_threads(before)
    for other in results[1:]:
        for a, c in zip(results[0], other, strict=True):
            np.testing.assert_array_equal(a, c)


def test_frame_zero_is_the_rest_pose():
    b = two_cubes()
    frame = Simulator(b, Settings(DX, 0.01)).frame
    np.testing.assert_allclose(frame.positions_m, b.positions_m, atol=1e-8)
    assert (frame.time_s, frame.substeps) == (0.0, 0)
    assert frame.elastic_energy_j == pytest.approx(0, abs=1e-9)


def test_nothing_moves_without_load():
    b = two_cubes()
    simulator = Simulator(b, Settings(DX, 0.02))
    for _ in range(3):
        frame = simulator.advance()
    assert np.abs(frame.positions_m - b.positions_m).max() < 1e-7
    assert frame.time_s == pytest.approx(0.06)


@pytest.mark.parametrize(("ramp_s", "share"), [(0.0, 1.0), (0.0222, 0.5)])
def test_acceleration_moves_its_part_alone_for_exactly_its_window(ramp_s, share):
    push = Acceleration((1.5, 0, -0.5), from_s=0.0123, to_s=0.0567, part=1, ramp_s=ramp_s)
    b = two_cubes()
    simulator = Simulator(b, Settings(DX, 0.02, loads=(push,)))
    for _ in range(4):
        frame = simulator.advance()
    moved = np.abs(frame.positions_m - b.positions_m).max(1)
    assert moved[b.part == 0].max() < 1e-7
    velocity = np.array(push.value_ms2) * (0.0567 - 0.0123) * share
    np.testing.assert_allclose(
        frame.velocities_ms[b.part == 1], np.broadcast_to(velocity, (512, 3)), atol=2e-5 * np.abs(velocity).max()
    )


def test_acceleration_of_everything_reaches_every_part():
    b = two_cubes()
    push = Acceleration((0, 0.7, 0), from_s=0.005, to_s=0.015)
    simulator = Simulator(b, Settings(DX, 0.02, loads=(push,)))
    np.testing.assert_allclose(simulator.advance().velocities_ms, np.tile([0, 0.007, 0], (len(b), 1)), atol=1e-6)


def test_gap_of_two_cells_lets_parts_move_apart():
    v = np.zeros((1024, 3))
    v[512:, 0] = 0.2
    simulator = Simulator(two_cubes(gap=2 * DX, v=v), Settings(DX, 0.05))
    frame = simulator.advance()
    np.testing.assert_allclose(frame.velocities_ms, v, atol=1e-4)


def test_held_part_stays_and_holds_what_stands_on_it():
    x = lattice((8, 8, 20), DX / 2)
    part = (x[:, 2] > 4 * DX).astype(int)
    b = body(x, (DX / 2) ** 3, E=2e5, part=part, held=part == 0, names=("pot", "foliage"))
    simulator = Simulator(b, Settings(DX, 0.02, loads=(Acceleration((4, 0, 0), to_s=0.1, part=1),)))
    for _ in range(4):
        frame = simulator.advance()
    moved = np.linalg.norm(frame.positions_m - x, axis=1)
    np.testing.assert_array_equal(moved[part == 0], 0)
    assert moved[part == 1].max() > 1e-4
    by_layer = moved.reshape(64, 20).mean(0)  # the column shears: it stands still at its foot
    assert by_layer[8] < 0.3 * by_layer[-1]
    assert (np.diff(by_layer[7:]) > 0).all()


def test_result_does_not_depend_on_where_the_grid_is_laid():
    b = two_cubes(v=np.tile([3.0, -1.0, 0.5], (1024, 1)))
    frames = []
    for padding in (3, 24):
        simulator = Simulator(b, Settings(DX, 0.02, gravity_ms2=(0, 0, -9.81), padding_cells=padding))
        grids = {id(simulator._grid)}
        for _ in range(8):
            frames.append(simulator.advance())
            grids.add(id(simulator._grid))
        assert (len(grids) > 1) == (padding == 3)  # 24 cells are enough for a flight of 0.48 m; 3 are not
    np.testing.assert_array_equal(frames[7].positions_m, frames[15].positions_m)
    np.testing.assert_array_equal(frames[7].deformation_gradients, frames[15].deformation_gradients)


def test_parts_that_fly_apart_without_end_are_refused_by_name():
    v = np.zeros((1024, 3))
    v[512:] = [8.0, 8.0, 8.0]
    simulator = Simulator(two_cubes(v=v), Settings(DX, 0.02, max_grid_nodes=40_000))
    with pytest.raises(SimulationError, match=r"spreads too far in frame .*'leaf' is farthest from"):
        for _ in range(50):
            simulator.advance()
    assert np.isfinite(simulator.frame.positions_m).all()


def test_a_load_that_needs_too_many_substeps_is_refused():
    kick = Acceleration((1e6, 0, 0), from_s=0.03, to_s=0.04)
    simulator = Simulator(two_cubes(), Settings(DX, 0.02, loads=(kick,)))
    simulator.advance()
    with pytest.raises(SimulationError, match=r"Frame 2 .* substeps"):
        simulator.advance()
    assert simulator.frame.time_s == pytest.approx(0.02)


def test_stiff_parts_are_named_with_what_they_need():
    b = two_cubes(E=np.repeat([1e5, 1e10], 512))
    settings = Settings(DX, 1 / 24, max_substeps_per_frame=2000)
    (stiff,) = stiff_parts(b, settings)
    assert (stiff.name, stiff.part) == ("leaf", 1)
    c_p = np.sqrt(1e10 * 0.7 / (1.3 * 0.4) / 1000)
    assert stiff.needed_substeps == np.ceil(1 / 24 * c_p / (0.4 * DX))
    assert str(stiff).startswith("part 'leaf' (E = 1e+10 Pa) needs")
    with pytest.raises(SimulationError, match="part 'leaf'"):
        Simulator(b, settings)
    softer = two_cubes(E=np.repeat([1e5, 0.999 * stiff.affordable_modulus_pa], 512))
    assert stiff_parts(softer, settings) == []
    held = two_cubes(E=np.repeat([1e5, 1e10], 512), held=np.repeat([False, True], 512))
    assert stiff_parts(held, settings) == []


def test_affordable_modulus_inverts_the_substep_count():
    settings = Settings(DX, 1 / 24, max_substeps_per_frame=777)
    modulus = affordable_modulus_pa(900.0, 0.33, settings)
    estimate = Simulator(two_cubes(E=0.9999 * modulus, rho=900.0, nu=0.33), settings).estimate()
    assert estimate.substeps_per_frame == 777
    assert estimate.particle_substeps_per_frame == 777 * 1024


def test_sort_interval_follows_the_speed():
    assert sort_interval(400, 1e-5, 0.1, DX) == 50
    assert sort_interval(60, 1e-5, 0.1, DX) == 30
    assert sort_interval(400, 1e-3, 1.0, DX) == 6
    assert sort_interval(2, 1.0, 1e9, DX) == 1


def test_bodies_are_checked():
    x = lattice((2, 2, 2), DX)
    with pytest.raises(ValueError, match=r"law: expected NEO_HOOKEAN = 0, FIXED_COROTATED = 1, .* FLUID = 8; got"):
        body(x, 1e-6, law=9)
    with pytest.raises(ValueError, match="poisson_ratio"):
        body(x, 1e-6, nu=0.5)
    with pytest.raises(ValueError, match="positions_m: expected finite"):
        body(np.full((8, 3), np.nan), 1e-6)
    with pytest.raises(ValueError, match=r"part: expected 0 \.\. 0"):
        body(x, 1e-6, part=1, names=("one",))
    with pytest.raises(SimulationError, match="all particles are held"):
        Simulator(body(x, 1e-6, held=True), Settings(DX, 0.01))
    with pytest.raises(SimulationError, match="names part 5"):
        Simulator(body(x, 1e-6), Settings(DX, 0.01, loads=(Acceleration((1, 0, 0), part=5),)))


def test_body_from_plain_arrays():
    p = 8
    b = Body(
        positions_m=lattice((2, 2, 2), DX),
        volume_m3=np.full(p, 1e-6),
        density_kgm3=np.full(p, 900.0),
        youngs_modulus_pa=np.full(p, 1e5),
        poisson_ratio=np.full(p, 0.25),
        law=np.full(p, LawId.NEO_HOOKEAN),
        part=np.zeros(p, int),
        held=np.zeros(p, bool),
        part_names=("block",),
    )
    assert b.lame_mu_pa[0] == pytest.approx(4e4)
    assert b.lame_lambda_pa[0] == pytest.approx(4e4)
    assert b.wave_speed_ms[0] == pytest.approx(np.sqrt(1.2e5 / 900))
