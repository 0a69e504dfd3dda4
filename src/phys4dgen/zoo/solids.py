"""Rods along a curve and solids of revolution, and either of them warped: stems, pots, hats."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from phys4dgen.zoo.patch import Array, Patch, ragged_rows, staggered

__all__ = ["Lifted", "Revolved", "Tube", "bezier", "rounded_profile"]

OVERLAP = 0.62
"""Standard deviation of a Gaussian in units of the spacing."""


@dataclass(frozen=True, eq=False)
class Tube:
    """A round rod with flat ends along a densely sampled centre line; metres.

    Attributes:
        centre: nodes of the centre line, shape [M, 3].
        radius_m: at the nodes, shape [M].
    """

    centre: Array
    radius_m: Array

    @cached_property
    def arc_m(self) -> Array:
        """Arc length at the nodes, shape [M]."""
        return np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(self.centre, axis=0), axis=1))])

    @property
    def volume_m3(self) -> float:
        """Integral of pi r^2 along the centre line (Pappus)."""
        return float(np.trapezoid(np.pi * self.radius_m**2, self.arc_m))

    @property
    def area_m2(self) -> float:
        """Lateral area."""
        slope = np.gradient(self.radius_m, self.arc_m)
        return float(np.trapezoid(2 * np.pi * self.radius_m * np.hypot(1, slope), self.arc_m))

    @cached_property
    def _frames(self) -> tuple[Array, Array, Array]:
        """Tangent and two normals at the nodes, without twist (parallel transport)."""
        tangent = np.gradient(self.centre, self.arc_m, axis=0)
        tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
        first = np.zeros_like(tangent)
        seed = np.eye(3)[int(np.argmin(np.abs(tangent[0])))]
        for k, t in enumerate(tangent):
            seed = seed - (seed @ t) * t
            seed = seed / np.linalg.norm(seed)
            first[k] = seed
        return tangent, first, np.cross(tangent, first)

    def sample(self, spacing_m: float, rng: np.random.Generator) -> Patch:
        """The lateral surface; ``coords`` = (arc length in metres, angle in radians)."""
        length = self.arc_m[-1]
        rows = max(2, round(length / spacing_m))
        arc_row = (np.arange(rows) + 0.5) / rows * length
        radius_row = np.interp(arc_row, self.arc_m, self.radius_m)
        counts = np.maximum(6, np.round(2 * np.pi * radius_row / spacing_m)).astype(np.int64)
        row, place = ragged_rows(counts)
        arc = np.clip(arc_row[row] + rng.uniform(-0.1, 0.1, len(row)) * spacing_m, 0, length)
        angle = 2 * np.pi * (staggered(row, place, counts) + rng.uniform(-0.08, 0.08, len(row)) / counts[row])

        def at_arc(values: Array) -> Array:
            return np.stack([np.interp(arc, self.arc_m, values[:, axis]) for axis in range(3)], 1)

        tangent, first, second = (at_arc(axes) for axes in self._frames)
        slope = np.interp(arc, self.arc_m, np.gradient(self.radius_m, self.arc_m))
        radial = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
        normal = radial - slope[:, None] * tangent
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        along = tangent - (tangent * normal).sum(1, keepdims=True) * normal
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        radius = np.interp(arc, self.arc_m, self.radius_m)
        sigmas = np.stack(
            [
                OVERLAP * length / rows * np.hypot(1, slope),
                OVERLAP * 2 * np.pi * radius / counts[row],
                0.05 * radius,
            ],
            1,
        )
        return Patch(
            at_arc(self.centre) + radius[:, None] * radial,
            normal,
            along,
            sigmas,
            np.stack([arc, angle, np.ones_like(arc)], 1),
        )

    @cached_property
    def _tree(self) -> KDTree:
        return KDTree(self.centre)

    @property
    def lower(self) -> Array:
        """Corner of a box around the rod, shape [3]."""
        return (self.centre - self.radius_m[:, None]).min(0)

    @property
    def upper(self) -> Array:
        """The opposite corner, shape [3]."""
        return (self.centre + self.radius_m[:, None]).max(0)

    def contains(self, points: Array) -> NDArray[np.bool_]:
        """Whether each point [N, 3] lies inside the rod."""
        found = np.zeros(len(points), bool)
        reach = float(self.radius_m.max() + np.diff(self.arc_m).max())
        distance, node = self._tree.query(points, distance_upper_bound=reach)
        near = np.flatnonzero(np.isfinite(distance))
        nodes = np.asarray(node)[near]
        last = len(self.centre) - 1
        for shift in (-1, 0):  # the two segments that meet in the nearest node
            start = nodes + shift
            valid = (start >= 0) & (start < last)
            index, start = near[valid], start[valid]
            a, edge = self.centre[start], self.centre[start + 1] - self.centre[start]
            along = ((points[index] - a) * edge).sum(1) / (edge * edge).sum(1)
            held = np.clip(along, 0, 1)
            # The wedge on the outer side of a bend belongs to neither segment: clamp there, but not at the two ends.
            beyond = ((along < 0) & (start == 0)) | ((along > 1) & (start == last - 1))
            gap = np.linalg.norm(points[index] - a - held[:, None] * edge, axis=1)
            radius = self.radius_m[start] + held * (self.radius_m[start + 1] - self.radius_m[start])
            found[index] |= ~beyond & (gap < radius)
        return found


@dataclass(frozen=True, eq=False)
class Revolved:
    """A solid of revolution about its own y axis; metres.

    Attributes:
        profile: closed outline (radius, height), counter-clockwise in the (r, y) plane, shape [M, 2].
        origin: where the axis' zero lies, shape [3].
        rotation: columns are the solid's axes (x, y = axis, z) in the object's axes, shape [3, 3].
    """

    profile: Array
    origin: Array
    rotation: Array

    @property
    def volume_m3(self) -> float:
        """2 pi times the first moment of the outline about the axis (Pappus)."""
        r, y = self.profile.T
        r_next, y_next = np.roll(r, -1), np.roll(y, -1)
        return float(np.pi / 3 * ((r * r + r * r_next + r_next * r_next) * (y_next - y)).sum())

    def sample(self, spacing_m: float, rng: np.random.Generator, *, line: Array | None = None) -> Patch:
        """Samples of the surface; ``coords`` = (arc length along the outline in metres, angle).

        Args:
            spacing_m: distance between neighbours.
            rng: for the jitter that hides the rows.
            line: the part of the outline that can be seen, points (radius, height) in the order of ``profile``, so
                that the normals point outwards, shape [K, 2]; all of it if not given.
        """
        line = self.profile if line is None else line
        arc_nodes = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        rows = max(1, round(arc_nodes[-1] / spacing_m))
        arc_row = (np.arange(rows) + 0.5) / rows * arc_nodes[-1]
        counts = np.maximum(5, np.round(2 * np.pi * np.interp(arc_row, arc_nodes, line[:, 0]) / spacing_m))
        counts = counts.astype(np.int64)
        row, place = ragged_rows(counts)
        arc = np.clip(arc_row[row] + rng.uniform(-0.12, 0.12, len(row)) * spacing_m, 0, arc_nodes[-1])
        angle = 2 * np.pi * (staggered(row, place, counts) + rng.uniform(-0.1, 0.1, len(row)) / counts[row])
        step = 0.5 * spacing_m  # the slope over one spacing: rounds the corners of the normals as well
        radius, height = (np.interp(arc, arc_nodes, line[:, k]) for k in (0, 1))
        run = np.stack(
            [
                np.interp(arc + step, arc_nodes, line[:, k]) - np.interp(arc - step, arc_nodes, line[:, k])
                for k in (0, 1)
            ],
            1,
        )
        run /= np.linalg.norm(run, axis=1, keepdims=True)
        c, s, zero = np.cos(angle), np.sin(angle), np.zeros(len(angle))
        points = np.stack([radius * c, height, radius * s], 1)
        along = np.stack([run[:, 0] * c, run[:, 1], run[:, 0] * s], 1)
        normal = np.stack([run[:, 1] * c, -run[:, 0], run[:, 1] * s], 1)
        sigmas = np.stack(
            [
                zero + OVERLAP * arc_nodes[-1] / rows,
                OVERLAP * 2 * np.pi * np.maximum(radius, 0.3 * spacing_m) / counts[row],
                zero + 0.12 * spacing_m,
            ],
            1,
        )
        local = Patch(points, normal, along, sigmas, np.stack([arc, angle, np.ones_like(arc)], 1))
        return local.moved(self.origin, self.rotation)

    @cached_property
    def _box(self) -> tuple[Array, Array]:
        """Two opposite corners of a box around the solid, each of shape [3]."""
        reach, low, high = self.profile[:, 0].max(), self.profile[:, 1].min(), self.profile[:, 1].max()
        middle = self.origin + self.rotation @ np.array([0.0, (low + high) / 2, 0.0])
        half = np.abs(self.rotation) @ np.array([reach, (high - low) / 2, reach])
        return middle - half, middle + half

    @property
    def lower(self) -> Array:
        """Corner of a box around the solid, shape [3]."""
        return self._box[0]

    @property
    def upper(self) -> Array:
        """The opposite corner, shape [3]."""
        return self._box[1]

    def contains(self, points: Array) -> NDArray[np.bool_]:
        """Whether each point [N, 3] lies inside the solid (even-odd rule on the outline)."""
        local = (points - self.origin) @ self.rotation
        radius, height = np.hypot(local[:, 0], local[:, 2]), local[:, 1]
        odd = np.zeros(len(points), bool)
        for (r0, y0), (r1, y1) in zip(self.profile, np.roll(self.profile, -1, axis=0), strict=True):
            if y0 != y1:
                crosses = (height >= min(y0, y1)) & (height < max(y0, y1))
                odd ^= crosses & (radius < r0 + (height - y0) * (r1 - r0) / (y1 - y0))
        return odd


@dataclass(frozen=True, eq=False)
class Lifted:
    """A solid of revolution whose points are raised by ``lift(x, z)``: a shear, which keeps the volume; metres.

    Attributes:
        flat: the solid before; its axis is the y axis.
        lift: heights in metres [N] at x [N] and z [N].
        reach_m: greatest height and depth of ``lift``.
    """

    flat: Revolved
    lift: Callable[[Array, Array], Array]
    reach_m: float

    @property
    def volume_m3(self) -> float:
        """As before the lift."""
        return self.flat.volume_m3

    @property
    def lower(self) -> Array:
        """Corner of a box around the solid, shape [3]."""
        return self.flat.lower - np.array([0.0, self.reach_m, 0.0])

    @property
    def upper(self) -> Array:
        """The opposite corner, shape [3]."""
        return self.flat.upper + np.array([0.0, self.reach_m, 0.0])

    def contains(self, points: Array) -> NDArray[np.bool_]:
        """Whether each point [N, 3] lies inside the solid."""
        return self.flat.contains(points - self._rise(points))

    def sample(self, spacing_m: float, rng: np.random.Generator) -> Patch:
        """Samples of the surface; ``coords`` as before the lift."""
        patch = self.flat.sample(spacing_m, rng)
        x, z = patch.points[:, 0], patch.points[:, 2]
        step = 1e-5
        slope_x = (self.lift(x + step, z) - self.lift(x - step, z)) / (2 * step)
        slope_z = (self.lift(x, z + step) - self.lift(x, z - step)) / (2 * step)
        nx, ny, nz = patch.normals.T
        normals = np.stack([nx - slope_x * ny, ny, nz - slope_z * ny], 1)  # the inverse transpose of the shear
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        tx, ty, tz = patch.tangents.T
        tangents = np.stack([tx, ty + slope_x * tx + slope_z * tz, tz], 1)
        tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
        return Patch(patch.points + self._rise(patch.points), normals, tangents, patch.sigmas, patch.coords)

    def _rise(self, points: Array) -> Array:
        zero = np.zeros(len(points))
        return np.stack([zero, self.lift(points[:, 0], points[:, 2]), zero], 1)


def bezier(controls: Array, count: int) -> Array:
    """Points of a cubic Bezier curve, shape [count, 3]."""
    t = np.linspace(0, 1, count)[:, None]
    weights = np.hstack([(1 - t) ** 3, 3 * (1 - t) ** 2 * t, 3 * (1 - t) * t**2, t**3])
    return weights @ controls


def rounded_profile(corners: Array, radii_m: Array, *, steps: int = 6) -> Array:
    """An open polyline whose inner corners are replaced by quadratic arcs.

    Args:
        corners: points (radius, height), shape [K, 2]; the first and the last stay.
        radii_m: distance from each corner at which its arc starts, 0 keeps it sharp, shape [K].
        steps: points per arc.

    Raises:
        ValueError: two arcs overlap.
    """
    room = np.linalg.norm(np.diff(corners, axis=0), axis=1) - radii_m[:-1] - radii_m[1:]
    if room.min() < -1e-12:
        tight = int(np.argmin(room))
        raise ValueError(f"radii_m: the arcs of corners {tight} and {tight + 1} overlap by {-room[tight]:.4f} m.")
    line = [corners[0]]
    t = np.linspace(0, 1, steps)[:, None]
    for before, corner, after, radius in zip(corners[:-2], corners[1:-1], corners[2:], radii_m[1:-1], strict=True):
        if radius == 0:
            line.append(corner)
            continue
        enter = corner + radius * (before - corner) / np.linalg.norm(before - corner)
        leave = corner + radius * (after - corner) / np.linalg.norm(after - corner)
        line.extend((1 - t) ** 2 * enter + 2 * t * (1 - t) * corner + t * t * leave)
    line.append(corners[-1])
    return np.array(line)
