"""Curved sheets of constant thickness with a tapering outline: leaves and petals."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

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

    @cached_property
    def _legs(self) -> Array:
        """The three sides of the midrib's control polygon, shape [3, 3]."""
        start, end = self.elevation_start_deg, self.elevation_end_deg
        angles = np.deg2rad([start, 0.5 * (start + end), end])[:, None]
        return self.length_m / 3 * (np.cos(angles) * self.outward + np.sin(angles) * self.up)

    def midrib(self, u: Array) -> tuple[Array, Array, Array, Array]:
        """Centre, unit tangent, side and upper normal of the midrib at ``u`` [N]; four arrays [N, 3]."""
        controls = np.cumsum(self._legs, 0)
        t = np.asarray(u, np.float64)
        s = 1 - t
        centre = self.origin + np.stack([3 * s * s * t, 3 * s * t * t, t * t * t], 1) @ controls
        tangent = np.stack([s * s, 2 * s * t, t * t], 1) @ self._legs
        tangent /= np.sqrt((tangent * tangent).sum(1, keepdims=True))
        side = np.cross(self.up, self.outward)
        rise, run = tangent @ self.up, tangent @ self.outward  # the midrib lies in one plane
        normal = run[:, None] * self.up - rise[:, None] * self.outward
        roll = np.deg2rad(self.roll_start_deg + (self.roll_end_deg - self.roll_start_deg) * t[:, None])
        return (
            centre,
            tangent,
            np.cos(roll) * side + np.sin(roll) * normal,
            np.cos(roll) * normal - np.sin(roll) * side,
        )

    def mid_surface(self, u: Array, x: Array) -> Array:
        """Points Q(u, x) of the mid-surface, also beyond the outline; shape [N, 3]."""
        centre, _, side, normal = self.midrib(u)
        return centre + x[:, None] * side + self._lift(u, x)[0][:, None] * normal

    def derivatives(self, u: Array, x: Array) -> tuple[Array, Array]:
        """dQ/du (central difference, metres) and dQ/dx (exact, dimensionless); two arrays [N, 3]."""
        du = 1e-4
        along = (self.mid_surface(u + du, x) - self.mid_surface(u - du, x)) / (2 * du)
        _, _, side, normal = self.midrib(u)
        return along, side + self._lift(u, x)[1][:, None] * normal

    def _lift(self, u: Array, x: Array) -> tuple[Array, Array]:
        """Height Z(u, x) above the midrib's tangent plane in metres, and dZ/dx; two arrays [N]."""
        keel = 0.3 * self.half_width_m
        root = np.sqrt(x * x + keel * keel)
        lean = 0.35 / self.half_width_m  # the waves of the two margins are out of step
        phase = 2 * np.pi * self.ripple_waves * u + self.ripple_phase + lean * x
        height = self.ripple / self.half_width_m
        lift = self.fold * (root - keel) + 0.5 * self.cup_per_m * x * x + height * np.sin(phase) * x * x
        slope = (
            self.fold * x / root + self.cup_per_m * x + height * (2 * x * np.sin(phase) + lean * x * x * np.cos(phase))
        )
        return lift, slope

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
        n_u, n_v = 200, 12
        u, v = (g.ravel() for g in np.meshgrid((np.arange(n_u) + 0.5) / n_u, (2 * np.arange(n_v) + 1) / n_v - 1))
        w = self.half_width(u)
        along, across = self.derivatives(u, v * w)
        return float((np.linalg.norm(np.cross(along, across), axis=1) * w).sum() * 2 / (n_u * n_v))

    @property
    def volume_m3(self) -> float:
        """Area times thickness (curvature changes it only in third order of the thickness)."""
        return self.area_m2 * self.thickness_m

    def volume_points(self) -> tuple[Array, Array]:
        """Points all through the sheet [M, 3] and the volume that each stands for [M]."""
        n_u, n_v, n_t = 48, 10, 2
        axes = ((np.arange(n) + 0.5) / n for n in (n_u, n_v, n_t))
        u, v, t = (grid.ravel() for grid in np.meshgrid(*axes))
        w = self.half_width(u)
        x = (2 * v - 1) * w
        along, across = self.derivatives(u, x)
        area = np.linalg.norm(np.cross(along, across), axis=1) * 2 * w / (n_u * n_v)
        _, normal = self.frame(u, x)
        points = self.mid_surface(u, x) + ((t - 0.5) * self.thickness_m)[:, None] * normal
        return points, area * self.thickness_m / n_t

    def sample(self, spacing_m: float, rng: np.random.Generator) -> Patch:
        """Both faces, a sparse filling between them and the margin; ``coords`` = (u, x / w(u), face).

        Args:
            spacing_m: distance between neighbours on a face.
            rng: for the jitter that hides the rows.
        """
        half = self.thickness_m / 2
        faces = [self._layer(side * half, spacing_m, rng) for side in (1.0, -1.0)]
        filling = self._layer(None, 2.2 * spacing_m, rng)
        # As small as on the faces, so that the filling stays within the outline.
        small = np.minimum(filling.sigmas, OVERLAP * spacing_m)
        filling = Patch(filling.points, filling.normals, filling.tangents, small, filling.coords)
        margin = [self._margin(side, offset * half, spacing_m) for side in (1.0, -1.0) for offset in (-0.5, 0.5)]
        return joined([*faces, filling, *margin])

    def _layer(self, offset_m: float | None, spacing_m: float, rng: np.random.Generator) -> Patch:
        """Rows of Gaussians at a distance from the mid-surface, or (None) anywhere between the faces."""
        u_row, step = self._rows(spacing_m)
        counts = np.maximum(1, np.round(2 * self.half_width(u_row) / spacing_m)).astype(np.int64)
        row, place = ragged_rows(counts)
        v = 2 * staggered(row, place, counts) - 1 + rng.uniform(-0.12, 0.12, len(row)) / counts[row]
        u = np.clip(u_row[row] + rng.uniform(-0.06, 0.06, len(row)) / len(u_row), 0, 1)
        width = self.half_width(u)
        # The outermost Gaussians stay clear of the margin, which has its own: a smooth outline, no teeth.
        x = v * np.maximum(width - 0.45 * spacing_m, 0.5 * width)
        thick = np.full(len(u), self.thickness_m)
        offset = rng.uniform(-0.45, 0.45, len(u)) * thick if offset_m is None else np.full(len(u), offset_m)
        across = 2 * self.half_width(u_row)[row] / counts[row]
        tangent, _ = self.frame(u, x)
        sigmas = np.stack([np.full(len(u), OVERLAP * step), OVERLAP * across, thick / 10], 1)
        return self._placed(u, x, offset, tangents=tangent, sigmas=sigmas, v=v)

    def _margin(self, side: float, offset_m: float, spacing_m: float) -> Patch:
        """A row of Gaussians just inside the outline on one side (+1 or -1), drawn out along it."""
        fine = np.linspace(0, 1, 600)
        edge = self.mid_surface(fine, side * self.half_width(fine))
        arc = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(edge, axis=0), axis=1))])
        count = max(2, round(arc[-1] / (0.6 * spacing_m)))
        u = np.interp((np.arange(count) + 0.5) / count * arc[-1], arc, fine)
        inset = 0.3 * spacing_m
        x = side * np.maximum(self.half_width(u) - inset, 0.1 * inset)
        ends = [np.clip(u + step, 0, 1) for step in (1e-3, -1e-3)]
        ahead, behind = (self.mid_surface(end, side * self.half_width(end)) for end in ends)
        _, normal = self.frame(u, x)
        run = ahead - behind
        run -= (run * normal).sum(1, keepdims=True) * normal
        run /= np.linalg.norm(run, axis=1, keepdims=True)
        sigmas = np.tile([OVERLAP * spacing_m, 0.28 * spacing_m, self.thickness_m / 8], (count, 1))
        return self._placed(u, x, np.full(count, offset_m), tangents=run, sigmas=sigmas, v=np.full(count, side))

    def _placed(self, u: Array, x: Array, offset_m: Array, *, tangents: Array, sigmas: Array, v: Array) -> Patch:
        """Samples at a signed distance from the mid-surface, each facing the side that it is on."""
        _, normal = self.frame(u, x)
        face = np.where(offset_m >= 0, 1.0, -1.0)
        points = self.mid_surface(u, x) + offset_m[:, None] * normal
        return Patch(points, face[:, None] * normal, tangents, sigmas, np.stack([u, v, face], 1))

    def _rows(self, spacing_m: float) -> tuple[Array, float]:
        """Values of u at the middle of rows of equal length along the midrib, and that length."""
        fine = np.linspace(0, 1, 400)
        arc = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(self.midrib(fine)[0], axis=0), axis=1))])
        count = max(2, round(arc[-1] / spacing_m))
        return np.interp((np.arange(count) + 0.5) / count * arc[-1], arc, fine), arc[-1] / count

    @cached_property
    def _start(self) -> tuple[KDTree, Array, Array]:
        """Nodes of the mid-surface from which the projection of a point starts."""
        u, v = (g.ravel() for g in np.meshgrid(np.linspace(0.01, 0.99, 60), np.linspace(-1, 1, 11)))
        x = v * self.half_width(u)
        return KDTree(self.mid_surface(u, x)), u, x

    @property
    def lower(self) -> Array:
        """Corner of a box around the sheet, shape [3]."""
        return self._start[0].mins - self.thickness_m - 0.002

    @property
    def upper(self) -> Array:
        """The opposite corner, shape [3]."""
        return self._start[0].maxes + self.thickness_m + 0.002

    def contains(self, points: Array) -> NDArray[np.bool_]:
        """Whether each point [N, 3] lies inside the sheet: projected onto the mid-surface by Gauss-Newton steps."""
        tree, u0, x0 = self._start
        found = np.zeros(len(points), bool)
        near = np.flatnonzero(((points > self.lower) & (points < self.upper)).all(1))
        distance, node = tree.query(points[near], distance_upper_bound=0.0035 + self.thickness_m)
        reached = np.isfinite(distance)
        near, node = near[reached], np.asarray(node)[reached]
        p, u, x = points[near], u0[node], x0[node]
        for _ in range(4):
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
