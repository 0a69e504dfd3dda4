"""Which particles carry each Gaussian, and with what weights.

The simulator moves a well-spaced particle set; the Gaussians ride on it. Each Gaussian hangs on the 8 nearest rest
particles of its own part and connected piece with weights exp(-0.7 (d/h)^2), h the particle spacing, so that neither
touching parts nor separate leaves of one part drag each other along. Of the particles of one site (the nine of a
stalk's cross-section) only the nearest counts: the eight would be one site's, and F would jump from site to site.

Away from the particles the interpolated deformation gradient is an extrapolation, so it is trusted less and less:

- up to 2 spacings a Gaussian follows the full affine motion;
- from 2 to 3 spacings it passes smoothly over to the rotation alone (no stretch), and beyond 3 it keeps only that;
- its lever arm about the particles ends at 6 spacings: a far floater translates with its nearest particles and turns
  on the spot, but is not swung through the scene.

Far floaters are carried and not held in space: captures have semi-transparent Gaussians off thin leaves, and one that
stays behind looks like a tear. Both rules are continuous in the distance, so neighbours never part at a threshold.
A visible group of Gaussians that hangs in the air (the tip of a leaf whose middle the capture lost) is carried as one.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from phys4dgen.errors import StageError
from phys4dgen.types import Continuum, Frame, Gaussians

__all__ = ["NEIGHBOURS", "Skin", "skin"]

NEIGHBOURS = 8
"""Particles that carry one Gaussian."""

FALLOFF = 0.7
"""Weights are exp(-FALLOFF (d/h)^2)."""

AFFINE_REACH, RIGID_REACH, ARM_REACH = 2.0, 3.0, 6.0
"""Distances in particle spacings: full affine motion up to the first, rotation only from the second, lever arm limited
to the third."""

FOREIGN_REACH = 1.0
"""A Gaussian beyond AFFINE_REACH of its own part hangs on another free part that is nearer than this (label noise)."""

VISIBLE, ISLAND_LINK = 0.1, 4.0
"""Opacity above which Gaussians form an island, and the distance in spacings within which they belong to one."""

_BLOCK = 1 << 16  # Gaussians whose neighbours are sought at a time
_TIE_MARGIN = 4  # neighbours asked for beyond the eight, so that equal distances are settled by particle number


@dataclass(frozen=True, eq=False)
class Skin:
    """How N Gaussians hang on the particles.

    Attributes:
        particles: the particles that carry each Gaussian, nearest first, shape [N, 8], int32.
        weights: of those particles, rows sum to 1, shape [N, 8], float32.
        rigidity: 0 where a Gaussian stretches with the particles, 1 where it only turns, shape [N], float32.
        arm: from the weighted mean of the particles to the Gaussian, limited in length, shape [N, 3], float32, input
            units.
        distance_spacings: to the nearest particle of those that carry it, in particle spacings, shape [N], float32.
        adopted: the Gaussian hangs on another part than its own, shape [N], bool.
    """

    particles: NDArray[np.int32]
    weights: NDArray[np.float32]
    rigidity: NDArray[np.float32]
    arm: NDArray[np.float32]
    distance_spacings: NDArray[np.float32]
    adopted: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.particles)


def skin(
    gaussians: Gaussians,
    labels: NDArray[np.int32],
    continuum: Continuum,
    *,
    frame: Frame,
    held_parts: Collection[int] = (),
    workers: int = -1,
) -> Skin:
    """Hang every Gaussian on the 8 nearest rest particles of its part and connected piece, one of each site.

    The piece of a Gaussian is that of the nearest particle of its part. A Gaussian whose part has no particle at all
    takes the nearest particles of any part. A Gaussian that is itself a particle follows that one alone.

    Args:
        gaussians: N Gaussians at rest, input coordinates.
        labels: part of each Gaussian, shape [N].
        continuum: P particles at rest, input coordinates.
        frame: gives the length of an input unit in metres.
        held_parts: parts that do not move; no Gaussian of another part is handed over to them.
        workers: threads of the neighbour search, -1 for all; the result does not depend on it.

    Raises:
        StageError: ``labels`` does not give one part per Gaussian.

    Paper: Sec. 3.5 (interpolation of the motion to the Gaussians); MOTION.md, Technique 8.
    """
    if np.shape(labels) != (len(gaussians),):
        raise StageError(
            f"labels: expected one part for each of the {len(gaussians)} Gaussians, got {np.shape(labels)}."
        )
    means = gaussians.means.astype(np.float64)
    spacing = continuum.spacing_m / frame.metres_per_unit
    carrier = _carrying_particle(means, labels, continuum, spacing=spacing, held_parts=held_parts, workers=workers)

    n = len(means)
    particles = np.zeros((n, NEIGHBOURS), np.int32)
    distances = np.zeros((n, NEIGHBOURS))
    piece_of_particle = _piece_numbers(continuum)
    piece_of_gaussian = piece_of_particle[carrier]
    for members, rows in _groups(piece_of_particle, piece_of_gaussian):
        distances[rows], particles[rows] = _nearest_of_sites(
            means[rows], continuum.positions, members, continuum.site, workers=workers
        )

    nearest = distances[:, 0] / spacing
    for group in _islands(means, labels, distances[:, 0], gaussians.opacities, spacing):
        anchor = group[distances[group, 0].argmin()]
        particles[group], distances[group] = particles[anchor], distances[anchor]
    weights = _weights(distances, spacing)
    itself = np.flatnonzero(continuum.gaussian_index >= 0)
    own = continuum.gaussian_index[itself]
    particles[own], weights[own], nearest[own] = itself[:, None], np.eye(NEIGHBOURS)[0], 0.0
    arm = means - np.einsum("nk,nka->na", weights, continuum.positions[particles])
    length = np.linalg.norm(arm, axis=1)
    arm *= np.minimum(1.0, ARM_REACH * spacing / np.maximum(length, 1e-300))[:, None]
    return Skin(
        particles=particles,
        weights=weights.astype(np.float32),
        rigidity=_smoothstep((nearest - AFFINE_REACH) / (RIGID_REACH - AFFINE_REACH)).astype(np.float32),
        arm=arm.astype(np.float32),
        distance_spacings=nearest.astype(np.float32),
        adopted=continuum.part[carrier] != labels,
    )


def _islands(
    means: NDArray[np.float64],
    labels: NDArray[np.int32],
    distance: NDArray[np.float64],
    opacities: NDArray[np.float32],
    spacing: float,
) -> list[NDArray[np.intp]]:
    """Groups of visible Gaussians of one part, beyond the rigid reach of any particle, that hang together."""
    far = np.flatnonzero((distance > RIGID_REACH * spacing) & (opacities > VISIBLE))
    if len(far) < 2:
        return []
    pairs = KDTree(means[far]).query_pairs(ISLAND_LINK * spacing, output_type="ndarray")
    pairs = pairs[labels[far[pairs[:, 0]]] == labels[far[pairs[:, 1]]]]
    graph = sparse.csr_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(far), len(far)))
    _, island = connected_components(graph, directed=False)
    order = np.argsort(island, kind="stable")
    groups = np.split(far[order], np.flatnonzero(np.diff(island[order])) + 1)
    return [group for group in groups if len(group) > 1]


def _carrying_particle(
    means: NDArray[np.float64],
    labels: NDArray[np.int32],
    continuum: Continuum,
    *,
    spacing: float,
    held_parts: Collection[int],
    workers: int,
) -> NDArray[np.intp]:
    """The particle whose part and piece carries each Gaussian: the nearest of its part, or of another if that fails."""
    carrier = np.zeros(len(means), np.intp)
    distance = np.full(len(means), np.inf)
    for members, rows in _groups(continuum.part, labels):
        found, index = _nearest(means[rows], continuum.positions, members, count=1, workers=workers)
        distance[rows], carrier[rows] = found[:, 0], index[:, 0]

    homeless = np.flatnonzero(np.isinf(distance))
    if len(homeless):
        everyone = np.arange(len(continuum))
        carrier[homeless] = _nearest(means[homeless], continuum.positions, everyone, count=1, workers=workers)[1][:, 0]

    far = np.flatnonzero(np.isfinite(distance) & (distance > AFFINE_REACH * spacing))
    free = np.flatnonzero(~np.isin(continuum.part, list(held_parts)))
    if len(far) and len(free):
        found, index = _nearest(means[far], continuum.positions, free, count=1, workers=workers)
        near = found[:, 0] < FOREIGN_REACH * spacing
        carrier[far[near]] = index[near, 0]
    return carrier


def _nearest(
    points: NDArray[np.float64],
    positions: NDArray[np.float64],
    members: NDArray[np.intp],
    *,
    count: int,
    workers: int,
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Distances and numbers of the ``count`` nearest of the particles ``members``, nearest first, ties by number.

    Where there are fewer members the last columns repeat the nearest one at an infinite distance (weight 0).
    """
    asked = min(count + _TIE_MARGIN, len(members))
    found, index = KDTree(positions[members]).query(points, k=asked, workers=workers)
    distance = np.reshape(found, (len(points), asked))
    particle = members[np.reshape(index, (len(points), asked))]
    order = np.lexsort((particle, distance), axis=1)[:, :count]
    distance = np.take_along_axis(distance, order, 1)
    particle = np.take_along_axis(particle, order, 1)
    missing = count - distance.shape[1]
    if missing > 0:
        distance = np.pad(distance, ((0, 0), (0, missing)), constant_values=np.inf)
        particle = np.concatenate([particle, np.repeat(particle[:, :1], missing, 1)], 1)
    return distance, particle.astype(np.int32)


