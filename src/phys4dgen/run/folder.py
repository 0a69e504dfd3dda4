"""The run folder: where every artefact lies, who may write it, and what is already done.

Each file appears whole or not at all. ``.state.json`` records a digest of the input and settings behind every
stage (``stages.py``), so that a second ``generate`` knows whether it continues this run or would destroy another.
"""

from __future__ import annotations

import json
import logging
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import RunError
from phys4dgen.export.frames import frame_path
from phys4dgen.formats.atomic import atomic_path
from phys4dgen.run.json_text import json_text
from phys4dgen.run.lock import FolderLock
from phys4dgen.run.log import JsonLinesHandler
from phys4dgen.run.stages import STAGES
from phys4dgen.scene import Scene

__all__ = ["RunFolder", "finished_stages"]

_ALWAYS = ("scene.yaml", "report.json", "log.jsonl")
"""Files of the run as a whole."""

_STATE = ".state.json"


class RunFolder:
    """A run folder that this process holds; use it in a ``with`` statement.

    The names of all artefacts are attributes (README.md says what they hold), so that no other file spells them.
    ``input`` holds the splat of the demo; every other input stays where it is.
    """

    def __init__(self, root: Path | str) -> None:
        self.root = Path(root).absolute()
        self.input = self.root / "input"
        self.scene_yaml = self.root / "scene.yaml"
        self.gaussians_ply = self.root / "gaussians.ply"
        self.views = self.root / "views"
        self.cameras_json = self.views / "cameras.json"
        self.parts_png = self.root / "parts.png"
        self.groups_npz = self.root / "groups.npz"
        self.continuum_npz = self.root / "continuum.npz"
        self.materials_yaml = self.root / "materials.yaml"
        self.trajectory_npz = self.root / "trajectory.npz"
        self.motion_json = self.root / "motion.json"
        self.frames = self.root / "frames"
        self.video_mp4 = self.root / "video.mp4"
        self.preview_png = self.root / "preview.png"
        self.contact_sheet_png = self.root / "contact_sheet.png"
        self.report_json = self.root / "report.json"
        self.log_jsonl = self.root / "log.jsonl"
        self._state_json = self.root / _STATE
        self._lock = FolderLock(self.root)
        self._log_handler: logging.Handler | None = None
        self._digests: dict[str, str] = {}
        self._finished: dict[str, str] = {}
        self._warnings: dict[str, list[str]] = {}

    # ------------------------------------------------------------------------------------------------ taking it

    def claim(self, digests: Mapping[str, str], *, overwrite: bool = False) -> RunFolder:
        """Make or take the folder for a run with these stage digests, and lock it.

        A new or empty folder is made ready; the same input and settings continue; anything else is refused, or with
        ``overwrite`` loses the artefacts that no longer fit. Files that phys4dgen did not make are never removed.

        Raises:
            RunError: not a folder, not a run, of other settings, locked by another process, or not writable.
        """
        self.refuse_foreign_files()
        try:
            self.root.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RunError(f"{self.root}: cannot make the run folder: {error.strerror or error}.") from error
        self._lock.acquire()
        try:
            self._take_over(digests, overwrite=overwrite)
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

    def _take_over(self, digests: Mapping[str, str], *, overwrite: bool) -> None:
        old, finished, warnings = _read_state(self._state_json)
        changed = next((stage.name for stage in STAGES if old and old.get(stage.name) != digests[stage.name]), None)
        # A run that finished nothing (a damaged input, Ctrl-C at once) holds nothing that could be lost.
        if changed is not None and finished and not overwrite:
            what = "another input or other settings" if changed == STAGES[0].name else f"other settings of '{changed}'"
            raise RunError(
                f"{self.root}: holds a run with {what}; "
                "add --overwrite to replace what depends on them, or choose another place with -o."
            )
        self._digests = dict(digests)
        self._finished = {name: digest for name, digest in finished.items() if self._digests.get(name) == digest}
        self._warnings = {name: said for name, said in warnings.items() if name in self._finished}
        for leftover in self.root.rglob(".*.partial-*"):
            leftover.unlink(missing_ok=True)
        if changed is not None:
            self._remove_from(changed)
        self._write_state()

    def _remove_from(self, first: str) -> None:
        """Remove the artefacts of a stage and of those after it."""
        names = [stage.name for stage in STAGES]
        for stage in STAGES[names.index(first) :]:
            for pattern in stage.files:
                for path in self.root.glob(pattern):
                    if path.is_file():
                        path.unlink()
        for name in _ALWAYS:
            (self.root / name).unlink(missing_ok=True)

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

    def is_finished(self, stage: str) -> bool:
        """Whether ``stage`` ended with the input and settings of this run."""
        return self._finished.get(stage) == self._digests[stage]

    def finish(self, stage: str, *, warnings: Sequence[str] = ()) -> None:
        """Record that all files of ``stage`` are written, and what it warned of."""
        self._finished[stage] = self._digests[stage]
        self._warnings[stage] = list(warnings)
        self._write_state()

    def warnings_of(self, stage: str) -> Sequence[str]:
        """What ``stage`` warned of when it ran; its result is still to be judged by it."""
        return self._warnings.get(stage, ())

    def missing(self, scene: Scene, stages: Sequence[str]) -> list[str]:
        """Names of the files that ``stages`` of a scene owe and that are not there."""
        owed = {
            "views": [self.gaussians_ply, self.cameras_json],
            "grouping": [self.groups_npz, self.parts_png],
            "interior": [self.continuum_npz],
            "materials": [self.materials_yaml],
            "simulate": [self.trajectory_npz, self.motion_json],
            "render": [self.preview_png, self.contact_sheet_png],
        }
        paths = [self.scene_yaml, self.report_json, *(path for stage in stages for path in owed[stage])]
        if "render" in stages:
            paths.append(self.video_mp4 if not self.video_mp4.with_suffix(".webp").is_file() else self.preview_png)
            if scene.output.frames == "ply":
                paths += [frame_path(self.frames, index) for index in range(scene.frame_count)]
        return [path.relative_to(self.root).as_posix() for path in paths if not path.is_file()]

    def read_report(self) -> dict[str, Any]:
        """What report.json holds."""
        return json.loads(self.report_json.read_text("utf-8"))

    def _write_state(self) -> None:
        state = {"digests": self._digests, "finished": self._finished, "warnings": self._warnings}
        self.write_json(self._state_json, state)

    # ------------------------------------------------------------------------------------------------- writing

    def write_text(self, path: Path, text: str) -> None:
        """Write a UTF-8 text file whole."""
        with atomic_path(path) as temporary:
            temporary.write_text(text, encoding="utf-8", newline="\n")

    def write_json(self, path: Path, value: Any) -> None:
        """Write JSON whole; NumPy values are converted, NaN and infinity become null."""
        self.write_text(path, json_text(value, indent=1))

    def write_npz(self, path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Write named arrays whole, without compression (they are read more often than they are sent)."""
        with atomic_path(path) as temporary, temporary.open("wb") as file:
            np.savez(file, allow_pickle=False, **arrays)

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


def finished_stages(root: Path | str) -> list[str]:
    """The stages that are complete in a run folder, in order; none where there is no run.

    Raises:
        RunError: the state of the run is damaged.
    """
    _, finished, _ = _read_state(Path(root) / _STATE)
    return [stage.name for stage in STAGES if stage.name in finished]


def _read_state(path: Path) -> tuple[dict[str, str], dict[str, str], dict[str, list[str]]]:
    """Digests by stage of the run in a folder, as begun and as finished, and the warnings by stage."""
    if not path.is_file():
        return {}, {}, {}
    try:
        state = json.loads(path.read_text("utf-8"))
        return dict(state["digests"]), dict(state["finished"]), dict(state["warnings"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise RunError(f"{path}: expected the state of a run, got a damaged file; choose another place.") from error
