"""Patches of the surface in numbers that say how alike they are, freed of light and shade as far as colour allows.

What the light explains is taken out first (``lighting``). Under more or less of the same light L + 16, a and b of
CIELAB grow and shrink by one factor; lightness therefore counts half, and a and b are divided by it: a pot and a
shadow on it then differ in one number out of three.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phys4dgen.grouping.diameter import log_diameter
from phys4dgen.grouping.lighting import unlit
from phys4dgen.grouping.roundness import rod_likeness
from phys4dgen.grouping.supervoxels import LIGHTNESS_WEIGHT, Supervoxels

__all__ = ["CREASE_FREE", "PatchGraph", "patch_graph"]

_CHROMA_OFFSET = 70.0
"""a and b are divided by lightness plus this before they are compared: in the shade both shrink with the light. Without
the offset the noise of dark colours would count most."""
_THINNESS = 22.0
"""Units of colour that a leaf and a solid of one colour lie apart."""
_RODNESS = 25.0
"""Units of colour that a stalk and a leaf of one colour lie apart."""
CREASE_FREE = 0.15
"""Concavity that curved surfaces have anyway."""


@dataclass(frozen=True, eq=False)
class PatchGraph:
    """S patches of the visible surface, in numbers that say how alike they are; plain arrays, to be kept in a file.

    Attributes:
        patch: patch of every Gaussian that is visible surface, -1 elsewhere, shape [N].
        color: the colour that each of them shows (half the lightness, a, b), 0 elsewhere, shape [N, 3].
        visible: seen in at least one view, faint ones too, shape [N].
        area: share of the surface, shape [S].
        feature: mean colour (half the lightness, a and b freed of shading), weighted thinness and weighted likeness to
            a rod, shape [S, 5].
        spread: standard deviation of the colour, shape [S, 3].
        centre: mean position, input units, shape [S, 3].
        normal: unit normal, turned towards the cameras, shape [S, 3].
        flatness: 1 for a plane, 0 for a ball or a rod, shape [S].
        diameter: logarithm of how thick the object is below, in halves of its diagonal, shape [S].
        touching: pairs of patches with a common border, the lower number first, shape [E, 2].
        border: length of that border in neighbour pairs, shape [E].
        crease: how much the surface folds inwards there, in [-0.5, 1], negative on convex edges, shape [E].
    """

    patch: NDArray[np.int32]
    color: NDArray[np.float32]
    visible: NDArray[np.bool_]
    area: NDArray[np.float64]
    feature: NDArray[np.float64]
    spread: NDArray[np.float64]
    centre: NDArray[np.float64]
    normal: NDArray[np.float64]
    flatness: NDArray[np.float64]
    diameter: NDArray[np.float64]
    touching: NDArray[np.int32]
    border: NDArray[np.float64]
    crease: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.area)

    def subset(self, chosen: NDArray[np.intp]) -> PatchGraph:
        """The patches ``chosen`` alone, numbered in that order; their areas add up to 1."""
        number = np.full(len(self), -1, np.int32)
        number[chosen] = np.arange(len(chosen))
        inside = (number[self.touching] >= 0).all(1)
        return PatchGraph(
            patch=np.where(self.patch >= 0, number[self.patch], -1).astype(np.int32),
            color=self.color,
            visible=self.visible,
            area=self.area[chosen] / self.area[chosen].sum(),
            feature=self.feature[chosen],
            spread=self.spread[chosen],
            centre=self.centre[chosen],
            normal=self.normal[chosen],
            flatness=self.flatness[chosen],
            diameter=self.diameter[chosen],
            touching=number[self.touching[inside]].reshape(-1, 2),
            border=self.border[inside],
            crease=self.crease[inside],
        )


def patch_graph(
    patches: Supervoxels, means: NDArray[np.float32], visible: NDArray[np.bool_], *, radius: float
) -> PatchGraph:
    """What merging needs to know of the patches.

    Args:
        patches: S patches of the visible surface.
        means: centres of the N Gaussians, shape [N, 3].
        visible: which of them at least one view sees, shape [N].
        radius: half the object's diagonal, input units.
    """
    patch_of_gaussian = np.full(len(visible), -1, np.int32)
    patch_of_gaussian[patches.core] = patches.patch
    shown = np.zeros((len(visible), 3), np.float32)
    shown[patches.core] = patches.color
    first, second = np.nonzero(np.triu(patches.border))
    color = unlit(patches)
    lightness = color[:, :1] / LIGHTNESS_WEIGHT
    unshaded = (50 + _CHROMA_OFFSET) / (lightness + _CHROMA_OFFSET)  # 1 at middle lightness
    thinness = _THINNESS * patches.thinness
    points = means[patches.core].astype(np.float64)
    rod = _RODNESS * rod_likeness(patches, points, radius=radius)
    return PatchGraph(
        patch=patch_of_gaussian,
        color=shown,
        visible=visible,
        area=patches.area,
        feature=np.concatenate([color[:, :1], color[:, 1:] * unshaded, np.stack([thinness, rod], 1)], 1),
        spread=patches.spread,
        centre=patches.centre,
        normal=patches.normal,
        flatness=patches.flatness,
        diameter=log_diameter(patches, points),
        touching=np.stack([first, second], 1).astype(np.int32),
        border=patches.border[first, second],
        crease=_crease(patches, first, second),
    )


def _crease(patches: Supervoxels, i: NDArray[np.intp], j: NDArray[np.intp]) -> NDArray[np.float64]:
    """How much the surface folds inwards between touching flat patches, in [-0.5, 1]; negative on convex edges."""
    direction = patches.centre[j] - patches.centre[i]
    direction = direction / np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-12)
    concavity = ((patches.normal[i] - patches.normal[j]) * direction).sum(1)
    flatness = np.minimum(patches.flatness[i], patches.flatness[j])
    return np.clip(concavity - CREASE_FREE, -0.5, 1) * flatness
