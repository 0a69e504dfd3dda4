"""The sections of a scene, one file each; the docstring of a key is its documentation."""

from phys4dgen.scene.sections.boundaries import Ground
from phys4dgen.scene.sections.forces import AccelerationForce
from phys4dgen.scene.sections.grouping import Grouping, PartEdit
from phys4dgen.scene.sections.interior import Interior
from phys4dgen.scene.sections.materials import Materials
from phys4dgen.scene.sections.motion import Motion
from phys4dgen.scene.sections.output import Output, Video
from phys4dgen.scene.sections.parts import PartOptions
from phys4dgen.scene.sections.reconstruct import Reconstruct
from phys4dgen.scene.sections.simulation import Simulation
from phys4dgen.scene.sections.values import ALL_PARTS
from phys4dgen.scene.sections.views import ViewSet

__all__ = [
    "ALL_PARTS",
    "AccelerationForce",
    "Ground",
    "Grouping",
    "Interior",
    "Materials",
    "Motion",
    "Output",
    "PartEdit",
    "PartOptions",
    "Reconstruct",
    "Simulation",
    "Video",
    "ViewSet",
]
