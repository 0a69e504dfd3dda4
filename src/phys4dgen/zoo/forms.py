"""The vocabulary of implicit solids: primitives, and ways to place, join, carve and shape them; metres, y up.

Distances after Quilez, "3D SDFs" (iquilezles.org); the smooth union is his quadratic polynomial one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import reduce

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from phys4dgen.zoo.implicit import Implicit
from phys4dgen.zoo.patch import Array

__all__ = [
    "ball",
    "blended",
    "carved",
    "ellipsoid",
    "hollow",
    "lathe",
    "lifted",
    "mirrored",
    "placed",
    "ring",
    "rod",
    "rounded_box",
    "shaped",
    "stretched",
    "turned_deg",
    "united",
]

LATHE_CELLS = 240
"""Resolution of a lathe's table along the longer side of its outline."""


def turned_deg(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Array:
    """The rotation about the fixed axes x, then y, then z; shape [3, 3]."""
    return Rotation.from_euler("xyz", [x, y, z], degrees=True).as_matrix()


def ball(radius_m: float, centre: ArrayLike = (0, 0, 0)) -> Implicit:
    """A ball."""
    c = np.asarray(centre, np.float64)
    return Implicit(lambda p: _length(p - c) - radius_m, c - radius_m, c + radius_m)


def ellipsoid(radii_m: ArrayLike, centre: ArrayLike = (0, 0, 0)) -> Implicit:
    """An ellipsoid; the distance is right to first order at the surface."""
    c, r = np.asarray(centre, np.float64), np.asarray(radii_m, np.float64)

    def distance(points: Array) -> Array:
        q = (points - c) / r
        level = _length(q)
        estimate = level * (level - 1) / np.maximum(_length(q / r), 1e-12)
        return np.maximum(estimate, -r.min())

    return Implicit(distance, c - r, c + r)


def rounded_box(half_m: ArrayLike, rounding_m: float, centre: ArrayLike = (0, 0, 0)) -> Implicit:
    """A box of half sides ``half_m`` whose edges have the radius ``rounding_m``."""
    c, half = np.asarray(centre, np.float64), np.asarray(half_m, np.float64)
    core = half - rounding_m

    def distance(points: Array) -> Array:
        q = np.abs(points - c) - core
        return _length(np.maximum(q, 0)) + np.minimum(_largest(q), 0) - rounding_m

    return Implicit(distance, c - half, c + half)


def rod(line: ArrayLike, radii_m: ArrayLike) -> Implicit:
    """Round segments of varying radius along a polyline, with rounded ends.

    Args:
        line: nodes, shape [M, 3].
        radii_m: one radius, or one per node.
    """
    nodes = np.asarray(line, np.float64)
    radii = np.broadcast_to(np.asarray(radii_m, np.float64), len(nodes))

    def distance(points: Array) -> Array:
        nearest = np.full(len(points), np.inf)
        for start, end, first, last in zip(nodes[:-1], nodes[1:], radii[:-1], radii[1:], strict=True):
            gap, edge = points - start, end - start
            along = np.clip(gap @ edge / (edge @ edge), 0, 1)
            np.minimum(nearest, _length(gap - along[:, None] * edge) - first - along * (last - first), out=nearest)
        return nearest

    reach = radii[:, None]
    return Implicit(distance, (nodes - reach).min(0), (nodes + reach).max(0))


def ring(radius_m: float, half_m: tuple[float, float], rounding_m: float) -> Implicit:
    """A ring about the y axis whose cross-section is a rounded rectangle.

    Args:
        radius_m: of the middle of the cross-section.
        half_m: half width across the radius and half height.
        rounding_m: of the cross-section's corners; equal half sides and rounding make a torus.
    """
    core = np.array(half_m) - rounding_m

    def distance(points: Array) -> Array:
        q = np.abs(np.stack([np.hypot(points[:, 0], points[:, 2]) - radius_m, points[:, 1]], 1)) - core
        return _length(np.maximum(q, 0)) + np.minimum(_largest(q), 0) - rounding_m

    reach = np.array([radius_m + half_m[0], half_m[1], radius_m + half_m[0]])
    return Implicit(distance, -reach, reach)


def lathe(profile: Array) -> Implicit:
    """The solid that an outline sweeps about the y axis; its distance is read from a table of ``LATHE_CELLS`` cells.

    Args:
        profile: closed outline (radius, height), radius >= 0, shape [M, 2].
    """
    reach, low, high = profile[:, 0].max(), profile[:, 1].min(), profile[:, 1].max()
    cell = max(reach, high - low) / LATHE_CELLS
    counts = np.ceil([reach / cell, (high - low) / cell]).astype(int) + 3
    origin = np.array([0.0, low - cell])
    nodes = origin + np.argwhere(np.ones(counts)) * cell
    table = _outline_distance(profile, nodes).reshape(counts)

    def distance(points: Array) -> Array:
        q = (np.stack([np.hypot(points[:, 0], points[:, 2]), points[:, 1]], 1) - origin) / cell
        held = np.clip(q, 0, counts - 1.001)
        i, j = held.astype(int).T
        s, t = (held - np.floor(held)).T
        lower = (1 - s) * table[i, j] + s * table[i + 1, j]
        upper = (1 - s) * table[i, j + 1] + s * table[i + 1, j + 1]
        return (1 - t) * lower + t * upper + cell * _length(q - held)  # outside the table: at most the detour

    return Implicit(distance, np.array([-reach, low, -reach]), np.array([reach, high, reach]))


def placed(solid: Implicit, origin: ArrayLike = (0, 0, 0), rotation: Array | None = None) -> Implicit:
    """The solid turned about the origin, then moved to ``origin``; columns of ``rotation`` are its new axes."""
    o = np.asarray(origin, np.float64)
    turn = np.eye(3) if rotation is None else rotation
    box = np.stack([solid.lower, solid.upper])
    corners = np.stack(np.meshgrid(*box.T, indexing="ij"), -1).reshape(-1, 3) @ turn.T + o
    return replace(solid, distance=lambda p: solid.distance((p - o) @ turn), lower=corners.min(0), upper=corners.max(0))


def stretched(solid: Implicit, factors: ArrayLike) -> Implicit:
    """The solid stretched along the axes; distances come out too short, never too long."""
    f = np.asarray(factors, np.float64)
    return replace(
        solid, distance=lambda p: solid.distance(p / f) * f.min(), lower=solid.lower * f, upper=solid.upper * f
    )


def united(*solids: Implicit) -> Implicit:
    """All of the solids."""
    return replace(
        solids[0],
        distance=lambda p: reduce(np.minimum, (solid.distance(p) for solid in solids)),
        lower=np.min([solid.lower for solid in solids], axis=0),
        upper=np.max([solid.upper for solid in solids], axis=0),
    )


def blended(radius_m: float, *solids: Implicit) -> Implicit:
    """All of the solids with a fillet of about ``radius_m`` where they meet."""
    whole = united(*solids)
    return replace(
        whole,
        distance=lambda p: reduce(lambda a, b: _fillet(a, b, radius_m), (solid.distance(p) for solid in solids)),
        lower=whole.lower - radius_m / 4,
        upper=whole.upper + radius_m / 4,
    )


def carved(solid: Implicit, *tools: Implicit, radius_m: float = 0.0) -> Implicit:
    """The solid without the tools; ``radius_m`` rounds the edge that they leave."""

    def distance(points: Array) -> Array:
        value = solid.distance(points)
        for tool in tools:
            other = -tool.distance(points)
            value = np.maximum(value, other) if radius_m == 0 else -_fillet(-value, -other, radius_m)
        return value

    return replace(solid, distance=distance)


def shaped(solid: Implicit, swell: Callable[[Array], Array], *, reach_m: float) -> Implicit:
    """The solid with its surface moved outwards by ``swell`` (points [N, 3] -> metres [N], at most ``reach_m``)."""
    return replace(
        solid,
        distance=lambda p: solid.distance(p) - swell(p),
        lower=solid.lower - reach_m,
        upper=solid.upper + reach_m,
    )


def lifted(solid: Implicit, lift: Callable[[Array, Array], Array], *, reach_m: float) -> Implicit:
    """The solid with its points raised by ``lift(x, z)`` (metres, at most ``reach_m`` up or down); the volume stays."""

    def distance(points: Array) -> Array:
        rise = lift(points[:, 0], points[:, 2])
        return solid.distance(np.stack([points[:, 0], points[:, 1] - rise, points[:, 2]], 1))

    reach = np.array([0.0, reach_m, 0.0])
    return replace(solid, distance=distance, lower=solid.lower - reach, upper=solid.upper + reach)


def mirrored(solid: Implicit) -> Implicit:
    """The solid of the quarter x, z >= 0 in all four quarters."""
    fold = np.array([True, False, True])
    return replace(
        solid,
        distance=lambda p: solid.distance(np.where(fold, np.abs(p), p)),
        lower=np.where(fold, -solid.upper, solid.lower),
    )


def hollow(solid: Implicit, wall_m: float) -> Implicit:
    """A closed shell: the solid's outer ``wall_m``, empty inside."""
    return replace(solid, wall_m=wall_m)


def _outline_distance(outline: Array, points: Array) -> Array:
    """Signed distance [N] of points [N, 2] to a closed outline [M, 2], both (radius, height).

    Edges on the axis bound nothing.
    """
    nearest = np.full(len(points), np.inf)
    odd = np.zeros(len(points), bool)
    for start, end in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        edge, gap = end - start, points - start
        if start[1] != end[1]:
            crosses = (points[:, 1] >= min(start[1], end[1])) & (points[:, 1] < max(start[1], end[1]))
            odd ^= crosses & (gap[:, 0] < gap[:, 1] * edge[0] / edge[1])
        if start[0] > 0 or end[0] > 0:
            along = np.clip(gap @ edge / max(edge @ edge, 1e-18), 0, 1)
            np.minimum(nearest, _length(gap - along[:, None] * edge), out=nearest)
    return np.where(odd, -nearest, nearest)


def _fillet(first: Array, second: Array, radius_m: float) -> Array:
    """The smaller of two distances [N], less where both are small: a fillet in the crease."""
    share = np.maximum(radius_m - np.abs(first - second), 0) / radius_m
    return np.minimum(first, second) - share * share * (radius_m / 4)


def _largest(vectors: Array) -> Array:
    """The largest component of each vector [N, 2] or [N, 3]: much quicker than ``max`` along so short an axis."""
    return reduce(np.maximum, vectors.T)


def _length(vectors: Array) -> Array:
    return np.sqrt(np.einsum("nk,nk->n", vectors, vectors))
