"""The whole job into a run folder, resumed where an earlier run stopped, or made again from a stage after an edit."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from phys4dgen.errors import RunError
from phys4dgen.progress import SILENT, Progress
from phys4dgen.run.folder import RunFolder
from phys4dgen.run.kernels import simulator_is_compiled
from phys4dgen.run.objects import object_reports
from phys4dgen.run.recorder import RecordingProgress
from phys4dgen.run.report import Report
from phys4dgen.run.stages import STAGES, Needs, scene_settings, stage_named, stages_until
from phys4dgen.run.state import STATE_NAME
from phys4dgen.scene import Scene, load_scene, refuse_impossible_part_names

if TYPE_CHECKING:
    from phys4dgen.run.store import RunStore
    from phys4dgen.stages.motion_facts import MotionFacts

__all__ = ["Run", "continue_run", "generate", "scene_of_run", "use_threads"]


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
        until: last stage wanted (reconstruct, views, grouping, interior, materials, simulate, render); None for all.
        overwrite: replace what a run with other settings has left in ``out``.
        progress: told what happens.

    Raises:
        Phys4DGenError: one sentence on what is wrong.
    """
    stages = stages_until(until)
    scene = scene.with_paths_from(Path.cwd())
    refuse_impossible_part_names(scene)
    settings = scene_settings(scene)
    recorder = RecordingProgress(progress)
    with RunFolder(out).claim() as run:
        if overwrite:
            run.remove_outdated(settings)
        else:
            run.refuse_other_settings(settings)
        return _finished(run, scene, stages, recorder)


def continue_run(
    folder: Path | str,
    scene: Scene | None = None,
    *,
    since: Literal["views", "grouping", "materials", "simulate", "render"],
    until: str | None = None,
    again: bool = False,
    progress: Progress = SILENT,
) -> Run:
    """Bring a run up to date after an edit of its scene.yaml or materials.yaml, or after an interruption.

    Args:
        folder: the run folder.
        scene: what it shall be; None for what its scene.yaml says.
        since: the stage that the edit is meant for; those before it are made only if their own settings changed.
            "render" makes the film alone and refuses to simulate.
        until: last stage wanted; None for all.
        again: make ``since`` again although nothing has changed.
        progress: told what is reused, and why something is made again.

    Raises:
        Phys4DGenError: one sentence on what is wrong.
    """
    stages = stages_until(until)
    scene = scene_of_run(folder) if scene is None else scene
    refuse_impossible_part_names(scene)
    recorder = RecordingProgress(progress)
    with RunFolder(folder).claim() as run:
        return _finished(run, scene, stages, recorder, since=since, again=again)


def scene_of_run(folder: Path | str) -> Scene:
    """What RUN/scene.yaml says.

    Raises:
        RunError: the folder holds no run, or one of several objects of another.
        SceneError: scene.yaml is damaged; names line and key.
    """
    folder = Path(folder)
    scene_yaml = RunFolder(folder).scene_yaml
    if not (folder / STATE_NAME).is_file() or not scene_yaml.is_file():
        raise RunError(
            f"{folder}: expected a run folder with a scene.yaml; 'phys4dgen generate INPUT -o RUN' makes one."
        )
    whole = folder.absolute().parent.parent
    if RunFolder(whole).objects == folder.absolute().parent and (whole / STATE_NAME).is_file():
        raise RunError(f"{folder}: is one of several objects and follows {whole}; use the command on {whole}.")
    return load_scene(scene_yaml)


def _finished(
    run: RunFolder,
    scene: Scene,
    stages: Sequence[str],
    recorder: RecordingProgress,
    *,
    since: str = STAGES[0].name,
    again: bool = False,
) -> Run:
    """The run with all of ``stages`` done."""
    if not again and not scene.objects and _holds(run, scene, stages):
        run.write_scene(scene)  # a change that only later stages read
        recorder.note(f"{run.root} holds this run already; nothing is left to do.")
    else:
        _fill(run, scene, stages, recorder, since=since, again=again)
    missing = run.missing(scene, stages)
    if missing:
        raise RunError(f"{run.root}: the run ended without {', '.join(missing)}; look into {run.log_jsonl.name}.")
    shown = (run.video_mp4, run.contact_sheet_png, run.parts_png, run.report_json)
    return Run(run.root, run.read_report(), tuple(path for path in shown if path.is_file()))


def _holds(run: RunFolder, scene: Scene, stages: Sequence[str]) -> bool:
    """Whether all that is asked for lies there, from the same settings and with no file edited since."""
    if not run.report_json.is_file() or not run.scene_yaml.is_file() or run.missing(scene, stages):
        return False
    settings = scene_settings(scene)
    products: dict[str, str] = {}
    for name in stages:
        record, stage = run.records.get(name), stage_named(name)
        if record is None or not run.is_untouched(stage) or record.changes(Needs.of(stage, settings, products)):
            return False
        products |= record.products
    return True


def _fill(
    run: RunFolder, scene: Scene, stages: Sequence[str], recorder: RecordingProgress, *, since: str, again: bool
) -> RunStore:
    """Run the stages, and write the report however they end; what they made."""
    from phys4dgen.pipeline import animate_scene
    from phys4dgen.run.store import RunStore

    use_threads(scene)
    if not simulator_is_compiled():
        recorder.note("First run on this machine: the kernels are compiled once, which adds about half a minute.")
    fill = partial(_fill, since=since, again=again)
    store = RunStore(run, scene, recorder, fill, since=since, again=again, only=since == "render")
    if not store.only:  # which may still refuse, and writes the scene once it does not
        run.write_scene(scene)
    try:
        animate_scene(scene, store, until=stages[-1], progress=recorder)
    except BaseException:
        if not store.refused:
            with suppress(OSError):  # a full disk shall not hide what went wrong first
                _write_report(run, scene, store, recorder, stages)
        raise
    _write_report(run, scene, store, recorder, stages)
    return store


def _write_report(
    run: RunFolder, scene: Scene, store: RunStore, recorder: RecordingProgress, stages: Sequence[str]
) -> None:
    recorder.end_stage()
    finished = [stage for stage in stages if stage in store.finished]
    report = Report(
        input=_input(scene),
        seed=scene.seed,
        warnings=recorder.warnings,
        notes=recorder.notes,
        completed_until=finished[-1] if finished else "",
        backends=store.backends,
        stages=recorder.stages,
        counts=store.counts,
        metres_per_unit=store.asset.frame.metres_per_unit if store.asset is not None else None,
        objects=object_reports(scene, store.ready, store.parts),
        parts=store.parts,
        **_sections(store.facts),
    )
    run.write_json(run.report_json, report.as_dict())


def _input(scene: Scene) -> str:
    """The input of a run, or those of its objects."""
    if scene.input is not None:
        return scene.input.as_posix()
    return ", ".join(f"{name}: {placed.input.as_posix()}" for name, placed in scene.objects.items())


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


def use_threads(scene: Scene) -> None:
    """Let the kernels use as many threads as the scene says."""
    import numba

    if not isinstance(scene.simulation.threads, str):
        numba.set_num_threads(min(scene.simulation.threads, numba.get_num_threads()))
