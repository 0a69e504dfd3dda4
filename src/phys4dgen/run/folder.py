"""The run folder: where every artefact lies, who may write it, and what is already done.

Each file appears whole or not at all. ``.state.json`` (``state.py``) records what every finished stage was made from,
so that a second command knows what still holds and what it would destroy.
"""

from __future__ import annotations

import json
import logging
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any

from numpy.typing import NDArray

from phys4dgen.errors import RunError, SceneError
from phys4dgen.export.frames import frame_path
from phys4dgen.formats.atomic import atomic_path
from phys4dgen.formats.npz import save_npz
from phys4dgen.input_kinds import is_picture
from phys4dgen.run.json_text import json_text
from phys4dgen.run.lock import FolderLock
from phys4dgen.run.log import JsonLinesHandler
from phys4dgen.run.stages import STAGES, Needs, Stage
from phys4dgen.run.state import STATE_NAME, StageRecord, read_state
from phys4dgen.scene import Scene, dump_scene, load_scene

__all__ = ["RunFolder"]

_READ_AGAIN = (".npz", ".yaml", ".json")
"""Suffixes of files whose content a later command depends on."""


class RunFolder:
    """A run folder that this process holds; use it in a ``with`` statement.

    The names of all artefacts are attributes (README.md says what they hold), so that no other file spells them.
    ``input`` holds the splats of the demo; every other input stays where it is. ``objects`` holds a run folder for each
    of several objects. ``records`` tells of the finished
    stages, by name.
    """

    def __init__(self, root: Path | str) -> None:
        self.root = Path(root).absolute()
        self.input = self.root / "input"
        self.scene_yaml = self.root / "scene.yaml"
        self.objects = self.root / "objects"
        self.gaussians_ply = self.root / "gaussians.ply"
        self.cutout_png = self.root / "reconstruct" / "cutout.png"
        self.source_json = self.root / "reconstruct" / "source.json"
        self.solid_npz = self.root / "reconstruct" / "solid.npz"
        self.even_light_npz = self.root / "reconstruct" / "even_light.npz"
        self.views = self.root / "views"
        self.selection_png = self.views / "selection.png"
        self.cameras_json = self.views / "cameras.json"
        self.parts_png = self.root / "parts.png"
        self.groups_npz = self.root / "groups.npz"
        self.groups_tree_npz = self.root / "groups_tree.npz"
        self.continuum_npz = self.root / "continuum.npz"
        self.materials_yaml = self.root / "materials.yaml"
        self.identified_yaml = self.root / ".identified.yaml"
        self.trajectory_npz = self.root / "trajectory.npz"
        self.trajectory_partial = self.root / "trajectory.partial"
        self.motion_json = self.root / "motion.json"
        self.frames = self.root / "frames"
        self.video_mp4 = self.root / "video.mp4"
        self.preview_png = self.root / "preview.png"
        self.contact_sheet_png = self.root / "contact_sheet.png"
        self.overlays = self.root / "overlays"
        self.report_json = self.root / "report.json"
        self.log_jsonl = self.root / "log.jsonl"
        self.records: dict[str, StageRecord] = {}
        self._state_json = self.root / STATE_NAME
        self._lock = FolderLock(self.root)
        self._log_handler: logging.Handler | None = None

    # ------------------------------------------------------------------------------------------------ taking it

    def claim(self) -> RunFolder:
        """Make or take the folder and lock it; nothing that a run left in it is touched yet.

        Raises:
            RunError: not a folder, not a run, locked by another process, damaged or not writable.
        """
        self.refuse_foreign_files()
        try:
            self.root.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RunError(f"{self.root}: cannot make the run folder: {error.strerror or error}.") from error
        self._lock.acquire()
        try:
            self.records = read_state(self.root)
            for leftover in self.root.rglob(".*.partial-*"):
                leftover.unlink(missing_ok=True)
            self._write_state()  # which marks the folder as a run
        except BaseException:
            self._lock.release()
            raise
        self._log_handler = JsonLinesHandler(self.log_jsonl)
        logging.getLogger("phys4dgen").addHandler(self._log_handler)
        return self

    def refuse_foreign_files(self) -> None:
        """Refuse a place that is a file, or a folder with files but without a run of phys4dgen in it.

        Raises:
            RunError: as above.
        """
        if self.root.exists() and not self.root.is_dir():
            raise RunError(f"{self.root}: expected a folder for the run, got a file; choose another place with -o.")
        expected = {self._state_json.name, FolderLock.NAME, self.input.name}
        if self.root.is_dir() and not self._state_json.is_file():
            foreign = next((path.name for path in self.root.iterdir() if path.name not in expected), None)
            if foreign is not None:
                raise RunError(
                    f"{self.root}: the folder holds no run of phys4dgen but other files ('{foreign}'); "
                    "choose another place with -o."
                )

    def refuse_other_settings(self, settings: Mapping[str, Any]) -> None:
        """Refuse to continue a run that other settings have made.

        Args:
            settings: of the scene asked for, from ``scene_settings``.

        Raises:
            RunError: names the first stage and setting that differ, and the ways out.
        """
        for stage in STAGES:
            record = self.records.get(stage.name)
            if record is not None:
                other = record.changed_settings(Needs.of(stage, settings, record.needs.products))
                if other:
                    raise RunError(
                        f"{self.root}: holds a run with other settings of '{stage.name}' ({_listed(other)}); add "
                        "--overwrite to replace what depends on them, choose another place with -o, or go on with "
                        f"what the run's own scene.yaml says by 'phys4dgen simulate {self.root}'."
                    )

    def __enter__(self) -> RunFolder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()

    def release(self) -> None:
        """Close the log and let other processes in."""
        if self._log_handler is not None:
            logging.getLogger("phys4dgen").removeHandler(self._log_handler)
            self._log_handler.close()
            self._log_handler = None
        self._lock.release()

    # ------------------------------------------------------------------------------------------- what is done

    def replace_files_of(self, stage: Stage) -> None:
        """Note that other files of ``stage`` are about to be written: half of them would not hold, were it killed."""
        record = self.records.get(stage.name)
        if record is not None:
            self.records[stage.name] = replace(record, replaced=True)
            self._write_state()

    def finish(self, stage: Stage, record: StageRecord) -> None:
        """Record that all files of ``stage`` are written."""
        self.records[stage.name] = replace(record, files=self._signatures(stage))
        self._write_state()

    def refresh(self, stage: Stage) -> None:
        """Record the files of a finished stage as they are now."""
        self.finish(stage, self.records[stage.name])

    def remove_outdated(self, settings: Mapping[str, Any]) -> None:
        """Remove what other settings have made, and what follows from it; files of others and edits stay.

        Args:
            settings: of the scene asked for, from ``scene_settings``.
        """
        outdated = False
        for stage in STAGES:
            record = self.records.get(stage.name)
            if record is not None:
                outdated |= bool(record.changed_settings(Needs.of(stage, settings, record.needs.products)))
                if outdated and stage.name != "materials":  # what was edited there is taken over, where it still fits
                    self._remove(stage)

    def _remove(self, stage: Stage) -> None:
        del self.records[stage.name]
        self._write_state()
        for pattern in stage.files:
            for path in self.root.glob(pattern):
                path.unlink(missing_ok=True)

    def is_untouched(self, stage: Stage) -> bool:
        """Whether the main files of a finished stage are as they were when it was recorded."""
        return self.records[stage.name].files == self._signatures(stage)

    def _signatures(self, stage: Stage) -> dict[str, list[int]]:
        """Size and time of the files that later stages read and that people edit."""
        found = {}
        for name in stage.files:
            path = self.root / name
            if path.suffix in _READ_AGAIN and path.is_file():
                status = path.stat()
                found[name] = [status.st_size, status.st_mtime_ns]
        return found

    def missing(self, scene: Scene, stages: Sequence[str]) -> list[str]:
        """Names of the files that these stages of a scene owe and that are not there."""
        of_a_picture = [self.source_json] if scene.input is None or is_picture(scene.input) else []
        owed = {
            "reconstruct": [self.gaussians_ply, *of_a_picture],
            "views": [self.cameras_json],
            "grouping": [self.groups_npz, self.parts_png],
            "interior": [self.continuum_npz],
            "materials": [self.materials_yaml],
            "simulate": [self.trajectory_npz, self.motion_json],
            "render": [self.preview_png, self.contact_sheet_png],
        }
        paths = [path for stage in stages for path in owed[stage]]
        if "render" in stages:
            paths.append(self.video_mp4 if not self.video_mp4.with_suffix(".webp").is_file() else self.preview_png)
            if scene.output.frames == "ply":
                paths += [frame_path(self.frames, index) for index in range(scene.frame_count)]
        return [path.relative_to(self.root).as_posix() for path in paths if not path.is_file()]

    def read_report(self) -> dict[str, Any]:
        """What report.json holds."""
        return json.loads(self.report_json.read_text("utf-8"))

    def _write_state(self) -> None:
        self.write_json(self._state_json, {"stages": {name: r.as_dict() for name, r in self.records.items()}})

    # ------------------------------------------------------------------------------------------------- writing

    def write_text(self, path: Path, text: str) -> None:
        """Write a UTF-8 text file whole."""
        with atomic_path(path) as temporary:
            temporary.write_text(text, encoding="utf-8", newline="\n")

    def write_scene(self, scene: Scene) -> None:
        """Write scene.yaml, unless it says the same already: a person's own comments in it stay."""
        try:
            same = self.scene_yaml.is_file() and load_scene(self.scene_yaml) == scene
        except SceneError:
            same = False
        if not same:
            self.write_text(self.scene_yaml, dump_scene(scene))

    def write_json(self, path: Path, value: Any) -> None:
        """Write JSON whole; NumPy values are converted, NaN and infinity become null."""
        self.write_text(path, json_text(value, indent=1))

    def write_npz(self, path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Write named arrays whole, without compression."""
        save_npz(path, arrays)

    def require_space(self, needed_bytes: int) -> None:
        """Refuse before a long run what the disk could not hold.

        Raises:
            RunError: less than ``needed_bytes`` and a reserve of 5 % are free; says how to need less.
        """
        free = shutil.disk_usage(self.root).free
        if free < 1.05 * needed_bytes:
            raise RunError(
                f"{self.root}: the run needs about {needed_bytes / 1e9:.1f} GB and {free / 1e9:.1f} GB are free; "
                "make room, or leave the frames out with --output.frames none."
            )


def _listed(phrases: Sequence[str]) -> str:
    return phrases[0] if len(phrases) == 1 else f"{phrases[0]}, and {len(phrases) - 1} more"
