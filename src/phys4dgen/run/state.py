"""``.state.json``: what each finished stage was made from, so that a later command knows what still holds."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from phys4dgen.errors import RunError, SceneError
from phys4dgen.run.stages import STAGES, Needs, scene_settings, stage_named
from phys4dgen.scene import load_scene

__all__ = ["STATE_NAME", "StageRecord", "finished_stages", "read_state"]

STATE_NAME = ".state.json"


@dataclass(frozen=True)
class StageRecord:
    """A stage that ended with all its files written.

    Attributes:
        needs: what its result followed from.
        products: digest by name of what it made.
        chosen: settings that it replaced by its own choice in scene.yaml; asked for like that the result is the same.
        warnings: what it warned of; its result is still to be judged by it.
        seconds: that it took.
        files: size and modification time (ns) of its files when they were last read or written, by name.
        replaced: a command began to write other files in the place of these, and has not ended yet.
    """

    needs: Needs
    products: Mapping[str, str]
    chosen: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    seconds: float = 0.0
    files: Mapping[str, list[int]] = field(default_factory=dict)
    replaced: bool = False

    def changes(self, needs: Needs) -> list[str]:
        """Why the result does not hold for ``needs``, one phrase each; empty where it does."""
        halfway = ["a command that made it again did not end"] if self.replaced else []
        return [*needs.changes(self._made_for(needs)), *halfway]

    def changed_settings(self, needs: Needs) -> list[str]:
        """As ``changes``, of the settings alone."""
        return needs.changed_settings(self._made_for(needs))

    def _made_for(self, needs: Needs) -> Needs:
        """The recorded needs, with the choices in place of what was asked for where ``needs`` has them."""
        taken = {key: value for key, value in self.chosen.items() if needs.settings.get(key) == value}
        return Needs({**self.needs.settings, **taken}, self.needs.products, self.needs.code)

    def as_dict(self) -> dict[str, Any]:
        """What the state file holds."""
        return asdict(self)


def read_state(folder: Path) -> dict[str, StageRecord]:
    """The finished stages of a run folder, by name and in order; none where there is no run.

    Raises:
        RunError: the state is damaged.
    """
    path = folder / STATE_NAME
    if not path.is_file():
        return {}
    try:
        stages = json.loads(path.read_text("utf-8"))["stages"]
        records = {name: _record(entry) for name, entry in stages.items()}
        return {stage.name: records[stage.name] for stage in STAGES if stage.name in records}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise RunError(f"{path}: expected the state of a run, got a damaged file; choose another place.") from error


def finished_stages(folder: Path | str) -> list[str]:
    """Names of the stages that are complete in a run folder, follow from each other and fit its scene.yaml, in order.

    Raises:
        RunError: the state of the run is damaged.
    """
    finished: list[str] = []
    products: dict[str, str] = {}
    settings = _settings_of(Path(folder))
    for name, record in read_state(Path(folder)).items():
        follows = all(products.get(taken) == digest for taken, digest in record.needs.products.items())
        fits = settings is None or not record.changed_settings(
            Needs.of(stage_named(name), settings, record.needs.products)
        )
        if follows and fits and not record.replaced:
            finished.append(name)
            products |= record.products
    return finished


def _settings_of(folder: Path) -> dict[str, Any] | None:
    """What scene.yaml says; None where it is not there, or cannot be read."""
    try:
        return scene_settings(load_scene(folder / "scene.yaml"))
    except (SceneError, RunError):
        return None


def _record(entry: dict[str, Any]) -> StageRecord:
    needs = Needs(**entry.pop("needs"))
    return StageRecord(needs=needs, warnings=tuple(entry.pop("warnings")), **entry)
