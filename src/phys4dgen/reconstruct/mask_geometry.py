"""Distances, nearest pixels and connected pieces of a mask, and slopes of an image: SciPy with exact types."""

from __future__ import annotations

import numpy as np
import scipy.ndimage as nd
from numpy.typing import NDArray

__all__ = ["depth_inside", "nearest_inside", "pieces", "shrunk", "slopes"]


def depth_inside(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Distance of each pixel of the mask to the nearest pixel outside, 0 outside; px, the mask's shape."""
    return np.asarray(nd.distance_transform_edt(mask), np.float64)


def nearest_inside(mask: NDArray[np.bool_], *, along_rows: bool = False) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Row and column of the pixel of the mask nearest to each pixel; a mask without pixels gives the pixel itself.

    Args:
        mask: shape [H, W].
        along_rows: take the nearest one of the same row wherever that row has one.
    """
    if not mask.any():
        both = np.indices(mask.shape, np.int32)
        return both[0], both[1]
    sampling = (1e3, 1.0) if along_rows else None
    found = nd.distance_transform_edt(~mask, sampling=sampling, return_distances=False, return_indices=True)
    both = np.asarray(found, np.int32)
    return both[0], both[1]


def pieces(mask: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Number of the connected piece of each pixel from 1 (0 outside), and the pixels of each piece from number 1."""
    labels = np.zeros(mask.shape, np.int64)
    nd.label(mask, output=labels)
    return labels, np.bincount(labels.ravel())[1:]


def shrunk(mask: NDArray[np.bool_], px: int) -> NDArray[np.bool_]:
    """The mask without its outermost pixels."""
    return np.asarray(nd.binary_erosion(mask, iterations=px), bool) if px > 0 else mask


def slopes(image: NDArray[np.floating]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Derivatives of an image along x and along y, each of its shape."""
    values = np.asarray(image, np.float64)
    return np.asarray(np.gradient(values, axis=1)), np.asarray(np.gradient(values, axis=0))
