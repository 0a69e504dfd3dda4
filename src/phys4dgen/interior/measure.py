"""What the Gaussians say about thin parts: how much of a site they cover, where the middle runs, how thick it is.

Thickness comes from the Gaussians' centres along the local normal. Captures put them on both faces, through the
thickness, or in a mixture; the second moment alone cannot tell a sheet of thickness t filled evenly (t^2 / 12) from
two faces (t^2 / 4), but the fourth moment can: with a share a on the faces, kurtosis = (a + (1 - a) / 5) /
(a + (1 - a) / 3)^2, between 1 and 1.8. Likewise round rods: shells and filled discs differ in their quartiles.
MOTION.md (technique 4) says when such a reading may be trusted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from phys4dgen.interior.sites import Sites

__all__ = [
    "GaussianCloud",
    "RodReading",
    "covered_share",
    "measure_rods",
    "measure_sheets",
    "sheet_thickness_from_moments",
]

_NEIGHBORS = 192
_ROD_NEIGHBORS = 384  # enough to reach all round a densely captured stem
_MIN_NEIGHBORS = 24
_MAX_FLATNESS = 0.1
_STOUT_RADIUS = 2.0
_STOUT_FLATNESS = 0.25
_SOLID_OPACITY = 0.3
_SHELL_RATIO = 0.85  # of the quartiles of the radius: a shell as captures scatter it
_RIBBON_RATIO = 0.15  # of the squared diameters: about 2.6 times as wide as thick
_FACE_SHARES = np.linspace(0, 1, 101)
_KURTOSIS = (_FACE_SHARES + (1 - _FACE_SHARES) / 5) / (_FACE_SHARES + (1 - _FACE_SHARES) / 3) ** 2


@dataclass(frozen=True, eq=False)
class GaussianCloud:
    """The visible Gaussians in upright axes, lengths in voxels.

    Attributes:
        means: [M, 3].
        covariances: [M, 3, 3].
        opacities: [M].
    """

    means: NDArray[np.float64]
    covariances: NDArray[np.float64]
    opacities: NDArray[np.float64]


def covered_share(sites: Sites, cloud: GaussianCloud) -> NDArray[np.float64]:
    """Share of each sheet site's cell over which the Gaussians are opaque when seen along the normal, [S].

    The cell is probed at 3 x 3 points; a point is covered where 1 - prod(1 - alpha_k) > 0.5 over the Gaussians
    within 1.5 voxels of the surface, each integrated along the normal.
    """
    if len(sites) == 0:
        return np.zeros(0)
    tree = KDTree(cloud.means)
    n = sites.direction
    helper = np.where(np.abs(n[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]])
    u = np.cross(n, helper)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    basis = np.stack([u, np.cross(n, u)], 1)  # [S, 2, 3]
    k = min(32, len(cloud.means))
    covered = np.zeros(len(sites))
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            probe = sites.position + (i * sites.edge_a + j * sites.edge_b) / 3
            _, near = tree.query(probe, k=k, workers=-1)
            near = near.reshape(len(probe), k)
            apart = probe[:, None] - cloud.means[near]  # [S, k, 3]
            flat = np.einsum("sab,skbc,sdc->skad", basis, cloud.covariances[near], basis)
            d = np.einsum("sab,skb->ska", basis, apart)
            det = flat[..., 0, 0] * flat[..., 1, 1] - flat[..., 0, 1] ** 2
            q = flat[..., 1, 1] * d[..., 0] ** 2 + flat[..., 0, 0] * d[..., 1] ** 2
            q = (q - 2 * flat[..., 0, 1] * d[..., 0] * d[..., 1]) / np.maximum(det, 1e-12)
            alpha = np.minimum(cloud.opacities[near] * np.exp(-0.5 * q), 0.99)
            alpha[np.abs(np.einsum("sb,skb->sk", n, apart)) > 1.5] = 0
            covered += 1 - np.prod(1 - alpha, axis=1) > 0.5
    return covered / 9


def is_stout(points: NDArray[np.float64], cloud: GaussianCloud) -> NDArray[np.bool_]:
    """Whether the Gaussians within two voxels of each point [T, 3] are many and certainly do not lie in a plane."""
    solid = cloud.opacities > _SOLID_OPACITY
    if len(points) == 0 or solid.sum() < _MIN_NEIGHBORS:
        return np.zeros(len(points), bool)
    means = cloud.means[solid]
    k = min(_NEIGHBORS, len(means))
    distance, near = KDTree(means).query(points, k=k, distance_upper_bound=_STOUT_RADIUS, workers=-1)
    present = np.isfinite(distance)
    count = present.sum(1)
    weight = present / np.maximum(count, 1)[:, None]
    around = means[np.where(present, near, 0)]
    spread = around - np.einsum("tk,tkb->tb", weight, around)[:, None]
    values = np.linalg.eigvalsh(np.einsum("tk,tka,tkb->tab", weight, spread, spread))
    return (count >= _MIN_NEIGHBORS) & (values[:, 0] > _STOUT_FLATNESS * values[:, 1])


def measure_sheets(
    sites: Sites, cloud: GaussianCloud, *, radius: float
) -> tuple[Sites, NDArray[np.float64], NDArray[np.bool_]]:
    """Move sites to the middle of the Gaussians, and read the thickness there.

    Args:
        sites: sheet sites.
        cloud: Gaussians.
        radius: of the neighbourhood, in voxels (0.016 of the height).

    Returns:
        The moved sites, the thickness in voxels (NaN where nothing could be read) and whether it may be trusted.
    """
    solid = cloud.opacities > _SOLID_OPACITY
    if len(sites) == 0 or solid.sum() < _MIN_NEIGHBORS:
        return sites, np.full(len(sites), np.nan), np.zeros(len(sites), bool)
    means = cloud.means[solid]
    k = min(_NEIGHBORS, len(means))
    distance, near = KDTree(means).query(sites.position, k=k, distance_upper_bound=radius, workers=-1)
    present = np.isfinite(distance)
    count = present.sum(1)
    points = means[np.where(present, near, 0)] - sites.position[:, None]  # [S, k, 3]
    weight = present / np.maximum(count, 1)[:, None]
    center = np.einsum("sk,skb->sb", weight, points)
    spread = points - center[:, None]
    second = np.einsum("sk,ska,skb->sab", weight, spread, spread)
    values, vectors = np.linalg.eigh(second)
    trusted = (count >= _MIN_NEIGHBORS) & (values[:, 0] < _MAX_FLATNESS * np.maximum(values[:, 1], 1e-12))
    # A leaf is curved: offsets are taken from a quadratic surface over the tangent plane, not from the plane.
    normal = vectors[:, :, 0]
    u = np.einsum("sb,skb->sk", vectors[:, :, 2], spread)
    v = np.einsum("sb,skb->sk", vectors[:, :, 1], spread)
    w = np.einsum("sb,skb->sk", normal, spread)
    offsets = w - _quadratic_fit(u, v, w, weight)
    thickness = sheet_thickness_from_moments(offsets, weight)
    thickness = np.where(trusted, thickness, np.nan)

    aligned = np.abs((normal * sites.direction).sum(1)) > 0.7
    good = trusted & aligned
    normal *= np.where((normal * sites.direction).sum(1) < 0, -1, 1)[:, None]
    direction = np.where(good[:, None], normal, sites.direction)
    shift = np.clip((center * direction).sum(1), -1, 1) * good
    moved = replace(sites, position=sites.position + shift[:, None] * direction, direction=direction)
    return moved, thickness, good


def sheet_thickness_from_moments(offsets: NDArray[np.float64], weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Thickness of sheets from offsets along the normal, [S, k] -> [S]; ``weight`` rows sum to one.

    Solves kurtosis(a) for the share a on the faces, then t = 2 sqrt(m2 / (a + (1 - a) / 3)).
    """
    m2 = np.maximum((weight * offsets**2).sum(1), 1e-30)
    # Single stray Gaussians would dominate the fourth moment.
    inside = weight * (offsets**2 <= 6 * m2[:, None])
    inside = inside / np.maximum(inside.sum(1, keepdims=True), 1e-30)
    m2 = np.maximum((inside * offsets**2).sum(1), 1e-30)
    kurtosis = (inside * (offsets / np.sqrt(m2)[:, None]) ** 4).sum(1)
    share = np.interp(kurtosis, _KURTOSIS[::-1], _FACE_SHARES[::-1])
    return 2 * np.sqrt(m2 / (share + (1 - share) / 3))


