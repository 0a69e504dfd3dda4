"""Three rounded cubes of 6 cm side by side: jelly, honey and water, each as it would stand if it could."""

from __future__ import annotations

from phys4dgen.zoo.assembly import Part, assemble
from phys4dgen.zoo.forms import placed, rounded_box, turned_deg
from phys4dgen.zoo.implicit import Implicit
from phys4dgen.zoo.paints import mottled
from phys4dgen.zoo.zoo_object import ZooObject

__all__ = ["jelly_honey_water"]

SIDE_M = 0.060
APART_M = 0.110
"""From middle to middle."""


def jelly_honey_water(*, seed: int = 0, light: str = "studio") -> ZooObject:
    """Build the cubes.

    Args:
        seed: of the small irregularities.
        light: a name in ``lights.LIGHTS``.
    """
    return assemble(
        [
            Part(
                "jelly", "gelatin", [_cube(-1)], 0.0016,
                mottled("8f1424", "e8475a", wavelength_m=0.018, seed=seed + 1), gloss=0.14,
            ),
            Part(
                "honey", "honey", [_cube(0)], 0.0016,
                mottled("a8600c", "f2b53a", wavelength_m=0.022, seed=seed + 2, stretch=(1, 3, 1)), gloss=0.14,
            ),
            Part(
                "water", "water", [_cube(1)], 0.0016,
                mottled("2f6f9f", "a9d7ee", wavelength_m=0.020, seed=seed + 3), gloss=0.16,
            ),
        ],
        metres_per_unit=0.28, motion="drop", seed=seed, light=light,
    )  # fmt: skip


def _cube(place: int) -> Implicit:
    half = SIDE_M / 2
    return placed(rounded_box((half, half, half), 0.006), (place * APART_M, half, 0), turned_deg(y=8.0 * place))
