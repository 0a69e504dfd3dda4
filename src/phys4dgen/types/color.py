"""sRGB to CIELAB (CIE 15:2004, D65 white), the one colour space in which distances mean something to an eye."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["lab_to_srgb", "srgb_to_lab"]

_RGB_TO_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
_WHITE_XYZ = _RGB_TO_XYZ.sum(1)
_DELTA = 6 / 29


def srgb_to_lab(rgb: NDArray[Any]) -> NDArray[np.float64]:
    """Lightness L in [0, 100] and the opponent axes a (green - red) and b (blue - yellow).

    Args:
        rgb: gamma-encoded sRGB, shape [.., 3]; clipped to [0, 1].
    """
    encoded = np.clip(np.asarray(rgb, np.float64), 0, 1)
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    xyz = linear @ _RGB_TO_XYZ.T / _WHITE_XYZ
    f = np.where(xyz > _DELTA**3, np.cbrt(xyz), xyz / (3 * _DELTA**2) + 4 / 29)
    return np.stack([116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], -1)


def lab_to_srgb(lab: NDArray[Any]) -> NDArray[np.float64]:
    """Gamma-encoded sRGB in [0, 1] of L, a, b, shape [.., 3]; colours that no screen shows are clipped."""
    lightness, a, b = np.moveaxis(np.asarray(lab, np.float64), -1, 0)
    middle = (lightness + 16) / 116
    f = np.stack([middle + a / 500, middle, middle - b / 200], -1)
    xyz = np.where(f > _DELTA, f**3, 3 * _DELTA**2 * (f - 4 / 29)) * _WHITE_XYZ
    linear = np.clip(xyz @ np.linalg.inv(_RGB_TO_XYZ).T, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
