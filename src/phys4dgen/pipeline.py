"""From a picture or a splat to a film: the stages in order, one line each.

A stage is a function of core types. What it made is kept by a ``Store`` (a run folder, ``run/store.py``), which also
recalls it, so that an interrupted run goes on where it stopped and an edit redoes only what depends on it. A result
stands as a function that returns it: what nobody asks for is not read back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol, TypeVar

from phys4dgen.grouping.merging import MergeTree
from phys4dgen.progress import SILENT, Progress
from phys4dgen.scene import Scene, check_part_names, refuse_impossible_part_names
from phys4dgen.stages.asset import Asset, load
from phys4dgen.stages.film import film
from phys4dgen.stages.grouping import find_tree, group
from phys4dgen.stages.interior import fill
from phys4dgen.stages.materials import identify
from phys4dgen.stages.motion import move
from phys4dgen.stages.reconstruct import reconstruct
from phys4dgen.stages.several import (
    ReadyObject,
    join_books,
    join_interiors,
    join_parts,
    put_together,
    shared_cell_m,
)
from phys4dgen.stages.views import look

__all__ = ["Store", "animate_scene"]

T = TypeVar("T")


class Store(Protocol):
    """Keeps what the stages make."""

    def begin(self) -> None:
        """The stages follow."""
        ...

    def objects(self, until: str, cell_m: float | None) -> Sequence[ReadyObject]:
        """The objects of a scene of several, each understood by itself up to and with the stage ``until``.

        ``cell_m`` is the grid cell that they share; None before it is known.
        """
        ...

    def hold(self, asset: Asset) -> None:
        """The object, for the stages after ``reconstruct``."""
        ...

    def recall(self, stage: str, make: Callable[[], Any]) -> Callable[[], Any] | None:
        """Returns what ``stage`` made in an earlier run, or is None where it has to be made (again).

        ``make`` makes it, for what is not stored to the last bit.
        """
        ...

    def keep(self, stage: str, result: Any) -> Callable[[], Any]:
        """Keep the result of ``stage``; returns it, or what stands for it from now on."""
        ...

    def keep_tree(self, make: Callable[[], MergeTree]) -> Callable[[], MergeTree]:
        """Returns the merge tree of the object's surface, which is kept beside the parts.

        ``make`` makes it when it is first needed and none is kept that still holds.
        """
        ...

    def place(self, name: str) -> Path:
        """A folder of that name in which a stage may keep what it was told from outside."""
        ...


def animate_scene(scene: Scene, store: Store, *, until: str = "render", progress: Progress = SILENT) -> None:
    """Run the stages of a scene up to and with ``until``."""
    refuse_impossible_part_names(scene)
    store.begin()

    def stage(name: str, make: Callable[[], T]) -> Callable[[], T]:
        progress.stage(name)
        found = store.recall(name, make)
        return store.keep(name, make()) if found is None else found

    several = _understood(scene, store, until, progress) if scene.objects else None
    if several is None:
        source = stage("reconstruct", lambda: reconstruct(scene, progress))
    else:
        source = stage("reconstruct", lambda: put_together(scene, *several))
    if until == "reconstruct":
        return
    asset = load(scene, source(), progress)
    store.hold(asset)
    views = stage("views", lambda: look(scene, asset, progress))
    if until == "views":
        return
    if several is None:
        tree = store.keep_tree(lambda: find_tree(scene, asset, views(), progress))
        parts = stage("grouping", lambda: group(scene, asset, views(), tree, store.place("segments"), progress))
    else:
        parts = stage("grouping", lambda: join_parts(several[0]))
    check_part_names(scene, parts().names)
    if until == "grouping":
        return
    if several is None:
        interior = stage("interior", lambda: fill(scene, asset, parts(), progress))
    else:
        interior = stage("interior", lambda: join_interiors(scene, several[0], asset, progress))
    if until == "interior":
        return
    if several is None:
        run = store.place("")
        book = stage("materials", lambda: identify(scene, source(), asset, parts(), interior(), run, progress))
    else:
        book = stage("materials", lambda: join_books(scene, several[0], parts(), progress))
    if until == "materials":
        return
    motion = stage("simulate", lambda: move(scene, asset, parts(), interior(), book(), progress))
    if until == "simulate":
        return
    stage("render", lambda: film(scene, asset, motion(), progress))


def _understood(scene: Scene, store: Store, until: str, progress: Progress) -> tuple[Sequence[ReadyObject], float]:
    """Several objects, each by itself as far as its materials, and the grid cell that they share in metres."""
    sized = store.objects("reconstruct", None)
    cell_m = shared_cell_m(scene, {own.name: own.asset for own in sized}, progress)
    return store.objects(until, cell_m), cell_m
