"""Curved sheets of constant thickness with a tapering outline: leaves and petals."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from phys4dgen.zoo.patch import Array, Patch, joined, ragged_rows, staggered

__all__ = ["Blade"]

OVERLAP = 0.60
"""Standard deviation of a Gaussian in units of the spacing: neighbours overlap into a closed surface."""


@dataclass(frozen=True, eq=False)
class Blade:
    """A sheet around the mid-surface Q(u, x) = C(u) + x S(u) + Z(u, x) N(u), |x| <= w(u), 0 <= u <= 1; metres.

    C is a cubic Bezier midrib in the plane of ``outward`` and ``up`` that starts at ``elevation_start_deg`` and ends
    at ``elevation_end_deg`` above ``outward``; S and N are its side and normal, turned about the midrib by ``roll``.
    The outline is w(u) = half_width * u^base_power (1 - u)^tip_power (scaled to a maximum of 1) + a stalk.

    Attributes:
        origin: where the midrib starts, shape [3].
        outward: unit vector, shape [3].
        up: unit vector perpendicular to ``outward``, on the upper face's side, shape [3].
        length_m: of the midrib (its control polygon).
        half_width_m: largest half width.
        thickness_m: of the sheet.
        base_power: below 1 the base is round, above it is a wedge.
        tip_power: below 1 the tip is round, above it is drawn out.
        base_half_width_m: half width where the blade is attached.
        elevation_start_deg: at the base.
        elevation_end_deg: at the tip.
        roll_start_deg: turn about the midrib at the base.
        roll_end_deg: turn about the midrib at the tip.
        fold: slope of the two halves against the midrib (a keel).
        cup_per_m: curvature across the blade.
        ripple: amplitude of the waves of the margin relative to ``half_width_m``.
        ripple_waves: number of waves along the blade.
        ripple_phase: radians.
    """

    origin: Array
    outward: Array
    up: Array
    length_m: float
    half_width_m: float
    thickness_m: float
    base_power: float
    tip_power: float
    base_half_width_m: float
    elevation_start_deg: float
    elevation_end_deg: float
    roll_start_deg: float = 0.0
    roll_end_deg: float = 0.0
    fold: float = 0.0
    cup_per_m: float = 0.0
    ripple: float = 0.0
    ripple_waves: float = 3.0
    ripple_phase: float = 0.0

    def half_width(self, u: Array) -> Array:
        """Half width w(u) in metres."""
        a, b = self.base_power, self.tip_power
        peak = a / (a + b)
        u = np.clip(u, 0.0, 1.0)
        shape = u**a * (1 - u) ** b / (peak**a * (1 - peak) ** b)
        return self.half_width_m * shape + self.base_half_width_m * (1 - u) ** 4

    def midrib(self, u: Array) -> tuple[Array, Array, Array, Array]:
        """Centre, unit tangent, side and upper normal of the midrib at ``u`` [N]; four arrays [N, 3]."""
        angles = np.deg2rad(
            [
                self.elevation_start_deg,
                0.5 * (self.elevation_start_deg + self.elevation_end_deg),
                self.elevation_end_deg,
            ]
        )
        legs = self.length_m / 3 * (np.cos(angles)[:, None] * self.outward + np.sin(angles)[:, None] * self.up)
        controls = np.vstack([np.zeros(3), np.cumsum(legs, 0)])
        t = np.asarray(u, np.float64)[:, None]
        centre = self.origin + (
            3 * (1 - t) ** 2 * t * controls[1] + 3 * (1 - t) * t**2 * controls[2] + t**3 * controls[3]
        )
        tangent = (1 - t) ** 2 * legs[0] + 2 * (1 - t) * t * legs[1] + t**2 * legs[2]
        tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
        side = np.broadcast_to(np.cross(self.up, self.outward), tangent.shape)
        normal = np.cross(tangent, side)
        roll = np.deg2rad(self.roll_start_deg + (self.roll_end_deg - self.roll_start_deg) * t)
        return (
            centre,
            tangent,
            np.cos(roll) * side + np.sin(roll) * normal,
            np.cos(roll) * normal - np.sin(roll) * side,
        )

    def mid_surface(self, u: Array, x: Array) -> Array:
        """Points Q(u, x) of the mid-surface, also beyond the outline; shape [N, 3]."""
        centre, _, side, normal = self.midrib(u)
        keel = 0.12 * self.half_width_m
        wave = np.sin(2 * np.pi * self.ripple_waves * u + self.ripple_phase + 40 * x) * (x / self.half_width_m) ** 2
        lift = (
            self.fold * (np.sqrt(x * x + keel * keel) - keel)
            + 0.5 * self.cup_per_m * x * x
            + self.ripple * self.half_width_m * wave
        )
        return centre + x[:, None] * side + lift[:, None] * normal

    def derivatives(self, u: Array, x: Array) -> tuple[Array, Array]:
        """dQ/du and dQ/dx by central differences; two arrays [N, 3], metres and dimensionless."""
        du, dx = 1e-4, 1e-5 * self.half_width_m / 0.01
        along = (self.mid_surface(u + du, x) - self.mid_surface(u - du, x)) / (2 * du)
        across = (self.mid_surface(u, x + dx) - self.mid_surface(u, x - dx)) / (2 * dx)
        return along, across

    def frame(self, u: Array, x: Array) -> tuple[Array, Array]:
        """Unit tangent along the blade and unit normal of the upper face; two arrays [N, 3]."""
        along, across = self.derivatives(u, x)
        normal = np.cross(along, across)
        return (
            along / np.linalg.norm(along, axis=1, keepdims=True),
            normal / np.linalg.norm(normal, axis=1, keepdims=True),
        )

    @cached_property
    def area_m2(self) -> float:
        """Area of the mid-surface inside the outline, by the midpoint rule."""
        u, v = (g.ravel() for g in np.meshgrid((np.arange(400) + 0.5) / 400, (np.arange(60) + 0.5) / 30 - 1))
        w = self.half_width(u)
        along, across = self.derivatives(u, v * w)
        return float((np.linalg.norm(np.cross(along, across), axis=1) * w).sum() * 2 / (400 * 60))

    @property
    def volume_m3(self) -> float:
        """Area times thickness (curvature changes it only in third order of the thickness)."""
        return self.area_m2 * self.thickness_m

    def sample(self, spacing_m: float, rng: np.random.Generator) -> Patch:
        """Both faces, the margin and a sparse filling between; ``coords`` = (u, x / w(u)).

        Args:
            spacing_m: distance between neighbours on a face.
            rng: for the jitter that hides the rows.
        """
        t = self.thickness_m
        layers = [self._layer(side * t / 2, side, spacing_m, rng) for side in (1.0, -1.0)]
        filling = self._layer(0.0, 1.0, 2.2 * spacing_m, rng)
        depth = rng.uniform(-0.45, 0.45, len(filling)) * t
        layers.append(
            Patch(
                points=filling.points + depth[:, None] * filling.normals,
                normals=filling.normals * np.where(depth >= 0, 1.0, -1.0)[:, None],
                tangents=filling.tangents,
                sigmas=np.minimum(filling.sigmas, OVERLAP * spacing_m),  # as small as on the faces: stays inside
                coords=filling.coords,
            )
        )
        layers += [self._margin(side, offset * t, spacing_m) for side in (1.0, -1.0) for offset in (-0.25, 0.25)]
        return joined(layers)

    def _layer(self, offset_m: float, side: float, spacing_m: float, rng: np.random.Generator) -> Patch:
        u_row, step = self._rows(spacing_m)
        width = 2 * self.half_width(u_row)
        counts = np.maximum(1, np.round(width / spacing_m)).astype(np.int64)
        row, place = ragged_rows(counts)
        v = 2 * staggered(row, place, counts) - 1
        v += rng.uniform(-0.12, 0.12, len(v)) / counts[row]
        u = np.clip(u_row[row] + rng.uniform(-0.06, 0.06, len(v)) / len(u_row), 0, 1)
        x = v * self.half_width(u)
        tangent, normal = self.frame(u, x)
        sigmas = np.stack(
            [
                np.full(len(u), OVERLAP * step),
                OVERLAP * width[row] / counts[row],
                np.full(len(u), self.thickness_m / 10),
            ],
            1,
        )
        points = self.mid_surface(u, x) + offset_m * normal
        return Patch(points, side * normal, tangent, sigmas, np.stack([u, v], 1))

    def _margin(self, side: float, offset_m: float, spacing_m: float) -> Patch:
        fine = np.linspace(0, 1, 600)
        edge = self.mid_surface(fine, side * self.half_width(fine))
        arc = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(edge, axis=0), axis=1))])
        count = max(2, round(arc[-1] / (0.8 * spacing_m)))
        u = np.interp((np.arange(count) + 0.5) / count * arc[-1], arc, fine)
        inset = 0.25 * spacing_m
        x = side * np.maximum(self.half_width(u) - inset, 0.1 * inset)
        _, normal = self.frame(u, x)
        ahead = np.minimum(u + 1e-3, 1.0)
        behind = np.maximum(u - 1e-3, 0.0)
        run = self.mid_surface(ahead, side * self.half_width(ahead)) - self.mid_surface(
            behind, side * self.half_width(behind)
        )
        run -= (run * normal).sum(1, keepdims=True) * normal
        run /= np.linalg.norm(run, axis=1, keepdims=True)
        sigmas = np.tile([0.8 * OVERLAP * spacing_m, 0.3 * spacing_m, self.thickness_m / 8], (count, 1))
        facing = normal * np.sign(offset_m)
        return Patch(
            self.mid_surface(u, x) + offset_m * normal, facing, run, sigmas, np.stack([u, np.full(count, side)], 1)
        )

    def _rows(self, spacing_m: float) -> tuple[Array, float]:
        """Values of u at the middle of rows of equal length along the midrib, and that length."""
        fine = np.linspace(0, 1, 400)
        arc = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(self.midrib(fine)[0], axis=0), axis=1))])
        count = max(2, round(arc[-1] / spacing_m))
        return np.interp((np.arange(count) + 0.5) / count * arc[-1], arc, fine), arc[-1] / count

    @cached_property
    def _start(self) -> tuple[cKDTree, Array, Array]:
        """Nodes of the mid-surface from which the projection of a point starts."""
        u, v = (g.ravel() for g in np.meshgrid(np.linspace(0.01, 0.99, 60), np.linspace(-1, 1, 11)))
        x = v * self.half_width(u)
        return cKDTree(self.mid_surface(u, x)), u, x

    def contains(self, points: Array) -> np.ndarray:
        """Whether each point [N, 3] lies inside the sheet: projected onto the mid-surface by Gauss-Newton steps."""
        tree, u0, x0 = self._start
        found = np.zeros(len(points), bool)
        margin = self.thickness_m + 0.002
        near = np.flatnonzero(((points > tree.mins - margin) & (points < tree.maxes + margin)).all(1))
        distance, node = tree.query(points[near], distance_upper_bound=0.006 + self.thickness_m)
        near, node = near[np.isfinite(distance)], node[np.isfinite(distance)]
        p, u, x = points[near], u0[node], x0[node]
        for _ in range(6):
            along, across = self.derivatives(u, x)
            gap = p - self.mid_surface(u, x)
            aa, ab, bb = (along * along).sum(1), (along * across).sum(1), (across * across).sum(1)
            ga, gb = (gap * along).sum(1), (gap * across).sum(1)
            det = aa * bb - ab * ab
            u = np.clip(u + (bb * ga - ab * gb) / det, -0.2, 1.2)
            x = x + (aa * gb - ab * ga) / det
        _, normal = self.frame(u, x)
        height = ((p - self.mid_surface(u, x)) * normal).sum(1)
        ok = (np.abs(height) < self.thickness_m / 2) & (u >= 0) & (u <= 1) & (np.abs(x) <= self.half_width(u))
        found[near[ok]] = True
        return found
