"""Particles and Gaussians for the tests of the animation, and motions whose truth is known."""

import numpy as np

from phys4dgen.animate import skin
from phys4dgen.types import Continuum, Frame, Gaussians, rotation_from_quats
from reference import animate_reference as reference

SPACING = 0.1
UNIT_FRAME = Frame(rotation=np.eye(3), metres_per_unit=1.0)


def lattice(shape, corner=(0.0, 0.0, 0.0)):
    return np.asarray(corner) + SPACING * (np.stack(np.indices(shape), -1).reshape(-1, 3) + 0.5)


def continuum_of(positions, *, part=0, piece=0, spacing_m=SPACING):
    p = len(positions)
    return Continuum(
        positions=positions,
        part=np.broadcast_to(part, p),
        is_interior=np.zeros(p, bool),
        volume_m3=np.full(p, spacing_m**3),
        gaussian_index=np.full(p, -1),
        piece=np.broadcast_to(piece, p),
        shape=np.zeros(p),
        thickness_m=np.full(p, np.nan),
        thickness_measured=np.zeros(p, bool),
        offset_m=np.zeros((p, 3)),
        site=np.arange(p),
        spacing_m=spacing_m,
    )


def gaussians_at(means, *, seed=0, scales=None):
    n = len(means)
    rng = np.random.default_rng(seed)
    quats = rng.normal(size=(n, 4))
    return Gaussians(
        means=means,
        quats_wxyz=quats / np.linalg.norm(quats, axis=1, keepdims=True),
        scales=np.exp(rng.normal(-4, 1.2, (n, 3))) if scales is None else np.broadcast_to(scales, (n, 3)),
        opacities=np.full(n, 0.5),
        sh=np.zeros((n, 1, 3)),
    )


def skinned(gaussians, continuum, labels=0, **options):
    labels = np.broadcast_to(np.int32(labels), len(gaussians))
    return skin(gaussians, labels, continuum, frame=UNIT_FRAME, **options)


def rotation(axis, angle_rad):
    axis = np.asarray(axis, float) / np.linalg.norm(axis)
    return rotation_from_quats(np.concatenate([[np.cos(angle_rad / 2)], np.sin(angle_rad / 2) * axis]))


def relative_error(packed, truth):
    error = np.linalg.norm(reference.unpack6(packed) - truth, axis=(1, 2))
    return (error / np.linalg.norm(truth, axis=(1, 2))).max()


def wavy(points, amplitude=0.08, time=1.0):
    """A smooth displacement field that is nowhere affine: new positions and F."""
    k = np.array([[2.0, 1.0, -1.5], [-1.0, 3.0, 0.5], [1.5, -0.5, 2.0]])
    direction = np.array([[1.0, 0.2, 0.0], [0.0, 1.0, -0.3], [0.4, 0.0, 1.0]])
    moved, gradient = points.copy(), np.tile(np.eye(3), (len(points), 1, 1))
    for m in range(3):
        phase = points @ k[m] + m
        moved = moved + amplitude * np.sin(time + m) * np.sin(phase)[:, None] * direction[m]
        gradient += amplitude * np.sin(time + m) * np.cos(phase)[:, None, None] * np.outer(direction[m], k[m])
    return moved, gradient


def skinned_block():
    """333 Gaussians (not a whole number of vectors) in and just outside 8 x 8 x 8 particles, those, and the skin."""
    particles = lattice((8, 8, 8))
    gaussians = gaussians_at(np.random.default_rng(1).uniform(-0.05, 0.85, (333, 3)))
    continuum = continuum_of(particles)
    return gaussians, particles, skinned(gaussians, continuum)
