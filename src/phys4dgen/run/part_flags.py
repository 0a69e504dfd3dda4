"""The flags of ``group`` as edits of a scene: names or numbers of parts, and clicks in the views of the run."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydantic import ValidationError

from phys4dgen.errors import SceneError, StageError, did_you_mean
from phys4dgen.grouping.label_maps import read_cameras
from phys4dgen.grouping.seeds import gaussian_at
from phys4dgen.render.cameras import DEFAULT_FOVY_DEG, orbit_camera
from phys4dgen.run.folder import RunFolder
from phys4dgen.run.source_files import read_source
from phys4dgen.scene import PartEdit, Scene
from phys4dgen.scene.errors import explain
from phys4dgen.stages.segmentation import decide
from phys4dgen.types import Camera, Gaussians, rotation_to_z_up

__all__ = ["Clicks", "edits_of_flags"]

_FRONT_ELEVATION_DEG = 10.0
_DIGITS = 6
"""Of a clicked point's coordinates, which find the same Gaussian again."""


class Clicks:
    """Finds the points that clicks in the views of a run show."""

    def __init__(self, run: RunFolder, scene: Scene) -> None:
        self._run, self._scene = run, scene
        self._cameras: Mapping[str, Camera] | None = None
        self._gaussians: Gaussians | None = None

    def point(self, view: str, x_px: float, y_px: float) -> tuple[float, ...]:
        """The place of the Gaussian that a pixel shows, input coordinates.

        Args:
            view: name or number of a camera in cameras.json.
            x_px: column from the left edge of the view.
            y_px: row from its upper edge.

        Raises:
            SceneError: there is no such view.
            StageError: the pixel lies outside the view or beside the object.
        """
        camera = self._camera(view)[1]
        if self._gaussians is None:
            self._gaussians = read_source(self._run, self._scene).gaussians
        mean = self._gaussians.means[gaussian_at(self._gaussians, camera, x_px, y_px)]
        return tuple(float(f"{value:.{_DIGITS}g}") for value in mean)

    def box(self, view: str, corners_px: Sequence[float]) -> dict[str, Any]:
        """A box in a view as a scene keeps it, in shares of the picture.

        Args:
            view: name or number of a camera in cameras.json.
            corners_px: left, top, right and bottom, pixels.

        Raises:
            SceneError: there is no such view, or the box lies outside it.
        """
        name, camera = self._camera(view)
        left, top, right, bottom = corners_px
        if not (0 <= left < right <= camera.width and 0 <= top < bottom <= camera.height):
            raise SceneError(
                f"expected a box inside the {camera.width} x {camera.height} px of {name}, left < right and top < "
                f"bottom, got {', '.join(f'{value:g}' for value in corners_px)}."
            )
        size = (camera.width, camera.height) * 2
        return {"view": name, "corners": tuple(value / whole for value, whole in zip(corners_px, size, strict=True))}

    def front_view(self) -> str:
        """Name of the view that looks from the front, a little from above: the canonical one."""
        up = np.array(json.loads(self._run.cameras_json.read_text("utf-8"))["up"], np.float64)
        wanted = orbit_camera(
            azimuth_deg=0.0, elevation_deg=_FRONT_ELEVATION_DEG, target=np.zeros(3), rotation=rotation_to_z_up(up),
            radius=1.0, fovy_deg=DEFAULT_FOVY_DEG, width=1, height=1,
        ).viewmat[2, :3]  # fmt: skip
        cameras = self._cameras_of()
        return max(cameras, key=lambda name: float(cameras[name].viewmat[2, :3] @ wanted))

    def network_is_ready(self, *, needed: bool) -> bool:
        """Whether SAM2 finds what is pointed at; colour and shape do where it is not there or would take long.

        Args:
            needed: nothing else can.

        Raises:
            StageError: it is needed and not ready.
        """
        backend = "sam2" if needed or self._scene.grouping.backend == "sam2" else "auto"
        scene = self._scene.with_overrides(
            {"grouping.backend": backend, "grouping.parts": "auto", "grouping.labels_file": None}
        )
        return decide(scene, len(self._cameras_of())).folder is not None

    def _cameras_of(self) -> Mapping[str, Camera]:
        if self._cameras is None:
            self._cameras = read_cameras(self._run.cameras_json)
        return self._cameras

    def _camera(self, view: str) -> tuple[str, Camera]:
        """The name and the camera of a view."""
        cameras = self._cameras_of()
        names = list(cameras)
        if view.isdecimal() and int(view) < len(names):
            view = names[int(view)]
        if view not in cameras:
            raise SceneError(
                f"there is no view '{view}'; the views are {names[0]} to {names[-1]}, or 0 to {len(names) - 1}."
            )
        return view, cameras[view]


