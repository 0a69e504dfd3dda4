"""Analytic shapes drawn as Gaussians on their surface: what the inside of an object must come out as."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from phys4dgen.types import Gaussians

Array = NDArray[np.float64]
Distance = Callable[[Array], Array]
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Shape:
    """A solid inside the cube of side 2 around the origin, z up.

    Attributes:
        distance: signed distance of points [N, 3] to the surface, negative inside (a bound is enough), [N].
        volume: exact, or by quadrature on 256 points a side.
    """

    distance: Distance
    volume: float

    def gaussians(self, spacing: float, *, seed: int = 0) -> Gaussians:
        """Flat Gaussians all over the surface, one for every ``spacing`` squared of it."""
        points = lattice(spacing) + 0.37 * spacing  # no face of a shape lies between two layers
        points = points[np.abs(self.distance(points)) < 0.5 * spacing]
        rng = np.random.default_rng(seed)
        for _ in range(3):
            normal = gradient(self.distance, points)
            points = points - self.distance(points)[:, None] * normal
        side = np.cross(normal, rng.normal(size=points.shape))
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        points = points + 0.2 * spacing * (rng.uniform(-1, 1, (len(points), 1)) * side)
        axes = np.stack([side, np.cross(normal, side), normal], -1)
        n = len(points)
        return Gaussians(
            means=points.astype(np.float32),
            quats_wxyz=Rotation.from_matrix(axes).as_quat(canonical=True)[:, [3, 0, 1, 2]].astype(np.float32),
            scales=np.tile(np.array([0.7, 0.7, 0.05], np.float32) * np.float32(spacing), (n, 1)),
            opacities=np.full(n, 0.95, np.float32),
            sh=np.zeros((n, 1, 3), np.float32),
        )


def lattice(step: float) -> Array:
    """Centres of cubic cells of side ``step`` that fill the cube of side 2 around the origin, [N, 3]."""
    count = round(2 / step)
    axis = (np.arange(count) + 0.5 - count / 2) * step
    return np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)


def occupancy(positions: Array, volumes: Array, shape: Shape, *, spacing: float) -> float:
    """IoU on a grid of 32 cells a side: cells that particles fill by half, cells that the shape fills by half.

    A particle is a cube of side ``spacing``, not a point: a few of them to a cell would fill it by chance.
    """
    step, fine = 2 / 32, 8
    corners = (np.stack(np.meshgrid(*[np.arange(4)] * 3, indexing="ij"), -1).reshape(-1, 3) - 1.5) / 4 * spacing
    positions = (positions[:, None] + corners).reshape(-1, 3)
    volumes = np.repeat(volumes / len(corners), len(corners))
    cell = np.clip(np.floor((positions + 1) / step).astype(int), 0, 31)
    filled = np.bincount(np.ravel_multi_index(tuple(cell.T), (32,) * 3), volumes, minlength=32**3) / step**3
    inside = (shape.distance(lattice(step / fine)) < 0).reshape(32, fine, 32, fine, 32, fine).mean((1, 3, 5)).ravel()
    return float(((filled >= 0.5) & (inside >= 0.5)).sum() / ((filled >= 0.5) | (inside >= 0.5)).sum())


def gradient(distance: Distance, points: Array) -> Array:
    """Unit gradient of a distance by central differences, [N, 3]."""
    h = 1e-4
    slope = np.stack([distance(points + h * e) - distance(points - h * e) for e in np.eye(3)], 1)
    return slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-12)


def measured(distance: Distance) -> Shape:
    """A shape whose volume is found by quadrature, smoothed over one cell at the surface."""
    step = 1 / 128
    share = np.clip(0.5 - distance(lattice(step)) / step, 0, 1)
    return Shape(distance, float(share.sum() * step**3))


def sphere(radius: float = 0.8) -> Shape:
    """A ball."""
    return Shape(_ball(np.zeros(3), radius), 4 / 3 * np.pi * radius**3)


def box(half: tuple[float, float, float] = (0.8, 0.5, 0.6)) -> Shape:
    """A box with sharp edges."""
    size = np.array(half)

    def distance(x: Array) -> Array:
        beyond = np.abs(x) - size
        return np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(1), 0)

    return Shape(distance, float(8 * size.prod()))


def torus(ring: float = 0.6, tube: float = 0.25) -> Shape:
    """A lying ring."""

    def distance(x: Array) -> Array:
        return np.hypot(np.hypot(x[:, 0], x[:, 1]) - ring, x[:, 2]) - tube

    return Shape(distance, 2 * np.pi**2 * ring * tube**2)


def cup(radius: float = 0.6, height: float = 1.4, wall: float = 0.1) -> Shape:
    """An open vessel with a floor."""
    outer = _cylinder(radius, -height / 2, height / 2)
    inner = _cylinder(radius - wall, -height / 2 + wall, height)
    volume = np.pi * (radius**2 * height - (radius - wall) ** 2 * (height - wall))
    return Shape(lambda x: np.maximum(outer(x), -inner(x)), float(volume))


def closed_can(radius: float = 0.5, height: float = 1.2) -> Shape:
    """A cylinder: what a closed tin looks like from outside."""
    return Shape(_cylinder(radius, -height / 2, height / 2), float(np.pi * radius**2 * height))


def arch(thickness: float = 0.08) -> Shape:
    """A dome that stands on the ground, open below."""
    outer, inner = _ball(np.array([0, 0, -0.5]), 0.8), _ball(np.array([0, 0, -0.5]), 0.8 - thickness)
    return measured(lambda x: np.maximum.reduce([outer(x), -inner(x), -(x[:, 2] + 0.5)]))


def snowman() -> Shape:
    """Three balls on each other."""
    balls = [_ball(np.array([0, 0, z]), r) for z, r in ((-0.5, 0.45), (0.15, 0.34), (0.65, 0.24))]
    return measured(lambda x: np.minimum.reduce([ball(x) for ball in balls]))


def stem_and_bulb(radius: float = 0.08) -> Shape:
    """A ball with a rod on it."""
    bulb, stem = _ball(np.array([0, 0, -0.5]), 0.35), _cylinder(radius, -0.5, 0.85)
    return measured(lambda x: np.minimum(bulb(x), stem(x)))


SHAPES: Mapping[str, Callable[[], Shape]] = {
    "sphere": sphere,
    "box": box,
    "torus": torus,
    "cup": cup,
    "snowman": snowman,
    "stem and bulb": stem_and_bulb,
}


def _ball(center: Array, radius: float) -> Distance:
    return lambda x: np.linalg.norm(x - center, axis=1) - radius


def _cylinder(radius: float, low: float, high: float) -> Distance:
    def distance(x: Array) -> Array:
        beyond = np.stack([np.hypot(x[:, 0], x[:, 1]) - radius, np.maximum(low - x[:, 2], x[:, 2] - high)], 1)
        return np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(1), 0)

    return distance
