"""How much of the lightness of a surface is the light's doing.

Two touching patches of one chroma are mostly of one material; what then differs is how they face the light and how
much of the sky they see. That is fitted over all such pairs, as in gradient-domain intrinsic images (Land and McCann,
"Lightness and Retinex Theory", 1971), with a light of second-order spherical harmonics (Ramamoorthi and Hanrahan, "An
Efficient Representation for Irradiance Environment Maps", 2001), and is then taken out of every patch.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phys4dgen.grouping.supervoxels import LIGHTNESS_WEIGHT, Supervoxels

__all__ = ["LAB_OFFSET", "unlit"]

LAB_OFFSET = 16.0
"""L + 16, a and b of CIELAB grow and shrink by one factor under more or less of the same light."""
_CHROMA_SCALE = 6.0
"""Pairs whose chroma differs by much more are two materials and say nothing of the light."""
_RESIDUAL_SCALE = 0.08
"""Change of log lightness from which a pair counts as an edge of paint (Cauchy weights)."""
_THIN = 0.15
"""A thinner patch shows two faces, so that its normal says nothing of the light."""
_ROUNDS = 15
_MIN_PAIRS = 50
_RIDGE = 5e-5
_MAX_LOG = 0.9
"""Largest change of log lightness that is taken for light."""


def unlit(patches: Supervoxels) -> NDArray[np.float64]:
    """Mean colour (LIGHTNESS_WEIGHT * L, a, b) of the patches under even light, shape [S, 3]."""
    lightness = patches.mean[:, 0] / LIGHTNESS_WEIGHT + LAB_OFFSET
    factor = np.exp(-_light(patches, np.log(np.maximum(lightness, 1.0))))
    bright = np.clip(lightness * factor, LAB_OFFSET, 110 + LAB_OFFSET)
    chroma = patches.mean[:, 1:] * (bright / np.maximum(lightness, 1.0))[:, None]
    return np.concatenate([LIGHTNESS_WEIGHT * (bright - LAB_OFFSET)[:, None], chroma], 1)


def _light(patches: Supervoxels, log_lightness: NDArray[np.float64]) -> NDArray[np.float64]:
    """Part of the log lightness that the light explains, 0 in the mean and on thin patches; shape [S]."""
    i, j = np.nonzero(np.triu(patches.border))
    x, y, z = patches.normal.T
    harmonics = [x, y, z, x * y, y * z, x * z, x * x - y * y, 3 * z * z - 1]
    basis = np.stack([*harmonics, 3 * patches.openness], 1)
    change, lit = log_lightness[i] - log_lightness[j], basis[i] - basis[j]
    chroma = np.linalg.norm(patches.mean[i, 1:] - patches.mean[j, 1:], axis=1)
    solid = patches.thinness < _THIN
    trust = patches.border[i, j] * np.exp(-((chroma / _CHROMA_SCALE) ** 2)) * (solid[i] & solid[j])
    if (trust > 1e-3).sum() < _MIN_PAIRS:
        return np.zeros(len(log_lightness))
    weight, coefficients = trust, np.zeros(basis.shape[1])
    ridge = _RIDGE * trust.sum() * np.eye(basis.shape[1])
    for _ in range(_ROUNDS):  # reweighted least squares
        normal_matrix = (lit * weight[:, None]).T @ lit + ridge
        coefficients = np.linalg.solve(normal_matrix, (lit * weight[:, None]).T @ change)
        weight = trust / (1 + ((change - lit @ coefficients) / _RESIDUAL_SCALE) ** 2)
    light = basis @ coefficients
    light = np.clip(light - np.average(light, weights=patches.area), -_MAX_LOG, _MAX_LOG)
    return light * (1 - np.clip(patches.thinness / 0.2, 0, 1))
