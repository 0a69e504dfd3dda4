"""Keeps what the stages make in a run folder, and recalls what an earlier run has made from the same."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from phys4dgen.errors import RunError
from phys4dgen.export.pictures import write_png
from phys4dgen.grouping.merging import MergeTree
from phys4dgen.interior import Interior
from phys4dgen.render.views import render_label_maps
from phys4dgen.run.artefacts import (
    read_groups,
    read_interior,
    read_tree,
    write_groups,
    write_interior,
    write_part_maps,
    write_parts_picture,
    write_tree,
    write_views,
)
from phys4dgen.run.digests import book_products, interior_products, needs_digest, parts_products
from phys4dgen.run.film_files import Frames, write_film
from phys4dgen.run.folder import RunFolder
from phys4dgen.run.group_edits import spare_edited_groups
from phys4dgen.run.material_edits import current_book, edited_materials, with_edits, write_both
from phys4dgen.run.motion_files import products_of_motion, recalled_facts, recalled_motion, write_motion
from phys4dgen.run.objects import Fill, products_of_objects, understand_objects
from phys4dgen.run.prediction import peak_bytes, predicted_bytes
from phys4dgen.run.recorder import RecordingProgress
from phys4dgen.run.report import PartReport, part_reports
from phys4dgen.run.source_files import read_source, write_source
from phys4dgen.run.stages import MERGE_TREE, STAGES, Needs, scene_settings, stage_named
from phys4dgen.run.state import StageRecord
from phys4dgen.scene import ALL_PARTS, Scene, object_of
from phys4dgen.stages.asset import Asset
from phys4dgen.stages.film import Film
from phys4dgen.stages.interior import settled_thickness
from phys4dgen.stages.motion import Motion
from phys4dgen.stages.motion_facts import MotionFacts
from phys4dgen.stages.reconstruct import Source
from phys4dgen.stages.selection_picture import selection_picture
from phys4dgen.stages.several import ReadyObject
from phys4dgen.types import Masks, Material, MaterialBook, Parts, Views

__all__ = ["RunStore"]

MaterialOf = tuple[str, str]
"""Name of a part, and surface or interior."""

Recalled = tuple[Callable[[], Any], Mapping[str, str]]
"""What returns the result, and the digests of what it holds."""


@dataclass
class RunStore:
    """The ``Store`` of ``pipeline.py`` on a run folder; it also collects what the report says about the results.

    Attributes:
        run: the folder, claimed.
        scene: what was asked for.
        progress: told what is reused, and why something is made again.
        fill: makes what is missing in the run folder of one of several objects.
        since: first stage that this command means to make; those before it hold although phys4dgen itself changed.
        again: make ``since`` again although nothing has changed.
        only: refuse to make a stage before ``since``.
        refused: it was, so that the run stays as it is.
        counts: gaussians, particles, parts ... for the report.
        backends: what did each stage.
        parts: the parts in numbers.
        facts: what the simulation decided and found.
        asset: the object, once it is read.
        ready: the objects, where there are several, as far as they are understood.
    """

    run: RunFolder
    scene: Scene
    progress: RecordingProgress
    fill: Fill
    since: str = STAGES[0].name
    again: bool = False
    only: bool = False
    refused: bool = False
    counts: dict[str, int] = field(default_factory=dict)
    backends: dict[str, str] = field(default_factory=dict)
    parts: list[PartReport] = field(default_factory=list)
    facts: MotionFacts | None = None
    asset: Asset | None = None
    ready: Sequence[ReadyObject] = ()
    _settings: dict[str, Any] = field(default_factory=dict)
    _products: dict[str, str] = field(default_factory=dict)
    _made: dict[str, Callable[[], Any]] = field(default_factory=dict)
    _needs: dict[str, Needs] = field(default_factory=dict)
    _halfway: set[str] = field(default_factory=set)
    _began: float = 0.0

    @property
    def finished(self) -> set[str]:
        """Stages that this command has made or reused."""
        return set(self._made)

    @property
    def products(self) -> Mapping[str, str]:
        """Digests by name of what the stages have made."""
        return dict(self._products)

    def result(self, stage: str) -> Any:
        """What a finished stage has made."""
        return self._made[stage]()

    # --------------------------------------------------------------------------------------------- the protocol

    def begin(self) -> None:
        """The stages follow."""
        self._settings = scene_settings(self.scene)

    def objects(self, until: str, cell_m: float | None) -> Sequence[ReadyObject]:
        """The objects of a scene of several, each understood in a run folder of its own."""
        try:
            self.ready = understand_objects(
                self.run, self.scene, self.fill, until=until, cell_m=cell_m, progress=self.progress
            )
        except RunError:
            self.refused = self.only
            raise
        return self.ready

    def hold(self, asset: Asset) -> None:
        """The object, for the stages after ``reconstruct``."""
        self.asset = asset
        self.counts["gaussians"] = len(asset.whole)
        if asset.surroundings is not None:
            self.counts["selected"] = len(asset.gaussians)

    def recall(self, stage: str, make: Callable[[], Any]) -> Callable[[], Any] | None:
        """Returns what ``stage`` made in an earlier run, or is None where it has to be made (again)."""
        needs = self._needs[stage] = Needs.of(stage_named(stage), self._settings, self._products)
        record = self.run.records.get(stage)
        reasons = self._reasons(stage, needs, record)
        if reasons or record is None:
            if self.only and stage != self.since:
                self.refused = True
                raise RunError(
                    f"{self.run.root}: '{stage}' is not up to date, because {' and '.join(reasons)}; "
                    f"'phys4dgen simulate {self.run.root}' makes what is missing."
                )
            if record is not None:
                self.progress.note(f"{stage}: made again, because {' and '.join(reasons)}.")
                if record.replaced:
                    self._halfway.add(stage)
            self._began = time.perf_counter()
            return None
        readers: Mapping[str, Callable[[StageRecord], Recalled]] = {
            "reconstruct": self._read_source,
            "views": lambda record: (functools.cache(make), record.products),
            "grouping": self._read_grouping,
            "interior": self._read_interior,
            "materials": self._read_materials,
            "simulate": self._read_motion,
            "render": lambda record: (lambda: True, record.products),
        }
        self.progress.note(f"{stage}: reused, for nothing that it depends on has changed.")
        self.progress.reuse(record.seconds)
        for warning in record.warnings:
            self.progress.warn(warning)
        return self._settle(stage, *readers[stage](record), record)

    def keep(self, stage: str, result: Any) -> Callable[[], Any]:
        """Write the result of ``stage``; what was written stands for it, so that a resumed run sees the same."""
        keepers: Mapping[str, Callable[[Any], Recalled]] = {
            "reconstruct": self._keep_source,
            "views": self._keep_views,
            "grouping": self._keep_grouping,
            "interior": self._keep_interior,
            "materials": self._keep_materials,
            "simulate": self._keep_motion,
            "render": self._keep_film,
        }
        self.run.replace_files_of(stage_named(stage))
        value, products = keepers[stage](result)
        record = StageRecord(
            self._needs[stage],
            products,
            chosen=self._choices() if stage == "simulate" else {},
            warnings=tuple(self.progress.stage_warnings),
            seconds=time.perf_counter() - self._began,
        )
        return self._settle(stage, value, products, record)

    def keep_tree(self, make: Callable[[], MergeTree]) -> Callable[[], MergeTree]:
        """The merge tree of ``groups_tree.npz``, or made and written there; once, when it is first needed."""
        made_from = needs_digest(Needs.of(MERGE_TREE, self._settings, self._products))

        def tree() -> MergeTree:
            kept = read_tree(self.run, made_from=made_from, gaussian_count=len(self._object().gaussians))
            if kept is None:
                kept = make()
                write_tree(self.run, kept, made_from=made_from)
            return kept

        return functools.cache(tree)

    def place(self, name: str) -> Path:
        """A folder of that name in the run folder; it is made by whoever puts something there."""
        return self.run.root / name

    def _settle(
        self, stage: str, value: Callable[[], Any], products: Mapping[str, str], record: StageRecord
    ) -> Callable[[], Any]:
        """Note what later stages and the report ask for, and record the stage as its files now are."""
        self._made[stage] = value
        self._products |= products
        if stage == "materials":
            self._describe_parts()
        self.run.finish(stage_named(stage), replace(record, products=dict(products)))
        return value

    def _reasons(self, stage: str, needs: Needs, record: StageRecord | None) -> list[str]:
        """Why a stage has to be made, one phrase each; empty where its result holds."""
        if record is None:
            return ["it was never finished"]
        names = [entry.name for entry in STAGES]
        if names.index(stage) < names.index(self.since) and needs.code != record.needs.code:
            self.progress.note(f"{stage}: made by another version of phys4dgen; 'generate' would make it again.")
            needs = replace(needs, code=record.needs.code)
        changes = record.changes(needs)
        if not changes and self.run.missing(self.scene, [stage]):
            changes = ["some of its files are missing"]
        return changes or (["it was asked for"] if self.again and stage == self.since else [])

    # ------------------------------------------------------------------------------------------ views and parts

    def _keep_source(self, source: Source) -> Recalled:
        write_source(self.run, source)
        return self._read_source()

    def _read_source(self, record: StageRecord | None = None) -> Recalled:
        source = read_source(self.run, self.scene)
        self.backends["reconstruct"] = source.backend
        earlier = {} if record is None else record.products  # of stages of objects that this command did not ask for
        return lambda: source, {**earlier, **products_of_objects(self.ready)}

    def _keep_views(self, views: Views) -> Recalled:
        asset = self._object()
        needed = predicted_bytes(self.scene, asset.whole)
        self.run.require_space(peak_bytes(self.scene, asset.whole))
        self.progress.note(f"The whole run takes about {needed / 1e6:,.0f} MB of disk.")
        self.counts["views"] = len(views)
        write_views(self.run, views, frame=asset.frame)
        if asset.surroundings is not None:
            write_png(selection_picture(asset, asset.surroundings), self.run.selection_png)
        return lambda: views, {"views": needs_digest(self._needs["views"])}

    def _keep_grouping(self, parts: Parts) -> Recalled:
        views: Views = self._made["views"]()
        gaussians = self._object().gaussians
        maps = render_label_maps(gaussians, parts.labels, views.cameras)
        self._spare_edited_groups()
        write_groups(self.run, parts, surroundings=self._object().surroundings)
        write_part_maps(self.run, Masks(labels=maps))
        write_parts_picture(self.run, parts, views, maps)
        return self._read_grouping()

    def _spare_edited_groups(self) -> None:
        """Labels that somebody painted into ``groups.npz`` are never overwritten, but moved aside."""
        kept = spare_edited_groups(self.run)
        if kept is not None:
            self.progress.warn(
                f"groups.npz was edited by hand (or made by an older version) and is made anew; the edited one is kept "
                f"as {kept.name}. To have its parts, run with --grouping.labels-file {kept}."
            )

    def _read_grouping(self, _record: StageRecord | None = None) -> Recalled:
        parts = read_groups(self.run)
        count = len(self._object().gaussians)
        if len(parts.labels) != count:
            raise RunError(
                f"{self.run.groups_npz}: expected labels of 0 or more for the {count} Gaussians of the object, got "
                f"{len(parts.labels)}; remove the file to have it made again."
            )
        self.counts["parts"] = parts.count
        self.backends["grouping"] = parts.backend
        return lambda: parts, parts_products(parts)

    # ------------------------------------------------------------------------------------- inside and materials

    def _keep_interior(self, interior: Interior) -> Recalled:
        write_interior(self.run, interior, settled=interior.continuum)
        return self._read_interior()

    def _read_interior(self, _record: StageRecord | None = None) -> Recalled:
        interior = read_interior(self.run)
        self.counts["particles"] = len(interior.continuum)
        self.backends["interior"] = interior.backend
        return lambda: interior, interior_products(interior.continuum)

    def _keep_materials(self, book: MaterialBook) -> Recalled:
        edits = edited_materials(self.run.materials_yaml, self.run.identified_yaml)
        kept = self._still_meant(edits, book)
        files = self.run.materials_yaml, self.run.identified_yaml
        write_both(*files, book=with_edits(book, kept), identified=book)
        return self._read_materials()

    def _read_materials(self, _record: StageRecord | None = None) -> Recalled:
        edits = edited_materials(self.run.materials_yaml, self.run.identified_yaml)
        for part in dict.fromkeys(part for part, _ in edits):
            self.progress.note(f"materials: part '{part}' is taken from materials.yaml as edited.")
        book = current_book(self.run.materials_yaml, self.run.identified_yaml)
        self.backends["materials"] = ", ".join(dict.fromkeys(entry.surface.source for entry in book.parts.values()))
        return lambda: book, book_products(book)

    def _still_meant(self, edits: Mapping[MaterialOf, Material], book: MaterialBook) -> dict[MaterialOf, Material]:
        """The edits of parts that are still there and of which the scene says nothing new."""
        record = self.run.records.get("materials")
        before = {} if record is None else record.needs.settings
        kept = {}
        for (part, side), edited in edits.items():
            names = (ALL_PARTS, object_of(part), part)
            keys = [f"parts.{name}.{key}" for name in names for key in ("material", "interior_material")]
            if part not in book.parts:
                self.progress.warn(f"What materials.yaml said of part '{part}' is dropped: there is no such part now.")
            elif any(before.get(key) != self._settings.get(key) for key in keys):
                self.progress.note(f"The material that the scene now names for '{part}' replaces the edited one.")
            else:
                kept[part, side] = edited
        return kept

    def _describe_parts(self) -> None:
        """Numbers of the parts; materials settle the thicknesses that could not be measured, so they come now."""
        parts: Parts = self._made["grouping"]()
        interior: Interior = self._made["interior"]()
        book: MaterialBook = self._made["materials"]()
        settled = settled_thickness(self.scene, self._object(), parts, interior.continuum, book)
        write_interior(self.run, interior, settled=settled)
        self.run.refresh(stage_named("interior"))
        self.parts = part_reports(parts, settled, book)

    # ---------------------------------------------------------------------------------------- motion and film

    def _keep_motion(self, motion: Motion) -> Recalled:
        asset = self._object()
        made_from = needs_digest(self._needs["simulate"])
        products = write_motion(self.run, asset, motion, made_from=made_from, progress=self.progress)
        return self._motion_on_disk(products)

    def _read_motion(self, record: StageRecord) -> Recalled:
        if self.run.is_untouched(stage_named("simulate")):
            return self._motion_on_disk(record.products)
        return self._motion_on_disk(products_of_motion(recalled_motion(self.run, self._object())))

    def _motion_on_disk(self, products: Mapping[str, str]) -> Recalled:
        self.facts = recalled_facts(self.run)
        self.backends["simulate"] = "MLS-MPM, explicit SIMD on CPU"
        self.counts["frames"] = self.scene.frame_count
        self.run.write_scene(self.scene.with_overrides(self._choices()))
        return functools.cache(lambda: recalled_motion(self.run, self._object())), products

    def _choices(self) -> dict[str, Any]:
        """Settings that the simulation chose, by key of the scene."""
        assert self.facts is not None
        chosen: dict[str, Any] = {"motion.preset": self.facts.preset}
        if self.facts.preset == "sway":
            chosen["motion.acceleration_ms2"] = self.facts.gust_ms2
        return chosen

    def _keep_film(self, film: Film) -> Recalled:
        self.backends["render"] = write_film(
            film, self.run, self._object(), frames=self._frames_to_write(), progress=self.progress
        )
        return lambda: True, {}

    def _frames_to_write(self) -> Frames:
        """New, kept as they are (the motion is the same and only the film changes), or none."""
        if self.scene.output.frames == "none":
            return "none"
        record, needs = self.run.records.get("render"), self._needs["render"]
        if record is None or "render" in self._halfway or self.run.missing(self.scene, ["render"]):
            return "new"
        same = record.needs.products == needs.products and record.needs.code == needs.code
        shown = [key for key in needs.settings if key == "output.frames" or key.startswith(("input", "objects."))]
        same = same and all(record.needs.settings.get(key) == needs.settings[key] for key in shown)
        return "kept" if same and not self.again else "new"

    def _object(self) -> Asset:
        assert self.asset is not None
        return self.asset
