"""The network's raw numbers -> Gaussians, dropped where nothing would be seen, as LGM exports them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from phys4dgen.errors import StageError
from phys4dgen.reconstruct.lgm.configuration import GAUSSIAN_CHANNELS
from phys4dgen.types import SH_C0, Gaussians

__all__ = ["gaussians_from_raw"]

LEAST_OPACITY = 0.005
SCALE_UNIT = 0.1


def gaussians_from_raw(raw: NDArray[Any]) -> Gaussians:
    """Apply the activations and keep what is not transparent.

    Channels: position 3 (clipped to the cube [-1, 1]), opacity 1 (sigmoid), scale 3 (0.1 softplus), rotation 4
    (w, x, y, z, normalised), colour 3 (0.5 tanh + 0.5).

    Args:
        raw: of the network, shape [N, 14].

    Raises:
        StageError: not finite, or nothing is left.
    """
    if raw.ndim != 2 or raw.shape[1] != GAUSSIAN_CHANNELS:
        raise ValueError(f"raw: expected shape (any, {GAUSSIAN_CHANNELS}), got {raw.shape}.")
    if not np.isfinite(raw).all():
        raise StageError("LGM gave numbers that are not finite; expected Gaussians, so check the checkpoint's origin.")
    raw = np.asarray(raw, np.float64)
    opacities = expit(raw[:, 3])
    kept = opacities >= LEAST_OPACITY
    if not kept.any():
        raise StageError(
            "LGM found no object in the four views: every Gaussian is transparent; give an object on a white or "
            "transparent background that fills most of each view."
        )
    raw, opacities = raw[kept], opacities[kept]
    scales = SCALE_UNIT * np.logaddexp(0, raw[:, 4:7])
    quats = raw[:, 7:11]
    norms = np.linalg.norm(quats, axis=1, keepdims=True)
    quats = np.where(norms > 1e-12, quats / np.maximum(norms, 1e-12), [1.0, 0.0, 0.0, 0.0])
    # 0.5 tanh + 0.5 = 0.5 + SH_C0 * sh
    sh = 0.5 * np.tanh(raw[:, 11:]) / SH_C0
    return Gaussians(
        means=np.clip(raw[:, :3], -1, 1).astype(np.float32),
        quats_wxyz=quats.astype(np.float32),
        scales=np.maximum(scales, 1e-12).astype(np.float32),
        opacities=opacities.astype(np.float32),
        sh=sh[:, None].astype(np.float32),
    )
