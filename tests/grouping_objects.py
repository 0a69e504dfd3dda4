"""Small synthetic objects with known parts: Gaussians scattered over surfaces, with noise of colour and of place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phys4dgen.types import SH_C0, Gaussians


def from_points(points: NDArray[np.float64], rgb: NDArray[np.float64], *, size: float, seed: int) -> Gaussians:
    """Round Gaussians of standard deviation ``size``, mostly opaque."""
    rng = np.random.default_rng(seed)
    n = len(points)
    quats = rng.normal(size=(n, 4))
    return Gaussians(
        means=points.astype(np.float32),
        quats_wxyz=(quats / np.linalg.norm(quats, axis=1, keepdims=True)).astype(np.float32),
        scales=np.full((n, 3), size, np.float32),
        opacities=rng.uniform(0.5, 0.95, n).astype(np.float32),
        sh=((np.clip(rgb, 0.02, 0.98) - 0.5) / SH_C0).astype(np.float32)[:, None],
    )


def ring(n: int, radius: tuple[float, float], z: tuple[float, float], rng: np.random.Generator) -> NDArray[np.float64]:
    """Points on the side of a cone frustum about z, from the lower radius and height to the upper ones."""
    t, turn = rng.uniform(size=n), rng.uniform(0, 2 * np.pi, n)
    r = radius[0] + t * (radius[1] - radius[0])
    return np.stack([r * np.cos(turn), r * np.sin(turn), z[0] + t * (z[1] - z[0])], 1)


def disc(n: int, radius: float, z: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Points on a horizontal disc."""
    r, turn = radius * np.sqrt(rng.uniform(size=n)), rng.uniform(0, 2 * np.pi, n)
    return np.stack([r * np.cos(turn), r * np.sin(turn), np.full(n, z)], 1)


def leaf(n: int, turn: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Points on a blade that rises outwards from the middle of the pot."""
    along, across = rng.uniform(size=n), rng.uniform(-1, 1, n)
    width = 0.09 * np.sin(np.pi * np.clip(along, 0.05, 1)) ** 0.5
    out, side = 0.05 + 0.4 * along, across * width
    x, y = out * np.cos(turn) - side * np.sin(turn), out * np.sin(turn) + side * np.cos(turn)
    return np.stack([x, y, 0.32 + 0.6 * along - 0.25 * along**2], 1)


def potted_plant(*, seed: int = 0) -> tuple[Gaussians, NDArray[np.int32]]:
    """White pot (0), dark soil (1) and green leaves (2); z is up, 5,720 Gaussians."""
    rng = np.random.default_rng(seed)
    pieces = [
        (0, (0.85, 0.84, 0.8), ring(2200, (0.18, 0.25), (0.0, 0.36), rng)),
        (0, (0.85, 0.84, 0.8), disc(600, 0.18, 0.0, rng)),
        (1, (0.16, 0.12, 0.1), disc(1000, 0.22, 0.3, rng)),
        *((2, (0.25, 0.5, 0.2), leaf(320, turn, rng)) for turn in np.linspace(0, 2 * np.pi, 7)[:-1]),
    ]
    points = np.concatenate([p for _, _, p in pieces])
    labels = np.concatenate([np.full(len(p), part) for part, _, p in pieces]).astype(np.int32)
    rgb = np.concatenate([np.tile(color, (len(p), 1)) for _, color, p in pieces])
    light = 0.85 + 0.3 * (points[:, :1] + 0.4)  # one side is lit, as in every capture
    rgb = rgb * light + rng.normal(0, 0.04, points.shape)
    points = points + rng.normal(0, 0.002, points.shape)
    order = rng.permutation(len(points))
    return from_points(points[order], rgb[order], size=0.012, seed=seed), labels[order]


def shaded_ball(*, seed: int = 0) -> Gaussians:
    """One material, lit from one side and dark on the other."""
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=(4000, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    light = 0.45 + 0.55 * np.clip(normal @ [0.6, 0.0, 0.8], 0, 1)
    rgb = np.array([0.75, 0.7, 0.62]) * light[:, None] + rng.normal(0, 0.03, normal.shape)
    return from_points(normal * 0.5, rgb, size=0.02, seed=seed)


def ball(center: tuple[float, float, float], radius: float, n: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Points on a sphere."""
    normal = rng.normal(size=(n, 3))
    return radius * normal / np.linalg.norm(normal, axis=1, keepdims=True) + center


def ball_on_ball(
    lower_rgb: tuple[float, float, float], upper_rgb: tuple[float, float, float], *, seed: int = 0
) -> tuple[Gaussians, NDArray[np.int32]]:
    """A smaller ball (1) pressed into a larger one (0), each of one colour under a slanting light."""
    rng = np.random.default_rng(seed)
    centers, radii = np.array([[0, 0, 0], [0, 0, 0.72]]), (0.5, 0.36)
    points, labels = [], []
    for number, (center, radius) in enumerate(zip(centers, radii, strict=True)):
        own = ball(tuple(center), radius, 12_000, rng)
        outside = np.linalg.norm(own - centers[1 - number], axis=1) > radii[1 - number]
        points.append(own[outside])
        labels.append(np.full(outside.sum(), number, np.int32))
    place, label = np.concatenate(points), np.concatenate(labels)
    normal = (place - centers[label]) / np.asarray(radii)[label][:, None]
    light = 0.6 + 0.4 * np.clip(normal @ [0.6, 0.0, 0.8], 0, 1)
    rgb = np.array([lower_rgb, upper_rgb])[label] * light[:, None] + rng.normal(0, 0.03, place.shape)
    return from_points(place + rng.normal(0, 0.002, place.shape), rgb, size=0.01, seed=seed), label


def painted_ball(
    lower_rgb: tuple[float, float, float], upper_rgb: tuple[float, float, float], *, seed: int = 0
) -> Gaussians:
    """One ball, its upper third painted."""
    rng = np.random.default_rng(seed)
    place = ball((0, 0, 0), 0.5, 20_000, rng)
    light = 0.6 + 0.4 * np.clip(2 * place @ [0.6, 0.0, 0.8], 0, 1)
    rgb = np.where(place[:, 2:] > 0.17, upper_rgb, lower_rgb) * light[:, None] + rng.normal(0, 0.03, place.shape)
    return from_points(place + rng.normal(0, 0.002, place.shape), rgb, size=0.01, seed=seed)
