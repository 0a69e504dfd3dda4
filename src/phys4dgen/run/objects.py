"""Several objects in one run: each is understood in a run folder of its own, RUN/objects/NAME.

So everything that holds for one object holds for each of several: its stages are reused by content, its materials.yaml
may be edited, and an edit of one does not touch the others.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from phys4dgen.progress import SILENT, Progress
from phys4dgen.run.folder import RunFolder
from phys4dgen.run.recorder import RecordingProgress
from phys4dgen.run.report import PartReport
from phys4dgen.run.stages import stages_until
from phys4dgen.scene import SEPARATOR, Scene, scene_of_object

if TYPE_CHECKING:
    from phys4dgen.run.store import RunStore
    from phys4dgen.stages.several import ReadyObject

__all__ = ["Fill", "ObjectReport", "object_reports", "products_of_objects", "understand_objects"]

Fill = Callable[[RunFolder, Scene, Sequence[str], RecordingProgress], "RunStore"]
"""Runs the stages named of a scene in a run folder."""

_LAST_STAGE = "materials"
"""Of an object by itself."""

_JOINED = {"objects' parts": ("parts", "part names"), "objects' particles": ("particles",)}
_JOINED |= {"objects' materials": ("materials",)}


@dataclass(frozen=True)
class ObjectReport:
    """One of several objects in numbers, and what was assumed of it.

    Attributes:
        name: in the scene.
        input: its file.
        up: which way is up in its own coordinates, as given or found.
        up_was_given: else it was guessed, or its file says it.
        height_m: extent along up before it was turned.
        size_was_given: else it was assumed.
        metres_per_unit: of its own coordinates.
        position_m, rotation_deg, velocity_ms, spin_deg_s: as the scene says.
        gaussians: Gaussians of the object.
        particles: simulated particles of the object.
        mass_g: true mass, grams.
        parts: their names.
        warnings: what its own run warned of.
    """

    name: str
    input: str
    up: Sequence[float]
    up_was_given: bool
    height_m: float
    size_was_given: bool
    metres_per_unit: float
    position_m: Sequence[float]
    rotation_deg: Sequence[float]
    velocity_ms: Sequence[float]
    spin_deg_s: Sequence[float]
    gaussians: int
    particles: int
    mass_g: float
    parts: Sequence[str]
    warnings: Sequence[str]


class _OfObject:
    """Passes on what is told of one object: warnings under its name, and how far it is; notes stay in its own run."""

    def __init__(self, inner: Progress, name: str) -> None:
        self._inner, self._name = inner, name

    def stage(self, name: str) -> None:
        """A stage of the object is a step of the scene's own."""

    def update(self, done: float, total: float, text: str = "") -> None:
        """Pass on."""
        self._inner.update(done, total, text)

    def note(self, text: str) -> None:
        """Its own log and report have it."""

    def warn(self, text: str) -> None:
        """Pass on, with the name of the object."""
        self._inner.warn(f"{self._name}: {text}")


def understand_objects(
    run: RunFolder, scene: Scene, fill: Fill, *, until: str, cell_m: float | None, progress: Progress
) -> list[ReadyObject]:
    """Every object of a scene by itself, up to and with the stage ``until`` or its materials.

    Args:
        run: of the scene, claimed.
        scene: of several objects.
        fill: makes what is missing in the run folder of one object.
        until: last stage wanted.
        cell_m: grid cell that all share, metres; None before it is known.
        progress: told of each.
    """
    from phys4dgen.stages.asset import load
    from phys4dgen.stages.several import ReadyObject

    stages = stages_until(_LAST_STAGE)
    stages = stages[: stages.index(until) + 1] if until in stages else stages
    ready = []
    for name in scene.objects:
        progress.stage(f"object {name}")
        own_scene = scene_of_object(scene, name, cell_m=cell_m)
        recorder = RecordingProgress(_OfObject(progress, name))
        with RunFolder(run.objects / name).claim() as folder:
            store = fill(folder, own_scene, stages, recorder)
        source = store.result("reconstruct")
        made = {key: store.result(stage) for key, stage in _RESULTS.items() if stage in stages}
        own = ReadyObject(
            name,
            store.asset or load(own_scene, source, SILENT),
            source.backend,
            products=store.products,
            warnings=tuple(recorder.warnings),
            **made,
        )
        if own.parts is not None and own.interior is not None:
            progress.note(
                f"{name}: {own.parts.count} parts ({', '.join(own.parts.names)}), {len(own.interior.continuum)} "
                f"particles, {own.asset.height_m:.3g} m tall."
            )
        ready.append(own)
    return ready


_RESULTS = {"parts": "grouping", "interior": "interior", "book": "materials"}


def products_of_objects(objects: Sequence[ReadyObject]) -> dict[str, str]:
    """Digests of what the stages of all objects made, as far as they went."""
    joined = {}
    for name, of_one in _JOINED.items():
        if all(product in own.products for own in objects for product in of_one):
            words = [f"{own.name} {own.products[product]}" for own in objects for product in of_one]
            joined[name] = hashlib.sha256("\n".join(words).encode()).hexdigest()
    return joined


def object_reports(scene: Scene, objects: Sequence[ReadyObject], parts: Sequence[PartReport]) -> list[ObjectReport]:
    """What the report says of each object."""
    reports = []
    for own in objects:
        placed = scene.objects[own.name]
        mine = [part for part in parts if part.name.startswith(f"{own.name}{SEPARATOR}")]
        pose: Mapping[str, Any] = {
            key: getattr(placed, key) for key in ("position_m", "rotation_deg", "velocity_ms", "spin_deg_s")
        }
        reports.append(
            ObjectReport(
                name=own.name,
                input=placed.input.as_posix(),
                up=own.asset.frame.up.tolist(),
                up_was_given=placed.up != "auto",
                height_m=own.asset.height_m,
                size_was_given=placed.height_m != "auto" or placed.longest_m is not None,
                metres_per_unit=own.asset.frame.metres_per_unit,
                **pose,
                gaussians=len(own.asset.gaussians),
                particles=sum(part.particles for part in mine),
                mass_g=sum(part.mass_g for part in mine),
                parts=[] if own.parts is None else own.parts.names,
                warnings=own.warnings,
            )
        )
    return reports