def edits_of_flags(flags: Sequence[tuple[str, str]], names: Sequence[str], clicks: Clicks) -> list[PartEdit]:
    """The edits that flags ask for, in their order; clicks after a split say which pieces it gives.

    Args:
        flags: ("merge", "a,b"), ("rename", "old=new"), ("split", "a=2"), ("split", "a"), ("split", "a@x,y=b") or
            ("seed", "a@view,x,y"). A part stands by its name or, as in parts.png, by its number until an edit changes
            the numbers.
        names: of the parts before.
        clicks: finds what was clicked on.

    Raises:
        SceneError: a flag is not of its form, or there is no such part, view or place.
    """
    edits: list[PartEdit] = []
    numbered = True
    at = 0
    while at < len(flags):
        kind, text = flags[at]
        at += 1
        if kind == "merge":
            edit = _merge(text, names, numbered=numbered)
        elif kind == "rename":
            edit = _rename(text, names, numbered=numbered)
        else:
            clicked = [] if kind == "split" else [text]
            while at < len(flags) and flags[at][0] == "seed":
                clicked.append(flags[at][1])
                at += 1
            edit = _split(text if kind == "split" else None, clicked, names, clicks=clicks, numbered=numbered)
            numbered = False
        edits.append(edit)
        names = _names_after(names, edit)
    return edits


def _merge(text: str, names: Sequence[str], *, numbered: bool) -> PartEdit:
    merged = [_part(word.strip(), names, "--merge", numbered=numbered) for word in text.split(",")]
    if len(set(merged)) < 2:
        raise SceneError(f"--merge: expected two or more parts such as leaves,stem, got '{text}'.")
    return _edit("--merge", merge=tuple(dict.fromkeys(merged)))


def _rename(text: str, names: Sequence[str], *, numbered: bool) -> PartEdit:
    old, equals, new = (word.strip() for word in text.partition("="))
    if not (old and equals and new):
        raise SceneError(f"--rename: expected OLD=NEW such as 0=pot, got '{text}'.")
    name = _part(old, names, "--rename", numbered=numbered)
    if new in names and new != name:
        raise SceneError(f"--rename: '{name}' cannot be called '{new}', which another part is called already.")
    return _edit("--rename", rename=name, to=new)


def _split(
    text: str | None, clicked: Sequence[str], names: Sequence[str], *, clicks: Clicks, numbered: bool
) -> PartEdit:
    """One part divided by appearance or by clicks; all parts by clicks where ``text`` is None."""
    seeds: dict[str, list[tuple[float, ...]]] = {}
    for click in clicked:
        name, point = _seed(click, clicks)
        seeds.setdefault(name, []).append(point)
    points = {name: tuple(found) for name, found in seeds.items()}
    if text is None:
        if len(points) < 2:
            raise SceneError(
                f"--seed: one part alone was clicked on, '{next(iter(points))}'; click on every part that there shall "
                f"be, or say which part it is a piece of with --split before it: {_listed(names)}."
            )
        return _edit("--seed", seeds=points)
    old, equals, count = (word.strip() for word in text.partition("="))
    if "@" in old:
        if points:
            raise SceneError(f"--split {text}: it points at a piece already; leave --seed out, or the place after @.")
        return _pointed_at(text, names, clicks=clicks, numbered=numbered)
    name = _part(old, names, "--split", numbered=numbered)
    if equals and (points or not count.isdecimal()):
        got = f"'{text}' and clicks" if points else f"'{text}'"
        raise SceneError(f"--split: expected NAME=K with a number of pieces, or NAME with --seed after it, got {got}.")
    others = [other for other in names if other != name]
    edit = _edit("--split", split=name, seeds=points, pieces=None if points else int(count or 2))
    taken = [piece for piece in edit.pieces_of if piece in others]
    if taken:
        raise SceneError(f"--split: a piece of '{name}' cannot be called '{taken[0]}': there is such a part.")
    return edit


