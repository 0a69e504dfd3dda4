"""``render --overlay``: parts, material, strain or forces over the film of a run, without simulating anything."""

from __future__ import annotations

from pathlib import Path

from phys4dgen.errors import RunError, SceneError, did_you_mean
from phys4dgen.progress import SILENT, Progress
from phys4dgen.run.folder import RunFolder
from phys4dgen.run.state import finished_stages
from phys4dgen.scene import Scene

__all__ = ["check_overlay", "render_overlay"]

_NAMES = ("parts", "material", "strain", "forces")


def check_overlay(name: str) -> None:
    """Refuse what is no overlay, before anything heavy is imported.

    Raises:
        SceneError: names the overlays that there are.
    """
    if name not in _NAMES:
        raise SceneError(f"--overlay: expected one of {', '.join(_NAMES)}, got '{name}'.{did_you_mean(name, _NAMES)}")


def render_overlay(folder: Path | str, scene: Scene, name: str, *, progress: Progress = SILENT) -> list[Path]:
    """Render one overlay of a simulated run into RUN/overlays/; nothing else in the run changes.

    Args:
        folder: the run folder.
        scene: of the run; what it says of the film (``output.video``) may differ from RUN/scene.yaml.
        name: parts, material, strain or forces.
        progress: told how far it is.

    Returns:
        The film and its contact sheet.

    Raises:
        RunError: the run has not been simulated, or a file cannot be written.
    """
    check_overlay(name)
    if "simulate" not in finished_stages(folder):
        raise RunError(f"{folder}: the motion is not complete; 'phys4dgen simulate {folder}' makes what is missing.")
    from phys4dgen.run.artefacts import read_groups
    from phys4dgen.run.film_files import write_video_and_sheet
    from phys4dgen.run.generate import use_threads
    from phys4dgen.run.material_edits import current_book
    from phys4dgen.run.motion_files import recalled_motion
    from phys4dgen.run.source_files import read_source
    from phys4dgen.stages.asset import load
    from phys4dgen.stages.film import film
    from phys4dgen.stages.overlays import OVERLAYS, OverlayInputs

    use_threads(scene)
    with RunFolder(folder).claim() as run:
        progress.stage(f"overlay {name}")
        asset = load(scene, read_source(run, scene), progress)
        motion = recalled_motion(run, asset)
        book = current_book(run.materials_yaml, run.identified_yaml)
        overlay = OVERLAYS[name](OverlayInputs(scene, asset, read_groups(run), book, motion))
        shown = film(scene, asset, motion, progress, overlay=overlay)
        images = (frame.image for frame in shown.frames())
        sheet = run.overlays / f"{name}.png"
        video, _ = write_video_and_sheet(
            images, shown, video=run.overlays / f"{name}.mp4", sheet=sheet, progress=progress
        )
        return [video, sheet]