def _nearest_of_sites(
    points: NDArray[np.float64],
    positions: NDArray[np.float64],
    members: NDArray[np.intp],
    site: NDArray[np.int32],
    *,
    workers: int,
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """As ``_nearest`` the 8 nearest of the particles ``members``, each of another site, [P]: the nearest one of it."""
    most = int(np.unique(site[members], return_counts=True)[1].max())
    if most == 1:
        return _nearest(points, positions, members, count=NEIGHBOURS, workers=workers)
    distances, particles = np.full((len(points), NEIGHBOURS), np.inf), np.zeros((len(points), NEIGHBOURS), np.int32)
    for start in range(0, len(points), _BLOCK):
        rows, asked = np.arange(start, min(start + _BLOCK, len(points))), 2 * NEIGHBOURS
        while len(rows):  # few Gaussians need more: those of stalks
            found, near = _nearest(points[rows], positions, members, count=asked, workers=workers)
            is_first = _is_first(site[near]) & np.isfinite(found)
            is_last_try = asked >= min(NEIGHBOURS * most, len(members))
            done = np.flatnonzero((is_first.sum(1) >= NEIGHBOURS) | is_last_try)
            chosen = np.argsort(~is_first[done], axis=1, kind="stable")[:, :NEIGHBOURS]
            present = np.take_along_axis(is_first[done], chosen, 1)
            nearest = np.where(present, np.take_along_axis(near[done], chosen, 1), near[done, :1])
            particles[rows[done]] = nearest
            distances[rows[done]] = np.where(present, np.take_along_axis(found[done], chosen, 1), np.inf)
            rows, asked = np.delete(rows, done), 3 * asked
    return distances, particles


def _is_first(values: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Where a row [n, k] has a value for the first time."""
    order = np.argsort(values, axis=1, kind="stable")
    ranked = np.take_along_axis(values, order, 1)
    new = np.ones(values.shape, bool)
    new[:, 1:] = ranked[:, 1:] != ranked[:, :-1]
    first = np.zeros(values.shape, bool)
    np.put_along_axis(first, order, new, 1)
    return first


def _weights(distances: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """Normalised exp(-0.7 (d/h)^2); beyond 3 spacings h grows with the distance, so that far neighbours still blend.

    A Gaussian kernel seen from far away picks the nearest particle alone, and two neighbouring floaters would follow
    two different particles.
    """
    nearest = distances[:, :1]
    width_squared = spacing**2 * np.maximum(1.0, nearest / (RIGID_REACH * spacing))
    with np.errstate(under="ignore"):
        weights = np.exp(-FALLOFF * (distances**2 - nearest**2) / width_squared)
    return weights / weights.sum(1, keepdims=True)


def _piece_numbers(continuum: Continuum) -> NDArray[np.int64]:
    """One number per particle that tells connected pieces of all parts apart, shape [P]."""
    pairs = np.stack([continuum.part, continuum.piece], 1)
    return np.unique(pairs, axis=0, return_inverse=True)[1].reshape(-1)


def _groups(of_particle: NDArray[Any], of_gaussian: NDArray[Any]) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """For each value that both have: the particles and the Gaussians of that value."""
    order = np.argsort(of_gaussian, kind="stable")
    values, starts = np.unique(of_gaussian[order], return_index=True)
    groups = []
    for value, rows in zip(values, np.split(order, starts[1:]), strict=True):
        members = np.flatnonzero(of_particle == value)
        if len(members):
            groups.append((members, rows))
    return groups


def _smoothstep(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """0 below 0, 1 above 1, smooth between."""
    t = np.clip(x, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)
