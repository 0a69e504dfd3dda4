"""Gaussians on flowing material let go of particles that have left."""

from __future__ import annotations

import numpy as np

from phys4dgen.animate.coming_apart import ComingApart
from phys4dgen.animate.skinning import Skin


def skin_of(particles, weights):
    n = len(particles)
    return Skin(
        particles=np.asarray(particles, np.int32),
        weights=np.asarray(weights, np.float32),
        rigidity=np.zeros(n, np.float32),
        arm=np.zeros((n, 3), np.float32),
        distance_spacings=np.zeros(n, np.float32),
        adopted=np.zeros(n, bool),
    )


def test_particles_that_parted_carry_no_more_and_the_others_take_over():
    rest = np.stack(np.meshgrid([0.0, 1], [0.0, 1], [0.0, 1], indexing="ij"), -1).reshape(-1, 3)
    rest = np.concatenate([rest, rest + np.array([5, 0, 0])])
    weights = np.tile([0.3, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1], (2, 1)).astype(np.float32)
    skin = skin_of([range(8), range(8, 16)], weights)
    loose = np.arange(16) < 8
    parting = ComingApart(skin, rest, loose)
    padded = np.concatenate([weights, np.zeros((3, 8), np.float32)])
    np.testing.assert_allclose(parting.weights(padded, rest), padded, atol=1e-7)

    turned = rest @ np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]) * 1.2
    np.testing.assert_allclose(parting.weights(padded, turned), padded, atol=1e-7)  # nobody has left

    moved = rest.copy()
    moved[4:8, 0] += 9  # half of the first Gaussian's particles run away
    moved[8:] *= 50  # and all of the second's, which are elastic
    got = parting.weights(padded, moved)
    np.testing.assert_allclose(got[0], np.array([0.3, 0.1, 0.1, 0.1, 0, 0, 0, 0]) / 0.6, atol=1e-6)
    np.testing.assert_array_equal(got[1:], padded[1:])

    moved = rest.copy()
    moved[1:8] = rest[0] + 40 * (rest[1:8] - rest[0])
    np.testing.assert_allclose(parting.weights(padded, moved)[0], [1, 0, 0, 0, 0, 0, 0, 0], atol=1e-6)


def test_letting_go_is_gradual():
    rest = np.zeros((8, 3))
    rest[1:, 0] = 1.0
    parting = ComingApart(skin_of([range(8)], np.full((1, 8), 0.125)), rest, np.ones(8, bool))
    shares = []
    for stretch in np.linspace(1, 2.2, 60):
        moved = rest.copy()
        moved[1, 0] = stretch
        shares.append(parting.weights(np.full((1, 8), 0.125, np.float32), moved)[0, 1])
    assert shares[0] == np.float32(0.125) and shares[-1] == 0
    assert np.abs(np.diff(shares)).max() < 0.006


def test_a_gaussian_that_is_a_particle_keeps_it():
    rest = np.arange(24.0).reshape(8, 3)
    weights = np.eye(8, dtype=np.float32)[:1]
    parting = ComingApart(skin_of([[0] * 8], weights), rest, np.ones(8, bool))
    np.testing.assert_array_equal(parting.weights(weights, 3 * rest), weights)
