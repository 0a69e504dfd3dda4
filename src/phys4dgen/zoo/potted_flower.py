"""The bundled demo object: a flower in a terracotta pot, made by code, 0.35 m tall, y up.

Everything is built in metres with the ground at y = 0 and divided by ``METRES_PER_UNIT`` at the end. Leaves and petals
are sheets of constant thickness with Gaussians on both faces, the stem is a rod, pot and heart are solids of
revolution; so areas, volumes, thicknesses and the inside of every part are known.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from phys4dgen.types import SH_C0, Gaussians, rotation_to_z_up
from phys4dgen.zoo import shading, texture
from phys4dgen.zoo.blade import Blade
from phys4dgen.zoo.patch import Array, Patch, joined, ragged_rows, staggered
from phys4dgen.zoo.solids import Revolved, Tube, rounded_profile
from phys4dgen.zoo.zoo_object import PartTruth, ZooObject

__all__ = ["METRES_PER_UNIT", "PART_NAMES", "potted_flower"]

METRES_PER_UNIT = 0.35
PART_NAMES = ("pot", "soil", "stem", "leaves", "petals", "heart")
POT, SOIL, STEM, LEAVES, PETALS, HEART = range(6)

WALL_M = 0.007
SOIL_HEIGHT_M = 0.0935
STEM_RADIUS_M = 0.0033
LEAF_THICKNESS_M = 0.0012
PETAL_THICKNESS_M = 0.0008
HEART_RADIUS_M = 0.0115
PETAL_COUNT = 11

SPACING_M = {POT: 0.0018, SOIL: 0.0013, STEM: 0.00085, LEAVES: 0.00115, PETALS: 0.00085, HEART: 0.00075}
UP = np.array([0.0, 1.0, 0.0])

# One leaf: height on the stem (m), azimuth (deg), petiole rise (deg), length (m), half width (m), elevations (deg),
# rolls (deg). The azimuths turn by about 137.5 degrees from leaf to leaf, as in nature.
LEAF_PLAN = (
    (0.132, 205.0, 42.0, 0.088, 0.0205, 34.0, -46.0, 6.0, -8.0),
    (0.146, -18.0, 44.0, 0.092, 0.0210, 38.0, -44.0, -6.0, 10.0),
    (0.168, 118.0, 48.0, 0.080, 0.0185, 42.0, -36.0, 5.0, -12.0),
    (0.190, 258.0, 50.0, 0.074, 0.0170, 46.0, -30.0, -5.0, 8.0),
    (0.212, 38.0, 54.0, 0.064, 0.0145, 50.0, -18.0, 6.0, -6.0),
    (0.234, 172.0, 56.0, 0.054, 0.0120, 54.0, -6.0, -4.0, 6.0),
)


def potted_flower(*, seed: int = 0) -> ZooObject:
    """Build the potted flower.

    Args:
        seed: of the small irregularities; the same seed gives the same arrays.
    """
    return _Builder(seed).build()


class _Builder:
    """The shapes of the flower; each property is one shape, in metres."""

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self.rng = np.random.default_rng(seed)
        self.stem_line = _bezier(
            np.array(
                [[0.002, 0.070, -0.002], [-0.010, 0.150, -0.006], [0.016, 0.235, -0.014], [0.004, 0.3035, 0.004]]
            ),
            400,
        )
        end = self.stem_line[-1] - self.stem_line[-2]
        face = end / np.linalg.norm(end)
        face = face + np.array([0.08, -0.10, 0.62])  # the head nods a little towards the viewer at +z
        self.head_axis = face / np.linalg.norm(face)
        self.leaves = [self._leaf(*row) for row in LEAF_PLAN]
        self.petals = [self._petal(k) for k in range(PETAL_COUNT)]

    # -- shapes ------------------------------------------------------------------------------------------------

    @cached_property
    def pot_lines(self) -> dict[str, Array]:
        """Outline of the pot by pieces, counter-clockwise in (radius, height)."""
        corners = np.array(
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
        radii = np.array([0, 0.004, 0.0014, 0.0016, 0.0028, 0.0028, 0.003, 0])
        line = rounded_profile(corners, radii, steps=7)
        inner = int(np.flatnonzero((line[:, 1] < SOIL_HEIGHT_M) & (np.arange(len(line)) > 20))[0])
        return {"whole": line, "outer": line[:inner], "inner": line[inner - 1 :]}

    @cached_property
    def pot(self) -> Revolved:
        return Revolved(self.pot_lines["whole"], np.zeros(3), np.eye(3))

    @cached_property
    def cavity(self) -> Revolved:
        """The room inside the pot up to its rim."""
        inner = self.pot_lines["inner"][::-1]
        profile = np.vstack([inner, [[inner[-1, 0], 0.110], [0.0, 0.110]]])
        return Revolved(profile, np.zeros(3), np.eye(3))

    def soil_height(self, x: Array, z: Array) -> Array:
        """Height of the soil's surface: a low mound with crumbs, metres, shape [N]."""
        plane = np.stack([x, z], 1)
        mound = 0.0035 * (1 - (x * x + z * z) / 0.052**2)
        crumbs = 0.0011 * texture.fractal_noise(plane, 0.011, seed=self.seed + 100, octaves=3)
        return SOIL_HEIGHT_M - 0.003 + mound + crumbs

    @cached_property
    def stalk(self) -> Tube:
        """The main stem, which widens into the receptacle under the head."""
        line, axis = self.stem_line, self.head_axis
        bend = line[-1] + np.linspace(0, 1, 60)[1:, None] * 0.0
        start_tangent = (line[-1] - line[-2]) / np.linalg.norm(line[-1] - line[-2])
        t = np.linspace(0, 1, 80)[1:, None]
        reach = 0.017
        p1, p2 = line[-1] + 0.5 * reach * start_tangent, line[-1] + 0.5 * reach * start_tangent + 0.5 * reach * axis
        bend = (1 - t) ** 2 * line[-1] + 2 * t * (1 - t) * p1 + t * t * p2
        centre = np.vstack([line, bend])
        arc = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(centre, axis=0), axis=1))])
        rise = arc / arc[-1]
        radius = STEM_RADIUS_M * (1.06 - 0.14 * rise)
        flare = np.clip((arc - (arc[-1] - 0.010)) / 0.010, 0, 1)
        return Tube(centre, radius + 0.0058 * flare**1.6)

    @property
    def head_origin(self) -> Array:
        return self.stalk.centre[-1]

    @cached_property
    def head_rotation(self) -> Array:
        """Columns: x, axis, z of the head in the object's axes."""
        x = np.cross(self.head_axis, [0.0, 0.0, 1.0])
        x /= np.linalg.norm(x)
        return np.stack([x, self.head_axis, np.cross(x, self.head_axis)], 1)

    @cached_property
    def heart(self) -> Revolved:
        r = HEART_RADIUS_M
        corners = np.array([[0.0, 0.0], [0.8 * r, 0.0], [r, 0.0025], [0.80 * r, 0.0066], [0.42 * r, 0.0076], [0, 0.0068]])
        profile = rounded_profile(corners, np.array([0, 0.0012, 0.0022, 0.002, 0.0018, 0]), steps=6)
        return Revolved(profile, self.head_origin, self.head_rotation)

    def _on_stem(self, height_m: float) -> tuple[Array, Array]:
        """Point of the centre line at a height, and its tangent."""
        k = int(np.argmin(np.abs(self.stem_line[:, 1] - height_m)))
        tangent = self.stem_line[k + 1] - self.stem_line[k - 1]
        return self.stem_line[k], tangent / np.linalg.norm(tangent)

    def _leaf(
        self,
        height_m: float,
        azimuth_deg: float,
        rise_deg: float,
        length_m: float,
        half_width_m: float,
        *bends_deg: float,
    ) -> tuple[Blade, Tube]:
        """A leaf and its petiole, which runs on as a rib under the blade."""
        azimuth = np.deg2rad(azimuth_deg)
        outward = np.array([np.cos(azimuth), 0.0, np.sin(azimuth)])
        foot, _ = self._on_stem(height_m)
        rise = np.deg2rad(rise_deg)
        reach = 0.016 + 0.08 * length_m
        knee = foot + reach * (0.62 * np.cos(rise) * outward + 0.9 * np.sin(rise) * UP)
        start = np.deg2rad(bends_deg[0])
        base = knee + 0.5 * reach * (np.cos(start) * outward + np.sin(start) * UP)
        blade = Blade(
            origin=base,
            outward=outward,
            up=UP,
            length_m=length_m,
            half_width_m=half_width_m,
            thickness_m=LEAF_THICKNESS_M,
            base_power=0.72,
            tip_power=1.12,
            base_half_width_m=0.0016,
            elevation_start_deg=bends_deg[0],
            elevation_end_deg=bends_deg[1],
            roll_start_deg=bends_deg[2],
            roll_end_deg=bends_deg[3],
            fold=0.34,
            cup_per_m=-8.0,
            ripple=0.07,
            ripple_waves=2.6,
            ripple_phase=float(self.rng.uniform(0, 2 * np.pi)),
        )
        stalk_radius = 0.00165
        u = np.linspace(0, 0.42, 60)
        _, _, _, normal = blade.midrib(u)
        rib_radius = stalk_radius * (1 - 0.62 * u / u[-1])
        rib = blade.midrib(u)[0] - (LEAF_THICKNESS_M / 2 + 0.85 * rib_radius)[:, None] * normal
        along = rib[1] - rib[0]
        along /= np.linalg.norm(along)
        petiole = _bezier(np.array([foot, knee - 0.25 * reach * along, rib[0] - 0.45 * reach * along, rib[0]]), 60)
        centre = np.vstack([petiole, rib[1:]])
        radius = np.concatenate([np.full(60, stalk_radius) * np.linspace(1.18, 1.0, 60), rib_radius[1:]])
        return blade, Tube(centre, radius)

    def _petal(self, index: int) -> Blade:
        rng = self.rng
        turn = 2 * np.pi * (index + 0.13 * rng.uniform(-1, 1)) / PETAL_COUNT + 0.2
        x, axis, z = self.head_rotation.T
        outward = np.cos(turn) * x + np.sin(turn) * z
        lift = rng.uniform(-4, 4)
        return Blade(
            origin=self.head_origin + 0.0024 * axis + (HEART_RADIUS_M - 0.0004) * outward,
            outward=outward,
            up=axis,
            length_m=0.040 * (1 + 0.05 * rng.uniform(-1, 1)),
            half_width_m=0.0088 * (1 + 0.05 * rng.uniform(-1, 1)),
            thickness_m=PETAL_THICKNESS_M,
            base_power=0.85,
            tip_power=0.42,
            base_half_width_m=0.0022,
            elevation_start_deg=24 + lift,
            elevation_end_deg=-14 + 2 * lift,
            roll_start_deg=float(rng.uniform(-5, 5)),
            roll_end_deg=float(rng.uniform(-9, 9)),
            fold=0.0,
            cup_per_m=34.0,
            ripple=0.06,
            ripple_waves=1.4,
            ripple_phase=float(rng.uniform(0, 2 * np.pi)),
        )

    # -- samples and colour ------------------------------------------------------------------------------------

    def build(self) -> ZooObject:
        patches, albedos, labels, transmission, gloss = [], [], [], [], []

        def add(part: int, patch: Patch, albedo: Array, *, through: float, shine: float) -> None:
            patches.append(patch)
            albedos.append(albedo)
            labels.append(np.full(len(patch), part, np.int32))
            transmission.append(np.full(len(patch), through))
            gloss.append(np.full(len(patch), shine))

        rng, seed = self.rng, self.seed
        pot = self.pot.sample(self._visible_pot_line(), SPACING_M[POT], rng)
        add(POT, pot, texture.terracotta(pot.points, seed=seed + 1), through=0.0, shine=0.03)
        soil = self._soil_patch()
        add(SOIL, soil, texture.potting_soil(soil.points, seed=seed + 2), through=0.0, shine=0.0)
        rods = [self.stalk] + [petiole for _, petiole in self.leaves]
        for number, rod in enumerate(rods):
            patch = rod.sample(SPACING_M[STEM], rng)
            patch = _selected(patch, self._part_above(patch.points, number))
            color = texture.stem(patch.points, low_m=SOIL_HEIGHT_M, high_m=0.32, seed=seed + 3 + number)
            add(STEM, patch, color, through=0.0, shine=0.07)
        for number, (blade, _) in enumerate(self.leaves):
            patch = blade.sample(SPACING_M[LEAVES], rng)
            color = texture.leaf(
                patch.coords,
                (patch.normals * blade.frame(patch.coords[:, 0], patch.coords[:, 1] * blade.half_width(patch.coords[:, 0]))[1]).sum(1) > 0,
                length_to_width=blade.length_m / blade.half_width_m,
                youth=number / (len(self.leaves) - 1),
                seed=seed + 20 + number,
            )
            add(LEAVES, patch, color, through=0.30, shine=0.10)
        for number, blade in enumerate(self.petals):
            patch = blade.sample(SPACING_M[PETALS], rng)
            color = texture.petal(
                patch.coords,
                (patch.normals * blade.frame(patch.coords[:, 0], patch.coords[:, 1] * blade.half_width(patch.coords[:, 0]))[1]).sum(1) > 0,
                tint=float(rng.uniform(-1, 1)),
                seed=seed + 60 + number,
            )
            add(PETALS, patch, color, through=0.42, shine=0.03)
        heart = self.heart.sample(self.heart.profile, SPACING_M[HEART], rng)
        local = (heart.points - self.head_origin) @ self.head_rotation
        add(HEART, heart, texture.heart(local, radius_m=HEART_RADIUS_M, seed=seed + 90), through=0.1, shine=0.0)

        patch = joined(patches)
        label = np.concatenate(labels)
        irradiance = shading.bake_irradiance(patch.points, patch.normals, transmission=np.concatenate(transmission))
        color = shading.linear_to_srgb(shading.srgb_to_linear(np.concatenate(albedos)) * irradiance)
        sh = np.zeros((len(patch), 4, 3))
        sh[:, 0] = (color - 0.5) / SH_C0
        sh[:, 1:] = shading.gloss_sh1(patch.normals, np.concatenate(gloss))[:, :, None]
        axes = np.stack([patch.tangents, np.cross(patch.normals, patch.tangents), patch.normals], -1)
        gaussians = Gaussians(
            means=patch.points / METRES_PER_UNIT,
            quats_wxyz=Rotation.from_matrix(axes).as_quat()[:, [3, 0, 1, 2]],
            scales=patch.sigmas / METRES_PER_UNIT,
            opacities=np.full(len(patch), 0.97),
            sh=sh,
        )
        lower, upper = gaussians.robust_bounds(rotation=rotation_to_z_up(UP))
        height_m = float(upper[2] - lower[2]) * METRES_PER_UNIT
        return ZooObject(
            gaussians=gaussians,
            labels=label,
            part_names=PART_NAMES,
            up=UP,
            metres_per_unit=METRES_PER_UNIT,
            height_m=height_m,
            truth=self._truth(),
            default_scene=_default_scene(height_m),
            inside=self.inside,
        )

    def _visible_pot_line(self) -> Array:
        """The outline without the inner wall that lies under the soil."""
        line = self.pot_lines["whole"]
        inner = self.pot_lines["inner"]
        buried = SOIL_HEIGHT_M - 0.008
        keep = len(line) - len(inner)
        share = (inner[0, 1] - buried) / (inner[0, 1] - inner[1, 1])
        return np.vstack([line[: keep + 1], inner[0] + share * (inner[1] - inner[0])])

    def _part_above(self, points: Array, number: int) -> NDArray[np.bool_]:
        """Samples of a rod that can be seen: above the soil, and of petioles outside the main stem."""
        seen = points[:, 1] > self.soil_height(points[:, 0], points[:, 2]) - 0.002
        return seen & ~self.stalk.contains(points) if number else seen

    def _soil_patch(self) -> Patch:
        spacing = SPACING_M[SOIL]
        wall = float(np.interp(SOIL_HEIGHT_M, [0.008, 0.105], [0.0372, 0.0545])) + 0.0012
        rows = round(wall / spacing)
        ring = (np.arange(rows) + 0.5) / rows * wall
        counts = np.maximum(5, np.round(2 * np.pi * ring / spacing)).astype(np.int64)
        row, place = ragged_rows(counts)
        radius = ring[row] + self.rng.uniform(-0.2, 0.2, len(row)) * spacing
        angle = 2 * np.pi * (staggered(row, place, counts) + self.rng.uniform(-0.2, 0.2, len(row)) / counts[row])
        x, z = radius * np.cos(angle), radius * np.sin(angle)
        h = 0.0004
        dx = (self.soil_height(x + h, z) - self.soil_height(x - h, z)) / (2 * h)
        dz = (self.soil_height(x, z + h) - self.soil_height(x, z - h)) / (2 * h)
        normal = np.stack([-dx, np.ones_like(dx), -dz], 1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        tangent = np.stack([np.ones_like(dx), dx, np.zeros_like(dx)], 1)
        tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
        sigmas = np.tile([0.68 * spacing, 0.68 * spacing, 0.22 * spacing], (len(x), 1))
        return Patch(
            np.stack([x, self.soil_height(x, z), z], 1), normal, tangent, sigmas, np.stack([radius, angle], 1)
        )

    # -- truth -------------------------------------------------------------------------------------------------

    def inside(self, points: NDArray[Any]) -> NDArray[np.int32]:
        """Part that fills each point [M, 3] (input units), int32, -1 in the air."""
        p = np.asarray(points, np.float64) * METRES_PER_UNIT
        part = np.full(len(p), -1, np.int32)

        def fill(number: int, contained: NDArray[np.bool_]) -> None:
            part[(part < 0) & contained] = number

        fill(POT, self.pot.contains(p))
        fill(SOIL, self.cavity.contains(p) & (p[:, 1] < self.soil_height(p[:, 0], p[:, 2])))
        fill(HEART, self.heart.contains(p))
        for rod in [self.stalk] + [petiole for _, petiole in self.leaves]:
            fill(STEM, rod.contains(p))
        for blade, _ in self.leaves:
            fill(LEAVES, blade.contains(p))
        for blade in self.petals:
            fill(PETALS, blade.contains(p))
        return part

    def _truth(self) -> dict[str, PartTruth]:
        blades = [blade for blade, _ in self.leaves]
        stem_volume, stem_area = self._stem_truth()
        return {
            "pot": PartTruth(self.pot.volume_m3, thickness_m=WALL_M),
            "soil": PartTruth(self._soil_volume()),
            "stem": PartTruth(stem_volume, stem_area, 2 * STEM_RADIUS_M),
            "leaves": PartTruth(
                sum(b.volume_m3 for b in blades), sum(b.area_m2 for b in blades), LEAF_THICKNESS_M
            ),
            "petals": PartTruth(
                sum(b.volume_m3 for b in self.petals), sum(b.area_m2 for b in self.petals), PETAL_THICKNESS_M
            ),
            "heart": PartTruth(self.heart.volume_m3),
        }

    def _soil_volume(self) -> float:
        """Columns of soil over a polar grid, from the cavity's floor or wall to the surface."""
        r, turn = (np.arange(400) + 0.5) / 400 * 0.0545, (np.arange(180) + 0.5) / 180 * 2 * np.pi
        rr, tt = (g.ravel() for g in np.meshgrid(r, turn))
        inner = self.pot_lines["inner"][::-1]  # from the axis outwards and up
        floor = np.interp(rr, inner[:, 0], inner[:, 1])
        depth = np.maximum(self.soil_height(rr * np.cos(tt), rr * np.sin(tt)) - floor, 0)
        return float((depth * rr).sum() * (0.0545 / 400) * (2 * np.pi / 180))

    def _stem_truth(self) -> tuple[float, float]:
        """Volume and lateral area of the stem above the soil, petioles from the stem's surface on."""
        volume, area = 0.0, 0.0
        for number, rod in enumerate([self.stalk] + [petiole for _, petiole in self.leaves]):
            part = Tube(*_clipped(rod, self._part_above(rod.centre, number)))
            volume += part.volume_m3
            area += part.area_m2
        return volume, area


def _clipped(rod: Tube, keep: NDArray[np.bool_]) -> tuple[Array, Array]:
    return rod.centre[keep], rod.radius_m[keep]


def _selected(patch: Patch, keep: NDArray[np.bool_]) -> Patch:
    return Patch(*(getattr(patch, n)[keep] for n in ("points", "normals", "tangents", "sigmas", "coords")))


def _bezier(controls: Array, count: int) -> Array:
    """Points of a cubic Bezier curve, shape [count, 3]."""
    t = np.linspace(0, 1, count)[:, None]
    weights = (1 - t) ** 3, 3 * (1 - t) ** 2 * t, 3 * (1 - t) * t**2, t**3
    return sum((w * c for w, c in zip(weights, controls, strict=True)), np.zeros((count, 3)))


def _default_scene(height_m: float) -> dict[str, Any]:
    """Settings of the demo: the pot and its soil held, a gust moves the rest."""
    return {
        "up": "+y",
        "height_m": round(height_m, 5),
        "motion": "sway",
        "parts": {
            "pot": {"hold": "fixed", "material": "terracotta"},
            "soil": {"hold": "fixed", "material": "soil"},
            "stem": {"hold": "free", "material": "herbaceous stem"},
            "leaves": {"hold": "free", "material": "leaf blade"},
            "petals": {"hold": "free", "material": "petal"},
            "heart": {"hold": "free", "material": "herbaceous stem"},
        },
    }
