"""The bundled objects by name: what ``demo --scene NAME`` can show."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from phys4dgen.errors import SceneError, did_you_mean
from phys4dgen.zoo.balloon import balloon
from phys4dgen.zoo.basketball import basketball
from phys4dgen.zoo.carnation import carnation
from phys4dgen.zoo.cup import cup
from phys4dgen.zoo.hamburger import hamburger
from phys4dgen.zoo.hammer import hammer
from phys4dgen.zoo.jelly_honey_water import jelly_honey_water
from phys4dgen.zoo.lights import LIGHTS
from phys4dgen.zoo.potted_flower import potted_flower
from phys4dgen.zoo.rubber_duck import rubber_duck
from phys4dgen.zoo.sandcastle import sandcastle
from phys4dgen.zoo.snowman import snowman
from phys4dgen.zoo.straw_hat import straw_hat
from phys4dgen.zoo.telephone import telephone
from phys4dgen.zoo.zoo_object import ZooObject

__all__ = ["BUNDLED", "Builder", "bundled"]


class Builder(Protocol):
    """Makes an object; the same seed and light give the same arrays."""

    def __call__(self, *, seed: int = 0, light: str = "studio") -> ZooObject:
        """Build it."""
        ...


BUNDLED: Mapping[str, Builder] = {
    "potted_flower": potted_flower,
    "snowman": snowman,
    "hammer": hammer,
    "carnation": carnation,
    "hamburger": hamburger,
    "basketball": basketball,
    "rubber_duck": rubber_duck,
    "sandcastle": sandcastle,
    "telephone": telephone,
    "straw_hat": straw_hat,
    "balloon": balloon,
    "cup": cup,
    "jelly_honey_water": jelly_honey_water,
}


def bundled(name: str, *, seed: int = 0, light: str = "studio") -> ZooObject:
    """Build a bundled object.

    Args:
        name: a key of ``BUNDLED``.
        seed: of the small irregularities.
        light: a key of ``lights.LIGHTS``: studio, overcast, evening, backlit, or unlit (plain albedo).

    Raises:
        SceneError: there is no such object or light.
    """
    for value, known, what in ((name, BUNDLED, "bundled scene"), (light, LIGHTS, "light")):
        if value not in known:
            raise SceneError(f"{what}: expected one of {', '.join(known)}, got '{value}'.{did_you_mean(value, known)}")
    return BUNDLED[name](seed=seed, light=light)
