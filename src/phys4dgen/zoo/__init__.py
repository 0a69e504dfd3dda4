"""Bundled objects of our own making, whose parts, areas, thicknesses and inside are known exactly."""

from phys4dgen.zoo.catalogue import BUNDLED, bundled
from phys4dgen.zoo.potted_flower import potted_flower
from phys4dgen.zoo.zoo_object import PartTruth, ZooObject

__all__ = ["BUNDLED", "PartTruth", "ZooObject", "bundled", "potted_flower"]
