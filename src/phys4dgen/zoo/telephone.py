"""A dial telephone, 0.14 m tall: body and handset of red plastic, a pale dial, a coiled cord."""

from __future__ import annotations

import numpy as np

from phys4dgen.zoo.assembly import Paint, Part, assemble
from phys4dgen.zoo.forms import blended, carved, lathe, placed, rod, rounded_box, turned_deg
from phys4dgen.zoo.implicit import Implicit
from phys4dgen.zoo.paints import mottled
from phys4dgen.zoo.patch import Array, Patch
from phys4dgen.zoo.solids import Tube, bezier, rounded_profile
from phys4dgen.zoo.texture import fractal_noise, mix, srgb
from phys4dgen.zoo.zoo_object import ZooObject

__all__ = ["telephone"]

SLOPE_DEG = 32.0
"""Of the front, away from the vertical towards the horizontal plane that faces up."""
DIAL_M = np.array([0.0, 0.0680, 0.0480])
HANDSET_M = 0.1100
"""Height of the middle of the handset's grip."""
CORD_RADIUS_M = 0.0022
COIL_RADIUS_M = 0.0068
COIL_TURNS = 36
# From the mouthpiece down to the table, along it and up into the back of the body.
CORD_CONTROLS_M = np.array(
    [[-0.101, 0.094, -0.032], [-0.190, -0.090, 0.090], [-0.215, 0.020, -0.030], [-0.070, 0.022, -0.045]]
)


def telephone(*, seed: int = 0, light: str = "studio") -> ZooObject:
    """Build the telephone; its dial looks towards +z.

    Args:
        seed: of the small irregularities.
        light: a name in ``lights.LIGHTS``.
    """
    cord = _cord()
    return assemble(
        [
            Part("body", "abs", [_body()], 0.0023, _red(seed + 1), gloss=0.14),
            Part(
                "cord", "pvc_flexible", [cord], 0.0016,
                mottled("8e1820", "c23038", wavelength_m=0.006, seed=seed + 2),
                precedence=1, gloss=0.08, area_m2=cord.area_m2, thickness_m=2 * CORD_RADIUS_M,
            ),
            Part("dial", "aluminium", [_dial()], 0.0014, _numbered(seed + 3), precedence=2, gloss=0.08),
            Part("handset", "abs", [_handset()], 0.0019, _red(seed + 4), precedence=3, gloss=0.14),
        ],
        metres_per_unit=0.25, motion="sway", held=["body", "dial", "handset"], seed=seed, light=light,
    )  # fmt: skip


def _red(seed: int) -> Paint:
    """Moulded plastic, a little faded here and there."""
    return mottled("98101a", "c8242b", wavelength_m=0.05, seed=seed)


def _body() -> Implicit:
    """A wedge with a sloping front and a cradle of two forks."""
    block = rounded_box((0.080, 0.046, 0.072), 0.016, (0, 0.046, 0))
    front = placed(rounded_box((0.2, 0.1, 0.1), 0.001, (0, 0, 0.1)), DIAL_M, turned_deg(x=-90 + SLOPE_DEG))
    wedge = carved(block, front, radius_m=0.010)
    shoulder = rounded_box((0.056, 0.014, 0.028), 0.010, (0, 0.090, -0.034))
    forks = [
        rod([[x, 0.092, z], [1.06 * x, 0.118, z + 0.10 * (z + 0.034)]], [0.0070, 0.0048])
        for x in (-0.040, 0.040)
        for z in (-0.048, -0.020)
    ]
    return blended(0.008, wedge, shoulder, *forks)


def _dial() -> Implicit:
    """A disc with ten finger holes and a hub, square to the front."""
    corners = np.array(
        [
            [0, -0.003], [0.0400, -0.003], [0.0400, 0.0030], [0.0360, 0.0055], [0.0190, 0.0055], [0.0165, 0.0075],
            [0, 0.0075],
        ]
    )  # fmt: skip
    disc = lathe(rounded_profile(corners, np.array([0, 0, 0.0015, 0.002, 0.001, 0.002, 0])))
    turns = np.deg2rad(np.arange(10) * 30.0 - 45)
    holes = [
        rod([[0.0275 * np.cos(t), 0.0065, 0.0275 * np.sin(t)], [0.0275 * np.cos(t), 0.02, 0.0275 * np.sin(t)]], 0.0058)
        for t in turns
    ]
    return placed(carved(disc, *holes, radius_m=0.001), DIAL_M, turned_deg(x=SLOPE_DEG))


def _handset() -> Implicit:
    """A bowed grip between an earpiece and a mouthpiece, lying in the cradle."""
    t = np.linspace(-1, 1, 13)
    grip = np.stack([0.088 * t, HANDSET_M + 0.018 - 0.012 * t * t, -0.034 + 0 * t], 1)
    caps = [
        placed(lathe(_cap()), (0.098 * side, HANDSET_M - 0.020, -0.034), turned_deg(z=-14 * side)) for side in (-1, 1)
    ]
    return blended(0.014, rod(grip, 0.0115 + 0.002 * t * t), *caps)


def _cap() -> Array:
    corners = np.array([[0, 0], [0.0255, 0], [0.0275, 0.010], [0.0170, 0.030], [0, 0.030]])
    return rounded_profile(corners, np.array([0, 0.003, 0.006, 0.008, 0]))


def _cord() -> Tube:
    """A coil along its path; both ends run out straight and plug in."""
    path = bezier(CORD_CONTROLS_M, 1600)
    path[:, 1] = np.maximum(path[:, 1], COIL_RADIUS_M + CORD_RADIUS_M)
    path = _evened(_smoothed(path, 60))
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.cross(tangent, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(tangent, side)
    share = np.linspace(0, 1, len(path))
    radius = COIL_RADIUS_M * np.clip(np.minimum(share, 1 - share) / 0.05, 0, 1)[:, None]
    turn = 2 * np.pi * COIL_TURNS * share[:, None]
    return Tube(path + radius * (np.cos(turn) * side + np.sin(turn) * other), np.full(len(path), CORD_RADIUS_M))


def _evened(path: Array) -> Array:
    """The same path with its nodes at equal distances."""
    arc = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    even = np.linspace(0, arc[-1], len(path))
    return np.stack([np.interp(even, arc, path[:, axis]) for axis in range(3)], 1)


def _smoothed(path: Array, window: int) -> Array:
    """Moving average that keeps the ends."""
    padded = np.vstack([np.repeat(path[:1], window, 0), path, np.repeat(path[-1:], window, 0)])
    sums = np.cumsum(padded, axis=0)
    return (sums[2 * window :] - sums[: -2 * window]) / (2 * window)


def _numbered(seed: int) -> Paint:
    """Ivory with dark wells under the holes and a brushed hub."""
    ivory = mottled("cfc6b0", "f2ecdb", wavelength_m=0.012, seed=seed)

    def paint(patch: Patch) -> Array:
        local = (patch.points - DIAL_M) @ turned_deg(x=SLOPE_DEG)
        radius = np.hypot(local[:, 0], local[:, 2])
        hub = np.clip((0.0172 - radius) / 0.0012, 0, 1)
        well = np.clip((0.0040 - local[:, 1]) / 0.0012, 0, 1) * (radius < 0.0345) * (radius > 0.0205)
        brushed = 0.5 + 0.5 * fractal_noise(local * [1, 1, 0.15], 0.004, seed=seed + 1)
        color = mix(ivory(patch), mix(srgb("8d9094"), srgb("c9cbcc"), brushed), hub)
        return mix(color, srgb("2b2a2c"), 0.9 * well)

    return paint
