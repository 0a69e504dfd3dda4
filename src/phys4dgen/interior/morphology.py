"""Distances, connected pieces and the outermost layer of voxel sets (scipy.ndimage, whose types say little)."""

from __future__ import annotations

from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, distance_transform_edt, generate_binary_structure, label

__all__ = ["connected_pieces", "distance_to_false", "outermost_layer"]


def connected_pieces(solid: NDArray[np.bool_]) -> tuple[NDArray[np.int32], int]:
    """Piece of each voxel (26-neighbourhood), numbered from 1, 0 in the air; and how many pieces there are."""
    return cast(tuple[NDArray[np.int32], int], label(solid, np.ones((3, 3, 3), bool)))


def distance_to_false(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Distance in voxels to the nearest voxel where ``mask`` is False; 0 there."""
    return np.asarray(distance_transform_edt(mask))


def outermost_layer(solid: NDArray[np.bool_], *, layers: int = 1) -> NDArray[np.bool_]:
    """Solid voxels with a face on the air or on the border of the array; of more layers, those under them too."""
    return solid & ~np.asarray(binary_erosion(solid, generate_binary_structure(3, 1), iterations=layers), bool)
