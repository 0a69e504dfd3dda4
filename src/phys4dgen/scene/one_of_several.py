"""One of several objects as a scene of its own, in which it is understood as any single object is."""

from __future__ import annotations

from phys4dgen.scene.model import Scene
from phys4dgen.scene.part_names import SEPARATOR, joined_options
from phys4dgen.scene.sections import ALL_PARTS, Simulation

__all__ = ["scene_of_object"]


def scene_of_object(scene: Scene, name: str, *, cell_m: float | None = None) -> Scene:
    """The scene of one object alone, as far as its materials; pose, motion and film are not of it.

    Args:
        scene: of several objects.
        name: of the object.
        cell_m: grid cell that all objects share, metres; None before it is known.
    """
    placed = scene.objects[name]
    prefix = f"{name}{SEPARATOR}"
    parts = {key.removeprefix(prefix): options for key, options in scene.parts.items() if key.startswith(prefix)}
    of_all = joined_options(scene, (ALL_PARTS, name))
    if of_all is not None:
        parts[ALL_PARTS] = of_all
    hollow = {key.removeprefix(prefix): wall for key, wall in scene.interior.hollow.items() if key.startswith(prefix)}
    backend = "rule" if scene.materials.backend == "file" else scene.materials.backend
    return Scene(
        input=placed.input,
        up=placed.up,
        height_m=placed.height_m,
        longest_m=placed.longest_m,
        seed=scene.seed,
        reconstruct=placed.reconstruct or scene.reconstruct,
        select=placed.select,
        views=scene.views,
        grouping=placed.grouping or scene.grouping,
        interior=scene.interior.model_copy(update={"hollow": hollow}),
        materials=scene.materials.model_copy(update={"file": None, "backend": backend}),  # which speaks of all objects
        clip=scene.clip,
        parts=parts,
        simulation=Simulation(cell_m=cell_m),
    )
