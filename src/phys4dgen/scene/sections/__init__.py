"""The sections of a scene, one file each; the docstring of a key is its documentation."""

from phys4dgen.scene.sections.boundaries import (
    Boundary,
    BoxObstacle,
    CapsuleObstacle,
    Container,
    Ground,
    Obstacle,
    Pin,
    PlaneObstacle,
    Plate,
    Release,
    SphereObstacle,
    Waypoint,
)
from phys4dgen.scene.sections.changes import MaterialChange
from phys4dgen.scene.sections.forces import (
    AccelerationForce,
    Attractor,
    Force,
    Impulse,
    Noise,
    PerParticleForce,
    RotationSet,
    TotalForce,
    VelocitySet,
    Vortex,
    Wind,
)
from phys4dgen.scene.sections.grouping import Grouping, PartEdit
from phys4dgen.scene.sections.interior import Interior
from phys4dgen.scene.sections.materials import Materials
from phys4dgen.scene.sections.motion import Motion
from phys4dgen.scene.sections.objects import PlacedObject
from phys4dgen.scene.sections.output import Output, Video
from phys4dgen.scene.sections.parts import PartOptions
from phys4dgen.scene.sections.reconstruct import Reconstruct
from phys4dgen.scene.sections.regions import BoxRegion, CylinderRegion, Region, SphereRegion
from phys4dgen.scene.sections.select import Select
from phys4dgen.scene.sections.simulation import Simulation
from phys4dgen.scene.sections.values import ALL_PARTS
from phys4dgen.scene.sections.views import ViewSet

__all__ = [
    "ALL_PARTS",
    "AccelerationForce",
    "Attractor",
    "Boundary",
    "BoxObstacle",
    "BoxRegion",
    "CapsuleObstacle",
    "Container",
    "CylinderRegion",
    "Force",
    "Ground",
    "Grouping",
    "Impulse",
    "Interior",
    "MaterialChange",
    "Materials",
    "Motion",
    "Noise",
    "Obstacle",
    "Output",
    "PartEdit",
    "PartOptions",
    "PerParticleForce",
    "Pin",
    "PlacedObject",
    "PlaneObstacle",
    "Plate",
    "Reconstruct",
    "Region",
    "Release",
    "RotationSet",
    "Select",
    "Simulation",
    "SphereObstacle",
    "SphereRegion",
    "TotalForce",
    "VelocitySet",
    "Video",
    "ViewSet",
    "Vortex",
    "Waypoint",
    "Wind",
]
