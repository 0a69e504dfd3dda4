"""``generate``: the whole job into a run folder, resumed where an earlier run stopped."""

from __future__ import annotations

import importlib.metadata
import os
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from phys4dgen.errors import RunError
from phys4dgen.progress import SILENT, Progress
from phys4dgen.run.folder import RunFolder
from phys4dgen.run.recorder import RecordingProgress
from phys4dgen.run.report import Report
from phys4dgen.run.stages import stage_digests, stages_until
from phys4dgen.scene import Scene, dump_scene, refuse_impossible_part_names

if TYPE_CHECKING:
    from phys4dgen.stages.motion_facts import MotionFacts

__all__ = ["Run", "generate"]


@dataclass(frozen=True)
class Run:
    """A finished run.

    Attributes:
        root: the run folder.
        report: what report.json holds.
        results: the files that people look at first.
    """

    root: Path
    report: dict[str, Any]
    results: tuple[Path, ...]


def generate(
    scene: Scene, out: Path | str, *, until: str | None = None, overwrite: bool = False, progress: Progress = SILENT
) -> Run:
    """Turn a scene into 4D content in a run folder.

    Args:
        scene: what to do.
        out: the run folder, made where it is missing; a run of the same input and settings is continued.
        until: last stage wanted (views, grouping, interior, materials, simulate, render); None for all.
        overwrite: replace what a run with other settings has left in ``out``.
        progress: told what happens.

    Raises:
        Phys4DGenError: one sentence on what is wrong.
    """
    stages = stages_until(until)
    scene = scene.with_paths_from(Path.cwd())
    refuse_impossible_part_names(scene)
    digests = stage_digests(scene, version=importlib.metadata.version("phys4dgen"))
    recorder = RecordingProgress(progress)
    with RunFolder(out).claim(digests, overwrite=overwrite) as run:
        if run.is_finished(stages[-1]) and run.report_json.is_file() and not run.missing(scene, stages):
            recorder.note(f"{run.root} holds this run already; nothing is left to do.")
        else:
            _fill(run, scene, stages, recorder)
        missing = run.missing(scene, stages)
        if missing:
            raise RunError(f"{run.root}: the run ended without {', '.join(missing)}; look into {run.log_jsonl.name}.")
        shown = (run.video_mp4, run.contact_sheet_png, run.parts_png, run.report_json)
        return Run(run.root, run.read_report(), tuple(path for path in shown if path.is_file()))


def _fill(run: RunFolder, scene: Scene, stages: tuple[str, ...], recorder: RecordingProgress) -> None:
    """Run the stages, and write the report however they end."""
    from phys4dgen.pipeline import animate_scene
    from phys4dgen.run.store import RunStore

    _use_threads(scene)
    if not _kernels_are_compiled():
        recorder.note("First run on this machine: the kernels are compiled once, which adds about half a minute.")
    run.write_text(run.scene_yaml, dump_scene(scene))
    store = RunStore(run, scene, recorder)
    try:
        animate_scene(scene, store, until=stages[-1], progress=recorder)
    finally:
        recorder.end_stage()
        finished = [stage for stage in stages if run.is_finished(stage)]
        report = Report(
            input=scene.input.as_posix(),
            seed=scene.seed,
            warnings=recorder.warnings,
            notes=recorder.notes,
            completed_until=finished[-1] if finished else "",
            backends=store.backends,
            stages=recorder.stages,
            counts=store.counts,
            metres_per_unit=store.asset.frame.metres_per_unit if store.asset is not None else None,
            parts=store.parts,
            **_sections(store.facts),
        )
        run.write_json(run.report_json, report.as_dict())


_MOTION = ("preset", "held", "wind_up", "gust_ms2", "gust_s", "frequency_hz")
_HISTORY = ("substeps", "dt_s", "max_speed_ms", "energy_kinetic_j", "energy_elastic_j", "momentum_kgms")


def _sections(facts: MotionFacts | None) -> dict[str, Any]:
    """What the simulation found, as the sections of the report; the history has one entry per frame."""
    if facts is None:
        return {}
    values = {entry.name: getattr(facts, entry.name) for entry in fields(facts)}
    return {
        "motion": {name: values.pop(name) for name in _MOTION},
        "history": {name: values.pop(name) for name in _HISTORY},
        "simulation": values,
    }


def _kernels_are_compiled() -> bool:
    """Whether Numba has cached kernels of this package, beside the sources or where NUMBA_CACHE_DIR says."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    places = [Path(__file__).parents[1], *([Path(chosen)] if chosen else [])]
    return any(next(place.rglob("step.advance-*.nbi"), None) for place in places if place.is_dir())


def _use_threads(scene: Scene) -> None:
    import numba

    if not isinstance(scene.simulation.threads, str):
        numba.set_num_threads(min(scene.simulation.threads, numba.get_num_threads()))