def _pointed_at(text: str, names: Sequence[str], *, clicks: Clicks, numbered: bool) -> PartEdit:
    """NAME@X,Y or NAME@LEFT,TOP,RIGHT,BOTTOM, a view before the numbers if it is not the front one, =PIECE at will."""
    whole, _, piece = (word.strip() for word in text.partition("="))
    old, _, place = (word.strip() for word in whole.partition("@"))
    name = _part(old, names, "--split", numbered=numbered)
    words = [word.strip() for word in place.split(",")]
    view = words.pop(0) if len(words) in (3, 5) else clicks.front_view()
    try:
        numbers = tuple(float(word) for word in words)
        if len(numbers) not in (2, 4):
            raise ValueError
    except ValueError:
        raise SceneError(
            f"--split: expected NAME@X,Y or NAME@LEFT,TOP,RIGHT,BOTTOM in pixels of {clicks.front_view()}, or with "
            f"another view as in {name}@view_03,120,200, got '{text}'."
        ) from None
    piece = piece or next(free for k in range(1, 300) if (free := f"{name}_{k}") not in names)
    if piece in names:
        raise SceneError(f"--split: a piece of '{name}' cannot be called '{piece}': there is such a part.")
    try:
        by = "sam2" if clicks.network_is_ready(needed=len(numbers) == 4) else "appearance"
        if len(numbers) == 4:
            return _edit("--split", split=name, boxes={piece: clicks.box(view, numbers)}, by=by)
        return _edit("--split", split=name, seeds={piece: (clicks.point(view, *numbers),)}, by=by)
    except (SceneError, StageError) as error:
        raise SceneError(f"--split {text}: {str(error).removeprefix('grouping: ')}") from error


def _seed(text: str, clicks: Clicks) -> tuple[str, tuple[float, ...]]:
    """The name and the place of NAME@VIEW,X,Y."""
    name, _, place = (word.strip() for word in text.partition("@"))
    words = [word.strip() for word in place.split(",")]
    try:
        view, (x_px, y_px) = words[0], map(float, words[1:])
    except ValueError:
        raise SceneError(f"--seed: expected NAME@VIEW,X,Y such as pot@view_03,120,200, got '{text}'.") from None
    try:
        return name, clicks.point(view, x_px, y_px)
    except (SceneError, StageError) as error:
        raise SceneError(f"--seed {text}: {str(error).removeprefix('grouping: ')}") from error


def _edit(flag: str, **values: Any) -> PartEdit:
    try:
        return PartEdit.model_validate(values)
    except ValidationError as error:
        raise SceneError(explain(error, PartEdit, source=flag, places={})) from error


def _names_after(names: Sequence[str], edit: PartEdit) -> list[str]:
    """What parts are called after an edit; after a split, in no particular order."""
    if edit.rename is not None and edit.to is not None:
        return [edit.to if name == edit.rename else name for name in names]
    if edit.merge:
        first = min(edit.merge, key=names.index)
        return [edit.merge[0] if name == first else name for name in names if name == first or name not in edit.merge]
    if edit.split is None:
        return list(edit.pieces_of)
    return [*(name for name in names if name != edit.split), *edit.pieces_of]


def _part(word: str, names: Sequence[str], flag: str, *, numbered: bool) -> str:
    if word.isdecimal() and not numbered:
        raise SceneError(
            f"{flag} {word}: a split gives the parts other numbers; name the part, or use a second command."
        )
    if word.isdecimal() and int(word) < len(names):
        return names[int(word)]
    if word not in names:
        listed = _listed(names) if numbered else ", ".join(names)
        raise SceneError(f"{flag}: there is no part '{word}'; the parts are {listed}.{did_you_mean(word, names)}")
    return word


def _listed(names: Sequence[str]) -> str:
    return ", ".join(f"{number} {name}" for number, name in enumerate(names))
