"""phys4dgen: one image or one 3D Gaussian splat in, 4D content that obeys physics out.

The public names below are imported when they are first used, so that ``import phys4dgen`` costs nothing.
"""

from __future__ import annotations

import importlib
import os
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from phys4dgen.errors import Phys4DGenError
    from phys4dgen.formats import load_gaussians, save_gaussians
    from phys4dgen.mpm import Body, Settings, Simulator
    from phys4dgen.run.generate import Run, generate
    from phys4dgen.scene import Scene, dump_scene, load_scene
    from phys4dgen.types import Camera, Continuum, Gaussians, Material, MaterialBook, Parts, Trajectory, Views

# Numba's OpenMP threads spin at barriers by default. The solver has two barriers in half a millisecond; beside any
# other busy process a spinning thread waits for one that is not running, and two threads become ten times slower than
# one. Must stand before the first parallel kernel loads the OpenMP library; the user's own choice wins.
# GNU's library may spin for a moment before it sleeps (some 0.1 ms), so that quiet machines pay little for a barrier.
if "OMP_WAIT_POLICY" not in os.environ:
    os.environ["OMP_WAIT_POLICY"] = "PASSIVE"
    os.environ.setdefault("GOMP_SPINCOUNT", "4000")

__all__ = [
    "Body",
    "Camera",
    "Continuum",
    "Gaussians",
    "Material",
    "MaterialBook",
    "Parts",
    "Phys4DGenError",
    "Run",
    "Scene",
    "Settings",
    "Simulator",
    "Trajectory",
    "Views",
    "dump_scene",
    "generate",
    "load_gaussians",
    "load_scene",
    "save_gaussians",
]

_HOMES = {
    "errors": ("Phys4DGenError",),
    "formats": ("load_gaussians", "save_gaussians"),
    "mpm": ("Body", "Settings", "Simulator"),
    "run.generate": ("Run", "generate"),
    "scene": ("Scene", "dump_scene", "load_scene"),
    "types": ("Camera", "Continuum", "Gaussians", "Material", "MaterialBook", "Parts", "Trajectory", "Views"),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module 'phys4dgen' has no attribute '{name}'")
    return getattr(importlib.import_module(f"phys4dgen.{_HOME_OF[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
