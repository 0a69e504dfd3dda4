"""The object inside a captured scene: which Gaussians are its own, and what becomes of the rest."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import FormatError, SceneError, did_you_mean
from phys4dgen.grouping.npy_files import read_npy, read_npz
from phys4dgen.scene import Scene
from phys4dgen.types import Gaussians

__all__ = ["Surroundings", "surroundings_of"]

_FEWEST = 16
_MOST_NAME_BYTES = 1 << 20


@dataclass(frozen=True, eq=False)
class Surroundings:
    """The scene that an object of M Gaussians was captured in.

    Attributes:
        whole: all N Gaussians of the input, in its order.
        object_rows: those that are the object, ascending, int64 [M].
        are_hidden: the rest is not shown.
    """

    whole: Gaussians
    object_rows: NDArray[np.int64]
    are_hidden: bool

    @property
    def object_gaussians(self) -> Gaussians:
        """The object alone."""
        return self.whole.subset(self.object_rows)

    def shown(self) -> Gaussians:
        """All N Gaussians, the rest fully transparent where it is hidden."""
        if not self.are_hidden:
            return self.whole
        opacities = np.zeros(len(self.whole), np.float32)
        opacities[self.object_rows] = self.whole.opacities[self.object_rows]
        return replace(self.whole, opacities=opacities)

    def with_rest(self, of_object: NDArray[Any], of_rest: NDArray[Any]) -> NDArray[Any]:
        """One row per Gaussian of the scene: the object's M rows, and the rest as in ``of_rest`` [N, ..]."""
        values = np.array(of_rest)
        values[self.object_rows] = of_object
        return values

    def moved(
        self, positions: NDArray[np.float32], gradients: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Positions [N, 3] and deformation gradients [N, 3, 3] of all, of those of the object; the rest rests."""
        still = np.tile(np.eye(3, dtype=np.float32), (len(self.whole), 1, 1))
        return self.with_rest(positions, self.whole.means), self.with_rest(gradients, still)


def surroundings_of(scene: Scene, gaussians: Gaussians) -> Surroundings | None:
    """What the scene selects of the input's Gaussians; None where everything is the object.

    Raises:
        SceneError: too few Gaussians are selected.
        FormatError: the file of labels does not fit.
    """
    wanted = scene.select
    if wanted.selects_all:
        return None
    means = gaussians.means.astype(np.float64)
    chosen = np.ones(len(means), np.bool_)
    if wanted.box is not None:
        chosen &= ((means >= wanted.box[:3]) & (means <= wanted.box[3:])).all(1)
    if wanted.sphere is not None:
        chosen &= np.linalg.norm(means - wanted.sphere[:3], axis=1) <= wanted.sphere[3]
    if wanted.labels_file is not None:
        chosen &= _labelled(wanted.labels_file, wanted.labels, len(means))
    if chosen.sum() < _FEWEST:
        low, high = gaussians.robust_bounds()
        raise SceneError(
            f"select: {int(chosen.sum())} of {len(means)} Gaussians are selected, at least {_FEWEST} are needed; the "
            f"scene reaches from {_place(low)} to {_place(high)} ('phys4dgen inspect' says more)."
        )
    return Surroundings(gaussians, np.flatnonzero(chosen), wanted.rest == "hide")


def _labelled(path: Path, wanted: tuple[int | str, ...], count: int) -> NDArray[np.bool_]:
    """Which Gaussians bear one of the labels, [N]."""
    limits = {"labels": 8 * count, "names": _MOST_NAME_BYTES}
    arrays = read_npz(path, "labels", limits) if path.suffix.lower() == ".npz" else {}
    labels = arrays["labels"] if arrays else read_npy(path, "labels", limits["labels"])
    if labels.shape != (count,) or labels.dtype.kind not in "iu":
        raise FormatError(
            f"{path}: labels must hold one whole number for each of the input's {count} Gaussians, got "
            f"{labels.dtype} of shape {labels.shape}; save them in the order of the input file."
        )
    present = np.unique(labels).tolist()
    given = arrays.get("names")
    names: list[str] = [] if given is None or given.dtype.kind != "U" or given.ndim != 1 else given.tolist()
    numbers = [number for number in present if number >= 0]
    by_name = dict(zip(names, range(len(names)) if len(names) != len(numbers) else numbers, strict=True))
    for label in wanted:
        if (by_name.get(label) if isinstance(label, str) else label) not in present:
            known = ", ".join([*by_name, *map(str, present[:12])]) or "none"
            raise SceneError(
                f"select.labels: there is no label '{label}' in {path.name}; there are {known}."
                f"{did_you_mean(str(label), list(by_name))}"
            )
    return np.isin(labels, [by_name[label] if isinstance(label, str) else label for label in wanted])


def _place(point: NDArray[np.float64]) -> str:
    return f"({', '.join(f'{value:.3g}' for value in point)})"