@dataclass(frozen=True, eq=False)
class RodReading:
    """Cross-sections of rods, lengths in voxels.

    Attributes:
        sites: moved to the middle of the Gaussians.
        width: larger diameter, NaN where nothing could be read, [S].
        across: unit vector of the larger diameter, [S, 3].
        is_ribbon: the cross-section is much wider than thick (a blade of grass), [S].
        trusted: enough Gaussians were there, [S].
    """

    sites: Sites
    width: NDArray[np.float64]
    across: NDArray[np.float64]
    is_ribbon: NDArray[np.bool_]
    trusted: NDArray[np.bool_]


def measure_rods(sites: Sites, section: NDArray[np.float64], cloud: GaussianCloud) -> RodReading:
    """Move sites to the middle of the Gaussians around them and read the rod's cross-section.

    Sparse captures draw a blade of grass with a few long Gaussians, so their own extent counts beside the scatter of
    their centres: an opaque Gaussian is seen to about 1.1 standard deviations on either side. Only Gaussians inside
    the rod's own voxels count, and long ones only if they run along it: the next blade is a few voxels away.

    Args:
        sites: rod sites.
        section: cross-section of the rod's voxels, voxels squared, [S].
        cloud: Gaussians.
    """
    s = len(sites)
    solid = cloud.opacities > _SOLID_OPACITY
    if s == 0 or solid.sum() < _MIN_NEIGHBORS:
        return RodReading(sites, np.full(s, np.nan), np.zeros((s, 3)), np.zeros(s, bool), np.zeros(s, bool))
    means, covariances = cloud.means[solid], cloud.covariances[solid]
    values, vectors = np.linalg.eigh(covariances)
    long = values[:, 2] > 4 * values[:, 1]
    k = min(_ROD_NEIGHBORS, len(means))
    tree = KDTree(means)
    axis = sites.direction
    position = sites.position.copy()
    reach = np.sqrt(section / np.pi)[:, None] + 0.25
    onto = np.eye(3) - axis[:, :, None] * axis[:, None, :]
    for last in (False, True):  # the second reading starts from the middle that the first one found
        distance, near = tree.query(position, k=k, distance_upper_bound=4.0, workers=-1)
        near = np.where(np.isfinite(distance), near, 0)
        points = means[near] - position[:, None]
        along = np.einsum("sb,skb->sk", axis, points)
        across = points - along[..., None] * axis[:, None]
        aligned = np.abs(np.einsum("sb,skb->sk", axis, vectors[near, :, 2])) > 0.8
        overlap = np.exp(-0.5 * along**2 / np.maximum(values[near, 2] * aligned, 0.5))
        present = np.isfinite(distance) & (np.linalg.norm(across, axis=2) < reach) & (aligned | ~long[near])
        weight = present * overlap * (overlap > 0.3)
        total = weight.sum(1)
        weight = weight / np.maximum(total, 1e-12)[:, None]
        center = np.einsum("sk,skb->sb", weight, across)
        if not last:
            position = position + np.clip(center, -1, 1)
    count = (weight > 0).sum(1)
    trusted = count >= 2
    spread = across - center[:, None]
    scatter = np.einsum("sk,ska,skb->sab", weight, spread, spread)
    own = np.einsum("sk,skab->sab", weight, covariances[near])
    squares, directions = np.linalg.eigh(onto @ (12 * scatter + 4.8 * own) @ onto)
    is_ribbon = trusted & (squares[:, 1] < _RIBBON_RATIO * squares[:, 2])

    radius = np.where(weight > 0, np.linalg.norm(spread, axis=2), np.nan)
    radius[count == 0] = 0
    low, middle, high = np.nanquantile(radius, [0.25, 0.5, 0.75], axis=1)
    # Shell: all quartiles equal R. Filled disc: 0.5, 0.707, 0.866 of R.
    shell = np.clip((low / np.maximum(high, 1e-12) - 0.577) / (_SHELL_RATIO - 0.577), 0, 1)
    # Round and sparse: a shell scatters its centres by R^2 / 2 along each axis, and is seen to 1.1 sigma beyond them.
    round_squares = np.trace(onto @ (8 * scatter + 4.8 * own) @ onto, axis1=1, axis2=2) / 2
    sparse_width = np.sqrt(round_squares)
    round_width = np.where(count >= 12, 2 * middle / (0.707 + 0.293 * shell), sparse_width)
    width = np.where(is_ribbon, np.sqrt(squares[:, 2]), round_width)
    moved = replace(sites, position=position)
    return RodReading(moved, np.where(trusted, width, np.nan), directions[:, :, 2], is_ribbon, trusted)


def _quadratic_fit(
    u: NDArray[np.float64], v: NDArray[np.float64], w: NDArray[np.float64], weight: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Values at (u, v) of the weighted least-squares surface w = c0 + c1 u + c2 v + c3 u^2 + c4 u v + c5 v^2."""
    basis = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], -1)  # [S, k, 6]
    normal_matrix = np.einsum("sk,ska,skb->sab", weight, basis, basis)
    scale = np.trace(normal_matrix, axis1=1, axis2=2)[:, None, None]
    normal_matrix = normal_matrix + 1e-9 * np.maximum(scale, 1e-12) * np.eye(6)
    right = np.einsum("sk,ska,sk->sa", weight, basis, w)
    coefficients = np.linalg.solve(normal_matrix, right[..., None])[..., 0]
    return np.einsum("ska,sa->sk", basis, coefficients)
