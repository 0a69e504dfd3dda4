"""Skinning and deformed covariances: against theory and against the float64 reference."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from animate_bodies import (
    SPACING,
    UNIT_FRAME,
    continuum_of,
    gaussians_at,
    lattice,
    relative_error,
    rotation,
    skinned,
    skinned_block,
    wavy,
)
from phys4dgen.animate import Animator, AxisTracker, skin
from phys4dgen.types import Frame, rotation_from_quats
from reference import animate_reference as reference


@pytest.fixture(scope="module")
def block():
    return skinned_block()


# ------------------------------------------------------------------------------------------------------- the skin


def test_weights_are_those_of_the_eight_nearest(block):
    gaussians, particles, hung = block
    distance = np.linalg.norm(gaussians.means[:, None].astype(float) - particles, axis=2)
    nearest = np.sort(distance, 1)[:, :8]
    expected = np.exp(-0.7 * (nearest / SPACING) ** 2)
    expected /= expected.sum(1, keepdims=True)
    np.testing.assert_allclose(np.take_along_axis(distance, hung.particles.astype(int), 1), nearest, rtol=1e-12)
    np.testing.assert_allclose(hung.weights, expected, atol=1e-6)
    np.testing.assert_allclose(hung.weights.sum(1), 1, atol=1e-6)
    assert not hung.adopted.any()
    assert not hung.rigidity.any()


def test_equal_distances_are_settled_by_particle_number():
    """Twelve particles at exactly the same distance: the first eight carry the Gaussian, in order."""
    ring = np.array([[x, y, 0] for x in (-0.125, 0.125) for y in (-0.125, 0.125)])
    particles = np.concatenate([ring, np.roll(ring, 1, 1), np.roll(ring, 2, 1)])
    hung = skinned(gaussians_at(np.zeros((1, 3))), continuum_of(particles))
    assert hung.particles[0].tolist() == list(range(8))


def test_the_skin_does_not_depend_on_the_number_of_workers(block):
    gaussians, particles, hung = block
    again = skinned(gaussians, continuum_of(particles), workers=2)
    single = skinned(gaussians, continuum_of(particles), workers=1)
    for name in ("particles", "weights", "rigidity", "arm"):
        assert (getattr(again, name) == getattr(single, name)).all()
        assert (getattr(hung, name) == getattr(single, name)).all()


def test_spacing_is_turned_into_input_units():
    particles = lattice((4, 4, 4))
    gaussians = gaussians_at(particles + 0.02)
    in_metres = skinned(gaussians, continuum_of(particles))
    millimetre_input = Frame(rotation=np.eye(3), metres_per_unit=1e-3)
    scaled = skin(
        gaussians,
        np.zeros(64, np.int32),
        continuum_of(particles, spacing_m=SPACING * 1e-3),
        frame=millimetre_input,
    )
    np.testing.assert_allclose(scaled.weights, in_metres.weights, rtol=1e-6)


@pytest.mark.parametrize("separator", ["part", "piece"])
def test_neither_parts_nor_pieces_drag_each_other(separator):
    """Two blocks that touch; the upper one turns away, the lower one must not feel it."""
    particles = np.concatenate([lattice((4, 4, 4)), lattice((4, 4, 4), (0, 0, 0.4))])
    upper = np.arange(128) >= 64
    gaussians = gaussians_at(np.random.default_rng(2).uniform(0.02, [0.38, 0.38, 0.78], (200, 3)))
    high = gaussians.means[:, 2] > 0.4
    continuum = continuum_of(particles, **{separator: upper.astype(np.int32)})
    hung = skinned(gaussians, continuum, labels=high if separator == "part" else 0)
    turn = rotation([1, 0, 0], 0.7)
    now = np.where(upper[:, None], particles @ turn.T, particles)
    gradient = np.where(upper[:, None, None], turn, np.eye(3))
    frame = Animator(gaussians, hung, particles).frame(now, gradient)
    assert (frame.positions[~high] == gaussians.means[~high]).all()
    assert (frame.rotations[~high] == np.eye(3)).all()
    np.testing.assert_allclose(frame.positions[high], gaussians.means[high] @ turn.T, atol=3e-7)


def test_a_part_without_particles_takes_the_nearest_of_any_part():
    particles = lattice((4, 4, 4))
    gaussians = gaussians_at(particles[:5] + 0.03)
    hung = skinned(gaussians, continuum_of(particles), labels=3)
    assert hung.adopted.all()
    assert (hung.particles[:, 0] == np.arange(5)).all()


def test_a_mislabelled_gaussian_follows_the_part_it_lies_in():
    pot, leaf = lattice((4, 4, 4)), lattice((4, 4, 4), (0, 0, 1.0))
    continuum = continuum_of(np.concatenate([pot, leaf]), part=np.repeat([0, 1], 64))
    means = np.concatenate([leaf[:3] + 0.01, pot[:2] + 0.01])
    labels = np.array([0, 0, 0, 1, 1], np.int32)  # all wrong
    gaussians = gaussians_at(means)
    free = skin(gaussians, labels, continuum, frame=UNIT_FRAME)
    assert free.adopted.tolist() == [True] * 5
    pot_held = skin(gaussians, labels, continuum, frame=UNIT_FRAME, held_parts={0})
    assert pot_held.adopted.tolist() == [True] * 3 + [False] * 2


def test_a_piece_of_fewer_than_eight_particles_carries_its_gaussians():
    particles = lattice((1, 1, 3))
    hung = skinned(gaussians_at(particles + 0.02), continuum_of(particles))
    assert ((hung.weights > 0).sum(1) == 3).all()
    np.testing.assert_allclose(hung.weights.sum(1), 1, atol=1e-6)


def _stalk(sites=20):
    """Nine strands around a straight axis along x, one spacing apart; positions, offsets and site numbers."""
    middle = np.repeat(np.column_stack([np.arange(sites) * SPACING, np.zeros((sites, 2))]), 9, 0)
    strand = np.stack(np.meshgrid([-0.3, 0, 0.3], [-0.3, 0, 0.3], indexing="ij"), -1).reshape(-1, 2) * SPACING
    offset = np.tile(np.column_stack([np.zeros(9), strand]), (sites, 1))
    return middle + offset, offset, np.repeat(np.arange(sites), 9)


def test_each_cross_section_of_a_stalk_carries_a_gaussian_with_its_nearest_strand():
    positions, offset, site = _stalk()
    continuum = replace(continuum_of(positions), offset_m=offset, site=site)
    rng = np.random.default_rng(4)
    means = np.column_stack([rng.uniform(8, 11, 40), rng.uniform(-0.4, 0.4, (40, 2))]) * SPACING
    hung = skinned(gaussians_at(means), continuum)
    distance = np.linalg.norm(means[:, None] - positions, axis=2).reshape(40, 20, 9)
    for mean, carriers, to_strand in zip(means, hung.particles, distance, strict=True):
        nearest_sites = np.argsort(np.abs(np.arange(20) * SPACING - mean[0]))[:8]
        assert set(carriers) == {9 * k + to_strand[k].argmin() for k in nearest_sites}
    found = np.take_along_axis(distance.reshape(40, -1), hung.particles.astype(int), 1)
    assert (np.diff(found, axis=1) >= 0).all()


def test_a_stalk_of_three_sites_carries_its_gaussians_with_three_strands():
    positions, offset, site = _stalk(sites=3)
    continuum = replace(continuum_of(positions), offset_m=offset, site=site)
    means = np.column_stack([np.linspace(-1, 3, 9), np.full(9, 0.3), np.full(9, -0.2)]) * SPACING
    hung = skinned(gaussians_at(means), continuum)
    used = [set(site[row[weight > 0]]) for row, weight in zip(hung.particles, hung.weights, strict=True)]
    assert all(len(sites) == (weights > 0).sum() for sites, weights in zip(used, hung.weights, strict=True))
    assert used[4] == {0, 1, 2}
    np.testing.assert_allclose(hung.weights.sum(1), 1, atol=1e-6)


def test_a_site_that_two_pieces_share_carries_each_with_its_own_particles():
    positions, offset, site = _stalk()
    piece = (offset[:, 1] > 0).astype(int)
    continuum = replace(continuum_of(positions, piece=piece), offset_m=offset, site=site)
    means = np.column_stack([np.linspace(8, 11, 12), np.repeat([-0.5, 0.5], 6), np.zeros(12)]) * SPACING
    hung = skinned(gaussians_at(means), continuum)
    assert (piece[hung.particles[:6]] == 0).all()
    assert (piece[hung.particles[6:]] == 1).all()
    assert all(len(set(site[row])) == 8 for row in hung.particles)


def test_f_does_not_jump_from_one_cross_section_of_a_stalk_to_the_next():
    """A twist that grows along the axis: hung on the nine strands of one site, Gaussians would turn in steps."""
    positions, offset, site = _stalk()
    continuum = replace(continuum_of(positions), offset_m=offset, site=site)
    means = np.column_stack([np.linspace(6, 13, 141) * SPACING, np.full(141, 0.35 * SPACING), np.zeros(141)])
    gaussians = gaussians_at(means)
    animator = Animator(gaussians, skinned(gaussians, continuum), positions)
    twist = np.tile(np.eye(3), (len(positions), 1, 1))
    twist[:, 1, 2] = 0.3 * positions[:, 0]
    carried = animator.carry(positions, twist)[1][:, 1, 2]
    step = 0.3 * 7 * SPACING / 140
    np.testing.assert_allclose(np.diff(carried), step, rtol=0.2)
    np.testing.assert_allclose(carried, 0.3 * means[:, 0], rtol=0.01)


def test_far_gaussians_turn_without_stretching_and_nothing_jumps():
    """A line of Gaussians from the surface out to 12 spacings, under a stretch and a turn."""
    particles = lattice((4, 4, 4))
    spacings = np.linspace(0, 12, 481)
    means = np.stack([0.35 + SPACING * spacings, np.full(481, 0.21), np.full(481, 0.22)], 1)
    gaussians = gaussians_at(means)
    hung = skinned(gaussians, continuum_of(particles))
    turn = rotation([0, 0, 1], 0.6)
    deformation = turn @ np.diag([1.2, 0.9, 1.0])
    frame = Animator(gaussians, hung, particles).frame(particles @ deformation.T, np.tile(deformation, (64, 1, 1)))

    np.testing.assert_allclose(frame.rotations, np.broadcast_to(turn, (481, 3, 3)), atol=1e-6)
    values = np.linalg.svd(frame.deformation.astype(float), compute_uv=False)
    np.testing.assert_allclose(values[hung.distance_spacings < 2, 0], 1.2, atol=1e-6)
    np.testing.assert_allclose(values[hung.distance_spacings > 3], 1, atol=1e-6)
    displacement = frame.positions - means
    step = np.linalg.norm(np.diff(displacement, axis=0), axis=1)
    assert step.max() < 1.5 * SPACING / 40  # sampled every 1/40 spacing: no step exceeds a strain of 1.5
    beyond = hung.distance_spacings > 8  # the lever arm has ended: only the direction to the particles still counts
    assert np.ptp(displacement[beyond], axis=0).max() < 0.1 * SPACING


# ------------------------------------------------------------------------------------------------------- the motion


def test_rest_is_rest_to_the_bit(block):
    gaussians, particles, hung = block
    frame = Animator(gaussians, hung, particles).frame(particles, np.tile(np.eye(3), (len(particles), 1, 1)))
    assert (frame.positions == gaussians.means).all()
    assert (frame.deformation == np.eye(3)).all()
    assert (frame.rotations == np.eye(3)).all()
    packed = gaussians.covariances().reshape(-1, 9)[:, [0, 1, 2, 4, 5, 8]].astype(np.float32)
    assert (frame.covariances6 == packed).all()
    quats, scales = AxisTracker(gaussians).advance(frame.deformation)
    assert (quats == gaussians.quats_wxyz).all()
    assert (scales == gaussians.scales).all()


@settings(max_examples=25, deadline=None)
@given(axis=st.tuples(*[st.floats(-1, 1)] * 3), angle=st.floats(-3.1, 3.1), shift=st.floats(-5, 5))
def test_a_rigid_motion_moves_gaussians_rigidly(block, axis, angle, shift):
    gaussians, particles, hung = block
    turn = rotation(np.add(axis, (0.01, 0.02, 1.5)), angle)
    offset = np.array([shift, -shift, 0.5 * shift])
    now = particles @ turn.T + offset
    frame = Animator(gaussians, hung, particles).frame(now, np.tile(turn, (len(particles), 1, 1)))
    # Places up to 7 in float32, whose steps there are 4.8e-7.
    np.testing.assert_allclose(frame.positions, gaussians.means @ turn.T + offset, rtol=3e-7, atol=1e-6)
    np.testing.assert_allclose(frame.rotations, np.broadcast_to(turn, frame.rotations.shape), atol=1e-6)
    assert relative_error(frame.covariances6, turn @ gaussians.covariances() @ turn.T) < 2e-6
    quats, scales = AxisTracker(gaussians).advance(frame.deformation)
    np.testing.assert_allclose(scales, gaussians.scales, rtol=2e-6)
    axes = rotation_from_quats(quats)
    np.testing.assert_allclose(axes, turn @ rotation_from_quats(gaussians.quats_wxyz), atol=3e-6)


def test_an_affine_field_is_reproduced(block):
    gaussians, particles, hung = block
    deformation = np.array([[1.1, 0.2, -0.1], [0.05, 0.9, 0.15], [-0.2, 0.1, 1.05]])
    offset = np.array([0.3, -0.2, 0.1])
    frame = Animator(gaussians, hung, particles).frame(
        particles @ deformation.T + offset, np.tile(deformation, (len(particles), 1, 1))
    )
    np.testing.assert_allclose(frame.positions, gaussians.means @ deformation.T + offset, atol=3e-7)
    np.testing.assert_allclose(frame.deformation, np.broadcast_to(deformation, (333, 3, 3)), atol=3e-7)
    assert relative_error(frame.covariances6, deformation @ gaussians.covariances() @ deformation.T) < 1e-6


def test_no_digits_are_lost_far_from_the_origin(block):
    """Around (500, -800, 300), a float32 coordinate has steps of 6e-5: results may be off by that and no more."""
    near, particles, _ = block
    far_particles = particles + np.array([500.0, -800.0, 300.0])
    gaussians = gaussians_at(near.means.astype(float) + np.array([500.0, -800.0, 300.0]))
    hung = skinned(gaussians, continuum_of(far_particles))
    moved, gradient = wavy(particles)
    frame = Animator(gaussians, hung, far_particles).frame(far_particles + (moved - particles), gradient)
    expected, _ = reference.blend(
        gaussians.means, hung.particles, hung.weights, far_particles, far_particles + (moved - particles), gradient
    )
    np.testing.assert_allclose(frame.positions, expected, atol=7e-5)


def test_a_general_motion_equals_the_float64_reference(block):
    gaussians, particles, hung = block
    moved, gradient = wavy(particles)
    frame = Animator(gaussians, hung, particles).frame(moved, gradient)
    positions, deformation = reference.blend(gaussians.means, hung.particles, hung.weights, particles, moved, gradient)
    np.testing.assert_allclose(frame.positions, positions, atol=3e-7)
    np.testing.assert_allclose(frame.deformation, deformation, atol=5e-7)
    np.testing.assert_allclose(frame.rotations, reference.polar_rotation(deformation), atol=2e-6)
    assert (
        relative_error(frame.covariances6, reference.deformed_covariance(deformation, gaussians.covariances())) < 2e-6
    )


def test_the_result_does_not_depend_on_the_number_of_threads(block):
    gaussians, particles, hung = block
    moved, gradient = wavy(particles)
    frames, files = [], []
    for threads in (1, 2, 5):
        frames.append(Animator(gaussians, hung, particles, threads=threads).frame(moved, gradient))
        files.append(AxisTracker(gaussians, threads=threads).advance(frames[-1].deformation))
    for frame, file in zip(frames[1:], files[1:], strict=True):
        for name in ("positions", "deformation", "rotations", "covariances6"):
            assert getattr(frame, name).tobytes() == getattr(frames[0], name).tobytes()
        assert [a.tobytes() for a in file] == [a.tobytes() for a in files[0]]


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**31), angle=st.floats(-3, 3))
def test_turning_the_whole_world_turns_the_result(block, seed, angle):
    """Rotation invariance: particles, Gaussians and motion turned by Q give positions, covariances and R turned."""
    gaussians, particles, hung = block
    turn = rotation(np.random.default_rng(seed).normal(size=3), angle)
    moved, gradient = wavy(particles, time=seed % 7)
    here = Animator(gaussians, hung, particles).frame(moved, gradient)
    covariance = reference.unpack6(here.covariances6)

    turned = gaussians_at(gaussians.means.astype(float) @ turn.T)
    there = Animator(turned, skinned(turned, continuum_of(particles @ turn.T)), particles @ turn.T).frame(
        moved @ turn.T, turn @ gradient @ turn.T
    )
    np.testing.assert_allclose(there.positions, here.positions @ turn.T, atol=2e-5)  # ties may blend other particles
    np.testing.assert_allclose(there.rotations, turn @ here.rotations @ turn.T, atol=2e-5)
    rest_turned = turn @ gaussians.covariances() @ turn.T
    deformed = there.deformation.astype(float)
    np.testing.assert_allclose(
        deformed @ rest_turned @ np.swapaxes(deformed, 1, 2), turn @ covariance @ turn.T, atol=1e-5 * covariance.max()
    )
