"""Keeps what the stages make in a run folder, and recalls what an earlier run of the same settings has made."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import RunError
from phys4dgen.export.frames import FrameWriter, remove_frames_from
from phys4dgen.export.pictures import contact_sheet, evenly_spaced, parts_picture, write_png
from phys4dgen.export.trajectory import read_trajectory, trajectory_writer
from phys4dgen.export.video import write_video
from phys4dgen.formats import save_gaussians
from phys4dgen.interior import Interior
from phys4dgen.materials import write_materials
from phys4dgen.render.views import render_labels
from phys4dgen.run.artefacts import (
    read_groups,
    read_interior,
    write_groups,
    write_interior,
    write_part_maps,
    write_views,
)
from phys4dgen.run.folder import RunFolder
from phys4dgen.run.prediction import predicted_bytes
from phys4dgen.run.recorder import RecordingProgress
from phys4dgen.run.report import PartReport, part_reports
from phys4dgen.scene import Scene, dump_scene
from phys4dgen.stages.asset import Asset
from phys4dgen.stages.film import Film
from phys4dgen.stages.interior import settled_thickness
from phys4dgen.stages.motion import Motion
from phys4dgen.stages.motion_facts import MotionFacts
from phys4dgen.types import Masks, MaterialBook, Parts, Views

__all__ = ["RunStore"]


@dataclass
class RunStore:
    """The ``Store`` of ``pipeline.py`` on a run folder; it also collects what the report says about the results.

    Attributes:
        run: the folder, claimed.
        scene: what was asked for.
        progress: told about stages that are recalled.
        asset: the object, once a stage has been kept or recalled.
        counts: gaussians, particles, parts ... for the report.
        backends: what did each stage.
        parts: the parts in numbers.
        facts: what the simulation decided and found.
    """

    run: RunFolder
    scene: Scene
    progress: RecordingProgress
    asset: Asset | None = None
    counts: dict[str, int] = field(default_factory=dict)
    backends: dict[str, str] = field(default_factory=dict)
    parts: list[PartReport] = field(default_factory=list)
    facts: MotionFacts | None = None
    _interior: Interior | None = None

    def recall(self, stage: str, inputs: Mapping[str, Any]) -> Any | None:
        """What ``stage`` made in an earlier run, or None where it is quicker or necessary to make it again."""
        recall: Callable[[], Any] | None = {
            "grouping": self._recall_grouping,
            "interior": self._recall_interior,
            "simulate": self._recall_motion,
        }.get(stage)
        if recall is None or not self.run.is_finished(stage):
            return None
        for warning in self.run.warnings_of(stage):
            self.progress.warn(warning)
        return recall()

    def keep(self, stage: str, result: Any, inputs: Mapping[str, Any]) -> Any:
        """Write the result of ``stage``; the motion is replaced by one that reads its frames from disk."""
        keep: Mapping[str, Callable[[Any, Mapping[str, Any]], Any]] = {
            "views": self._keep_views,
            "grouping": self._keep_grouping,
            "interior": self._keep_interior,
            "materials": self._keep_materials,
            "simulate": self._keep_motion,
            "render": self._keep_film,
        }
        kept = keep[stage](result, inputs)
        self.run.finish(stage, warnings=self.progress.stage_warnings)
        return kept

    def _keep_views(self, views: Views, inputs: Mapping[str, Any]) -> Views:
        asset: Asset = inputs["asset"]
        needed = predicted_bytes(self.scene, asset.gaussians)
        self.run.require_space(needed)
        self.progress.note(f"The whole run takes about {needed / 1e6:,.0f} MB of disk.")
        self.asset = asset
        self.counts |= {"gaussians": len(asset.gaussians), "views": len(views)}
        save_gaussians(asset.gaussians, self.run.gaussians_ply)
        write_views(self.run, views, frame=asset.frame)
        return views

    def _keep_grouping(self, parts: Parts, inputs: Mapping[str, Any]) -> Parts:
        self._count_parts(parts)
        views: Views = inputs["views"]
        gaussians = inputs["asset"].gaussians
        maps = np.stack([render_labels(gaussians, parts.labels, camera) for camera in views.cameras])
        write_groups(self.run, parts)
        write_part_maps(self.run, Masks(labels=maps))
        shown = [len(views) // 3, len(views) // 3 + 2]  # two views from the side in every preset
        picture = parts_picture(
            [_eight_bit(views.rgb[i]) for i in shown],
            [maps[i] for i in shown],
            names=parts.names,
            shares=[float((parts.labels == number).mean()) for number in range(parts.count)],
        )
        write_png(picture, self.run.parts_png)
        return parts

    def _recall_grouping(self) -> Parts:
        parts = read_groups(self.run)
        self._count_parts(parts)
        return parts

    def _count_parts(self, parts: Parts) -> None:
        self.counts["parts"] = parts.count
        self.backends["grouping"] = parts.backend

    def _keep_interior(self, interior: Interior, _inputs: Mapping[str, Any]) -> Interior:
        self._count_particles(interior)
        write_interior(self.run, interior)
        return interior

    def _recall_interior(self) -> Interior:
        interior = read_interior(self.run)
        self._count_particles(interior)
        return interior

    def _count_particles(self, interior: Interior) -> None:
        self._interior = interior
        self.counts["particles"] = len(interior.continuum)
        self.backends["interior"] = "carving and density"

    def _keep_materials(self, book: MaterialBook, inputs: Mapping[str, Any]) -> MaterialBook:
        assert self._interior is not None
        parts: Parts = inputs["parts"]
        continuum = settled_thickness(self.scene, inputs["asset"], parts, self._interior.continuum, book)
        # Materials settle the thicknesses that could not be measured, so volumes are final only now.
        write_interior(self.run, replace(self._interior, continuum=continuum))
        write_materials(self.run.materials_yaml, book)
        self.parts = part_reports(parts, continuum, book)
        self.backends["materials"] = ", ".join(dict.fromkeys(entry.surface.source for entry in book.parts.values()))
        return book

    def _keep_motion(self, motion: Motion, inputs: Mapping[str, Any]) -> Motion:
        count = len(inputs["asset"].gaussians)
        with trajectory_writer(self.run.trajectory_npz, times_s=motion.times_s, gaussian_count=count) as append:
            for positions, gradients in motion.frames():
                append(positions, gradients)
        self.run.write_json(self.run.motion_json, motion.facts)
        return self._motion_on_disk(motion.facts)

    def _recall_motion(self) -> Motion:
        return self._motion_on_disk(MotionFacts(**json.loads(self.run.motion_json.read_text("utf-8"))))

    def _motion_on_disk(self, facts: MotionFacts) -> Motion:
        self.facts = facts
        self.backends["simulate"] = "MLS-MPM, explicit SIMD on CPU"
        trajectory = read_trajectory(self.run.trajectory_npz)
        self.counts["frames"] = trajectory.frame_count

        def frames() -> Iterator[tuple[NDArray[np.float32], NDArray[np.float32]]]:
            yield from zip(trajectory.positions, trajectory.deformation_gradients, strict=True)

        chosen: dict[str, Any] = {"motion.preset": facts.preset}
        if facts.preset == "sway":
            chosen["motion.acceleration_ms2"] = facts.gust_ms2
        self.run.write_text(self.run.scene_yaml, dump_scene(self.scene.with_overrides(chosen)))
        return Motion(trajectory.times_s, frames, facts)

    def _keep_film(self, film: Film, inputs: Mapping[str, Any]) -> bool:
        asset: Asset = inputs["asset"]
        on_sheet = evenly_spaced(len(film.times_s))
        stills: dict[int, NDArray[np.uint8]] = {}
        writer = FrameWriter(asset.gaussians, self.run.frames) if self.scene.output.frames == "ply" else None

        def images() -> Iterator[NDArray[np.uint8]]:
            for frame in film.frames():
                if writer is not None:
                    writer.write(
                        frame.index,
                        means=frame.means,
                        quats_wxyz=frame.quats_wxyz,
                        scales=frame.scales,
                        rotations=frame.rotations if frame.index else None,
                    )
                if frame.index in on_sheet:
                    stills[frame.index] = frame.image
                yield frame.image

        path, warnings = write_video(images(), self.run.video_mp4, fps=film.fps)
        for warning in warnings:
            self.progress.warn(warning)
        self.backends["render"] = f"CPU rasteriser, {'H.264' if path.suffix == '.mp4' else 'WebP'}"
        remove_frames_from(self.run.frames, len(film.times_s) if writer is not None else 0)
        if not stills:
            raise RunError(f"{self.run.video_mp4}: the film has no frames.")
        sheet = contact_sheet([stills[k] for k in on_sheet], [float(film.times_s[k]) for k in on_sheet])
        write_png(sheet, self.run.contact_sheet_png)
        write_png(stills[on_sheet[min(1, len(on_sheet) - 1)]], self.run.preview_png)
        return True


def _eight_bit(values: NDArray[np.float32]) -> NDArray[np.uint8]:
    return np.rint(np.clip(values, 0, 1) * 255).astype(np.uint8)
