"""The geometry of the potted flower: every shape in metres, the ground at y = 0, and the truth that follows from it.

Leaves and petals are sheets of constant thickness, stalk and petioles are rods, pot and heart are solids of
revolution, the soil fills the pot up to a bumpy surface; so volumes, areas and the inside are known.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from phys4dgen.zoo import texture
from phys4dgen.zoo.blade import Blade
from phys4dgen.zoo.patch import Array, Patch, ragged_rows, staggered
from phys4dgen.zoo.solids import Revolved, Tube, bezier, rounded_profile
from phys4dgen.zoo.zoo_object import PartTruth

__all__ = [
    "HEART",
    "HEART_RADIUS_M",
    "LEAVES",
    "MATERIALS",
    "PART_NAMES",
    "PETALS",
    "POT",
    "SOIL",
    "SOIL_HEIGHT_M",
    "STEM",
    "UP",
    "FlowerShapes",
]

PART_NAMES = ("pot", "soil", "stem", "leaves", "petals", "heart")
POT, SOIL, STEM, LEAVES, PETALS, HEART = range(6)
MATERIALS = ("ceramic", "garden_soil", "herbaceous_stem", "leaf_blade", "petal", "herbaceous_stem")

WALL_M = 0.007
SOIL_HEIGHT_M = 0.0935
STEM_RADIUS_M = 0.0033
PETIOLE_RADIUS_M = 0.00165
LEAF_THICKNESS_M = 0.0012
PETAL_THICKNESS_M = 0.0008
HEART_RADIUS_M = 0.0130
PETAL_COUNT = 12

UP = np.array([0.0, 1.0, 0.0])
STEM_CONTROLS_M = np.array(
    [[0.003, 0.070, 0.0], [-0.026, 0.155, -0.004], [0.034, 0.225, -0.022], [0.004, 0.300, 0.006]]
)
# (radius, height), counter-clockwise: foot, collar, lip, inner wall, floor; and how far each corner is rounded.
POT_CORNERS_M = np.array(
    [
        [0.0, 0.0],
        [0.0425, 0.0],
        [0.0545, 0.0790],
        [0.0600, 0.0805],
        [0.0625, 0.1050],
        [0.0545, 0.1050],
        [0.0372, 0.0080],
        [0.0, 0.0080],
    ]
)
POT_ROUNDING_M = np.array([0, 0.004, 0.0014, 0.0016, 0.0028, 0.0028, 0.003, 0])


@dataclass(frozen=True)
class LeafPlan:
    """Where a leaf grows and how it bends."""

    height_m: float
    azimuth_deg: float
    petiole_rise_deg: float
    length_m: float
    half_width_m: float
    elevation_start_deg: float
    elevation_end_deg: float
    roll_start_deg: float
    roll_end_deg: float


# Neighbouring leaves stand about a golden angle apart, as in nature, and at least 11 mm clear of each other.
LEAF_PLANS = (
    LeafPlan(0.124, 212.0, 40.0, 0.094, 0.0220, 38.0, -50.0, 6.0, -8.0),
    LeafPlan(0.134, -16.0, 42.0, 0.098, 0.0228, 42.0, -50.0, -6.0, 10.0),
    LeafPlan(0.150, 96.0, 44.0, 0.084, 0.0200, 44.0, -44.0, 5.0, -12.0),
    LeafPlan(0.168, 284.0, 46.0, 0.084, 0.0195, 46.0, -40.0, -5.0, 9.0),
    LeafPlan(0.186, 164.0, 50.0, 0.074, 0.0172, 50.0, -32.0, 6.0, -8.0),
    LeafPlan(0.204, 34.0, 52.0, 0.066, 0.0152, 52.0, -22.0, -4.0, 8.0),
    LeafPlan(0.222, 252.0, 54.0, 0.056, 0.0128, 54.0, -14.0, 4.0, -6.0),
    LeafPlan(0.236, 132.0, 48.0, 0.046, 0.0106, 46.0, -10.0, -4.0, 6.0),
)


class FlowerShapes:
    """All shapes of the flower, in metres."""

    def __init__(self, seed: int) -> None:
        """Draw the irregularities of leaves and petals from ``seed``."""
        self.seed = seed
        rng = np.random.default_rng([seed, 1])
        self._stem_line = bezier(STEM_CONTROLS_M, 400)
        rise = self._stem_line[-1] - self._stem_line[-2]
        face = rise / np.linalg.norm(rise) + np.array([0.08, -0.10, 0.62])  # nods a little towards the viewer at +z
        self.head_axis: Array = face / np.linalg.norm(face)
        grown = [self._leaf(plan, rng) for plan in LEAF_PLANS]
        self.leaves: list[Blade] = [blade for blade, _ in grown]
        self.rods: list[Tube] = [self.stalk] + [petiole for _, petiole in grown]
        self.petals: list[Blade] = [self._petal(k, rng) for k in range(PETAL_COUNT)]

    @cached_property
    def pot(self) -> Revolved:
        """Foot, collar and lip, open at the top, with a solid wall and floor."""
        return Revolved(rounded_profile(POT_CORNERS_M, POT_ROUNDING_M, steps=7), np.zeros(3), np.eye(3))

    @cached_property
    def _inner_wall(self) -> Array:
        """The part of the pot's outline from just above the soil down to the axis, (radius, height)."""
        line = self.pot.profile
        past_lip = np.arange(len(line)) > np.argmax(line[:, 1])
        first = int(np.flatnonzero(past_lip & (line[:, 1] < SOIL_HEIGHT_M))[0])
        return line[first - 1 :]

    @cached_property
    def pot_skin(self) -> Array:
        """The pot's outline without the inner wall that lies under the soil, (radius, height)."""
        line, inner = self.pot.profile, self._inner_wall
        buried_m = SOIL_HEIGHT_M - 0.008
        share = (inner[0, 1] - buried_m) / (inner[0, 1] - inner[1, 1])
        return np.vstack([line[: len(line) - len(inner) + 1], inner[0] + share * (inner[1] - inner[0])])

    @cached_property
    def cavity(self) -> Revolved:
        """The room inside the pot, up to above the soil."""
        inner = self._inner_wall[::-1]
        top = inner[-1, 1]
        return Revolved(np.vstack([inner, [[0.0, top]]]), np.zeros(3), np.eye(3))

    def soil_height(self, x: Array, z: Array) -> Array:
        """Height of the soil's surface: a low mound, heaped at the stem, with crumbs; metres, shape [N]."""
        mound = 0.0035 * (1 - (x * x + z * z) / 0.052**2)
        heap = 0.0022 * np.exp(-((x - 0.0005) ** 2 + z * z) / 0.009**2)
        crumbs = 0.0012 * texture.fractal_noise(np.stack([x, z], 1), 0.009, seed=self.seed + 100, octaves=3)
        return SOIL_HEIGHT_M - 0.003 + mound + heap + crumbs

    @cached_property
    def stalk(self) -> Tube:
        """The main stem, which bends into the head's axis and widens into its receptacle."""
        line, axis = self._stem_line, self.head_axis
        ahead = (line[-1] - line[-2]) / np.linalg.norm(line[-1] - line[-2])
        reach = 0.017
        corner = line[-1] + 0.5 * reach * ahead
        t = np.linspace(0, 1, 80)[1:, None]
        neck = (1 - t) ** 2 * line[-1] + 2 * t * (1 - t) * corner + t * t * (corner + 0.5 * reach * axis)
        centre = np.vstack([line, neck])
        arc = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(centre, axis=0), axis=1))])
        flare = np.clip((arc - (arc[-1] - 0.010)) / 0.010, 0, 1)
        return Tube(centre, STEM_RADIUS_M * (1.06 - 0.14 * arc / arc[-1]) + 0.0088 * flare**1.6)

    @cached_property
    def head_rotation(self) -> Array:
        """Columns: x, axis and z of the head in the object's axes, shape [3, 3]."""
        x = np.cross(self.head_axis, [0.0, 0.0, 1.0])
        x /= np.linalg.norm(x)
        return np.stack([x, self.head_axis, np.cross(x, self.head_axis)], 1)

    @cached_property
    def heart(self) -> Revolved:
        """The domed disc in the middle of the head."""
        r = HEART_RADIUS_M
        corners = [[0, 0], [0.8 * r, 0], [r, 0.0028], [0.84 * r, 0.0078], [0.42 * r, 0.0094], [0, 0.0084]]
        profile = rounded_profile(np.array(corners), np.array([0, 0.0012, 0.0022, 0.002, 0.0018, 0]), steps=6)
        return Revolved(profile, self.stalk.centre[-1], self.head_rotation)

    def _leaf(self, plan: LeafPlan, rng: np.random.Generator) -> tuple[Blade, Tube]:
        """A leaf and its petiole, which runs on as a rib under the blade."""
        azimuth, rise, start = np.deg2rad([plan.azimuth_deg, plan.petiole_rise_deg, plan.elevation_start_deg])
        outward = np.array([np.cos(azimuth), 0.0, np.sin(azimuth)])
        foot = self._stem_line[int(np.argmin(np.abs(self._stem_line[:, 1] - plan.height_m)))]
        reach = 0.014 + 0.16 * plan.length_m
        knee = foot + reach * (0.62 * np.cos(rise) * outward + 0.9 * np.sin(rise) * UP)
        blade = Blade(
            origin=knee + 0.5 * reach * (np.cos(start) * outward + np.sin(start) * UP),
            outward=outward,
            up=UP,
            length_m=plan.length_m,
            half_width_m=plan.half_width_m,
            thickness_m=LEAF_THICKNESS_M,
            base_power=0.72,
            tip_power=1.12,
            base_half_width_m=0.0016,
            elevation_start_deg=plan.elevation_start_deg,
            elevation_end_deg=plan.elevation_end_deg,
            roll_start_deg=plan.roll_start_deg,
            roll_end_deg=plan.roll_end_deg,
            fold=0.30,
            cup_per_m=-8.0,
            ripple=0.07,
            ripple_waves=2.6,
            ripple_phase=float(rng.uniform(0, 2 * np.pi)),
        )
        u = np.linspace(0, 0.42, 60)
        middle, _, _, normal = blade.midrib(u)
        rib_radius = PETIOLE_RADIUS_M * (1 - 0.62 * u / u[-1])
        rib = middle - (LEAF_THICKNESS_M / 2 + 0.85 * rib_radius)[:, None] * normal
        along = (rib[1] - rib[0]) / np.linalg.norm(rib[1] - rib[0])
        controls = np.array([foot, knee - 0.25 * reach * along, rib[0] - 0.45 * reach * along, rib[0]])
        radius = np.concatenate([PETIOLE_RADIUS_M * np.linspace(1.18, 1.0, 60), rib_radius[1:]])
        return blade, Tube(np.vstack([bezier(controls, 60), rib[1:]]), radius)

    def _petal(self, index: int, rng: np.random.Generator) -> Blade:
        """One petal; it starts inside the rim of the heart."""
        turn = 2 * np.pi * (index + 0.06 * rng.uniform(-1, 1)) / PETAL_COUNT + 0.2
        x, axis, z = self.head_rotation.T
        outward = np.cos(turn) * x + np.sin(turn) * z
        lift_deg = rng.uniform(-3, 3)
        return Blade(
            origin=self.stalk.centre[-1] + 0.0024 * axis + (HEART_RADIUS_M - 0.0004) * outward,
            outward=outward,
            up=axis,
            length_m=0.040 * (1 + 0.05 * rng.uniform(-1, 1)),
            half_width_m=0.0080 * (1 + 0.04 * rng.uniform(-1, 1)),
            thickness_m=PETAL_THICKNESS_M,
            base_power=0.85,
            tip_power=0.42,
            base_half_width_m=0.0027,
            elevation_start_deg=24 + lift_deg,
            elevation_end_deg=-14 + 2 * lift_deg,
            roll_start_deg=float(rng.uniform(-3, 3)),
            roll_end_deg=float(rng.uniform(-6, 6)),
            cup_per_m=34.0,
            ripple=0.06,
            ripple_waves=1.4,
            ripple_phase=float(rng.uniform(0, 2 * np.pi)),
        )

    def soil_patch(self, spacing_m: float, rng: np.random.Generator) -> Patch:
        """Samples of the soil's surface, a little into the wall; ``coords`` = (radius, angle, 1)."""
        below, above = self._inner_wall[1], self._inner_wall[0]
        wall_m = float(np.interp(SOIL_HEIGHT_M, [below[1], above[1]], [below[0], above[0]])) + 0.0012
        rows = round(wall_m / spacing_m)
        ring = (np.arange(rows) + 0.5) / rows * wall_m
        counts = np.maximum(5, np.round(2 * np.pi * ring / spacing_m)).astype(np.int64)
        row, place = ragged_rows(counts)
        radius = ring[row] + rng.uniform(-0.2, 0.2, len(row)) * spacing_m
        angle = 2 * np.pi * (staggered(row, place, counts) + rng.uniform(-0.2, 0.2, len(row)) / counts[row])
        x, z = radius * np.cos(angle), radius * np.sin(angle)
        h, one, zero = 0.0004, np.ones_like(x), np.zeros_like(x)
        y = self.soil_height(x, z)
        slope_x, slope_z = (self.soil_height(x + h, z) - y) / h, (self.soil_height(x, z + h) - y) / h
        normal, tangent = np.stack([-slope_x, one, -slope_z], 1), np.stack([one, slope_x, zero], 1)
        return Patch(
            points=np.stack([x, y, z], 1),
            normals=normal / np.linalg.norm(normal, axis=1, keepdims=True),
            tangents=tangent / np.linalg.norm(tangent, axis=1, keepdims=True),
            sigmas=np.tile([0.68 * spacing_m, 0.68 * spacing_m, 0.22 * spacing_m], (len(x), 1)),
            coords=np.stack([radius, angle, one], 1),
        )

    def is_bare(self, rod: Tube, points: Array) -> NDArray[np.bool_]:
        """Which points [N, 3] of a rod can be seen: those above the soil and, of a petiole, outside the stalk."""
        above = points[:, 1] > self.soil_height(points[:, 0], points[:, 2])
        return above if rod is self.stalk else above & ~self.stalk.contains(points)

    def inside(self, points: Array) -> NDArray[np.int32]:
        """Part that fills each point [M, 3] (metres), int32, -1 in the air; the first part in this order wins."""
        part = np.full(len(points), -1, np.int32)

        def fill(number: int, contained: NDArray[np.bool_]) -> None:
            part[(part < 0) & contained] = number

        fill(POT, self.pot.contains(points))
        fill(SOIL, self.cavity.contains(points) & (points[:, 1] < self.soil_height(points[:, 0], points[:, 2])))
        fill(HEART, self.heart.contains(points))
        for number, shapes in ((STEM, self.rods), (LEAVES, self.leaves), (PETALS, self.petals)):
            for shape in shapes:
                fill(number, shape.contains(points))
        return part

    def truth(self) -> dict[str, PartTruth]:
        """Exact geometry of every part."""
        bare = []
        for rod in self.rods:
            keep = self.is_bare(rod, rod.centre)
            bare.append(Tube(rod.centre[keep], rod.radius_m[keep]))
        pot, soil, stem, leaf, petal, heart = MATERIALS
        return {
            "pot": PartTruth(pot, self.pot.volume_m3, thickness_m=WALL_M),
            "soil": PartTruth(soil, self._soil_volume()),
            "stem": PartTruth(
                stem, sum(rod.volume_m3 for rod in bare), sum(rod.area_m2 for rod in bare), 2 * STEM_RADIUS_M
            ),
            "leaves": _sheets_truth(leaf, self.leaves),
            "petals": _sheets_truth(petal, self.petals),
            "heart": PartTruth(heart, self.heart.volume_m3),
        }

    def _soil_volume(self) -> float:
        """Columns of soil over a polar grid, from the cavity's floor or wall to the surface (midpoint rule)."""
        n_r, n_turn, reach = 200, 90, 0.0545
        r, turn = np.meshgrid((np.arange(n_r) + 0.5) / n_r * reach, (np.arange(n_turn) + 0.5) / n_turn * 2 * np.pi)
        r, turn = r.ravel(), turn.ravel()
        inner = self._inner_wall[::-1]  # from the axis outwards and up
        floor = np.interp(r, inner[:, 0], inner[:, 1])
        depth = np.maximum(self.soil_height(r * np.cos(turn), r * np.sin(turn)) - floor, 0)
        return float((depth * r).sum() * (reach / n_r) * (2 * np.pi / n_turn))


def _sheets_truth(material: str, blades: list[Blade]) -> PartTruth:
    return PartTruth(
        material,
        sum(blade.volume_m3 for blade in blades),
        sum(blade.area_m2 for blade in blades),
        blades[0].thickness_m,
    )
