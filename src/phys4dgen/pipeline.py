"""From a splat to a film: the stages in order, one line each.

A stage is a function of core types. What it made is kept by a ``Store`` (a run folder, ``run/generate.py``), which
also recalls it, so that an interrupted run goes on where it stopped.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, TypeVar

from phys4dgen.progress import SILENT, Progress
from phys4dgen.scene import Scene, check_part_names, refuse_impossible_part_names
from phys4dgen.stages.asset import load
from phys4dgen.stages.film import film
from phys4dgen.stages.grouping import group
from phys4dgen.stages.interior import fill
from phys4dgen.stages.materials import identify
from phys4dgen.stages.motion import move
from phys4dgen.stages.views import look

__all__ = ["Store", "animate_scene"]

T = TypeVar("T")


class Store(Protocol):
    """Keeps what the stages make."""

    def recall(self, stage: str, inputs: dict[str, Any]) -> Any | None:
        """What ``stage`` made in an earlier run with the same input and settings, or None."""
        ...

    def keep(self, stage: str, result: Any, inputs: dict[str, Any]) -> Any:
        """Keep the result of ``stage``; return it, or what stands for it from now on."""
        ...


def animate_scene(scene: Scene, store: Store, *, until: str = "render", progress: Progress = SILENT) -> None:
    """Run the stages of a scene up to and with ``until``."""
    refuse_impossible_part_names(scene)
    asset = load(scene, progress)

    def stage(name: str, make: Callable[[], T], **inputs: Any) -> T:
        progress.stage(name)
        found = store.recall(name, {"asset": asset, **inputs})
        if found is not None:
            progress.note(f"{name}: taken from the run folder.")
            return found
        return store.keep(name, make(), {"asset": asset, **inputs})

    views = stage("views", lambda: look(scene, asset, progress))
    if until == "views":
        return
    parts = stage("grouping", lambda: group(scene, asset, views, progress), views=views)
    check_part_names(scene, parts.names)
    if until == "grouping":
        return
    interior = stage("interior", lambda: fill(scene, asset, parts, progress), parts=parts)
    if until == "interior":
        return
    book = stage("materials", lambda: identify(scene, asset, parts, interior, progress), parts=parts)
    if until == "materials":
        return
    motion = stage("simulate", lambda: move(scene, asset, parts, interior, book, progress), parts=parts, book=book)
    if until == "simulate":
        return
    stage("render", lambda: film(scene, asset, motion, progress), motion=motion)
