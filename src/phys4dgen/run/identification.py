"""Materials of a finished run again: another model or more samples, how reliable it is, and models side by side."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from phys4dgen.errors import RunError, SceneError
from phys4dgen.formats.atomic import atomic_path
from phys4dgen.progress import SILENT, Progress
from phys4dgen.run.artefacts import read_groups
from phys4dgen.run.folder import RunFolder
from phys4dgen.run.generate import Run, continue_run
from phys4dgen.run.state import finished_stages
from phys4dgen.scene import Scene

if TYPE_CHECKING:
    from phys4dgen.materials.mllm import Reading, SubImages

__all__ = ["compare_models", "identify_again", "write_reliability"]

_ANSWERS = "answers"


def identify_again(folder: Path, scene: Scene, *, progress: Progress = SILENT) -> Run:
    """Name the materials of a run again; materials that a person edited stay.

    Args:
        folder: the run folder.
        scene: of the run, with the settings of ``materials`` to use.
        progress: told what is sent and found.

    Raises:
        Phys4DGenError: one sentence on what is wrong.
    """
    return continue_run(folder, scene, since="materials", until="materials", again=True, progress=progress)


def write_reliability(folder: Path) -> Path:
    """Write the paper's reliability table of the last identification (appendix B.5); returns its path.

    Raises:
        RunError: no model has been asked in this run.
    """
    from phys4dgen.materials.mllm import kept_answers, reliability_table

    summary = folder / _ANSWERS / "identification.json"
    if not summary.is_file():
        raise RunError(f"{folder}: no model was asked in this run; --stats needs the backend mllm.")
    model, readings, letters = kept_answers(json.loads(summary.read_text("utf-8")))
    return _write(folder / "reliability.md", reliability_table(readings, letters, model=model))


def compare_models(folder: Path, scene: Scene, models: Sequence[str], *, progress: Progress = SILENT) -> Path:
    """Ask several models about the parts of a run and set their answers side by side; returns the table's path.

    The materials of the run do not change.

    Args:
        folder: the run folder.
        scene: of the run.
        models: ids, each at the scene's ``base_url`` or as ``ID@URL`` at another.
        progress: told what is sent.

    Raises:
        RunError: the run has no parts yet.
        Phys4DGenError: one of the models gave no answer.
    """
    from phys4dgen.materials.mllm import comparison_table
    from phys4dgen.run.source_files import read_source
    from phys4dgen.stages.asset import load
    from phys4dgen.stages.materials import pictures_for_model

    if "grouping" not in finished_stages(folder):
        raise RunError(f"{folder}: the parts are not known yet; 'phys4dgen simulate {folder}' finds them first.")
    if len(models) < 2:
        raise SceneError("--compare: expected at least two models, as in gpt-4o,gemma3:12b@http://localhost:11434/v1.")
    with RunFolder(folder).claim() as run:
        parts, source = read_groups(run), read_source(run, scene)
        images = pictures_for_model(source, load(scene, source, progress), parts, folder / _ANSWERS)
        answers = _answers(scene, models, images, parts.names, folder / _ANSWERS, progress)
        letters = {parts.names[number]: letter for number, letter in images.letters.items()}
        return _write(folder / "comparison.md", comparison_table(answers, letters))


def _answers(
    scene: Scene, models: Sequence[str], images: SubImages, names: Sequence[str], folder: Path, progress: Progress
) -> dict[str, tuple[Reading, ...]]:
    """What each model answers, by model."""
    from phys4dgen.materials.mllm import ask_names
    from phys4dgen.stages.materials import asking, model_endpoint

    wanted = asking(scene)
    answers = {}
    for model in models:
        name, _, url = model.partition("@")
        base_url = url or scene.materials.base_url
        target = model_endpoint(scene.with_overrides({"materials.model": name, "materials.base_url": base_url}))
        asked = ask_names(target, images, names, wanted, folder=folder, progress=progress)
        answers[model] = asked.readings
    return answers


def _write(path: Path, text: str) -> Path:
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path
