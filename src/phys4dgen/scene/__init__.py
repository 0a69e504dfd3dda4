"""The Scene: everything that a run is told (scene.yaml, Python or flags), frozen and validated."""

from phys4dgen.scene.model import Scene
from phys4dgen.scene.part_names import check_part_names, refuse_impossible_part_names
from phys4dgen.scene.sections import (
    ALL_PARTS,
    AccelerationForce,
    Ground,
    Grouping,
    Interior,
    Materials,
    Motion,
    Output,
    PartEdit,
    PartOptions,
    Reconstruct,
    Simulation,
    Video,
    ViewSet,
)
from phys4dgen.scene.yaml_file import dump_scene, load_scene, scene_keys

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
    "Scene",
    "Simulation",
    "Video",
    "ViewSet",
    "check_part_names",
    "dump_scene",
    "load_scene",
    "refuse_impossible_part_names",
    "scene_keys",
]
