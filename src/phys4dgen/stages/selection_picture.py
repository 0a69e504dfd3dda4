"""A picture of what was selected: the object in its colours, the scene round it pale and grey."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phys4dgen.render.cameras import view_cameras
from phys4dgen.render.rasterise import Rasteriser
from phys4dgen.stages.asset import Asset
from phys4dgen.stages.selection import Surroundings

__all__ = ["selection_picture"]

_VIEWS = (8, 10, 12, 28)
"""Of the ``object`` table: from the front, the side and behind at 10 degrees, and from the top."""

_WIDER = 1.2
_SIZE_PX = 384
_PALE = 0.25
_LUMA = np.array([0.299, 0.587, 0.114], np.float32)


def selection_picture(asset: Asset, around: Surroundings) -> NDArray[np.uint8]:
    """Four views side by side, shape [384, 1536, 3]."""
    whole = around.whole
    pale = 0.6 + 0.4 * np.repeat((whole.base_colors @ _LUMA)[:, None], 3, axis=1)
    colors = around.with_rest(asset.gaussians.base_colors, pale)
    opacities = around.with_rest(asset.gaussians.opacities, _PALE * whole.opacities)
    covariances = whole.covariances().reshape(-1, 9)[:, [0, 1, 2, 4, 5, 8]]
    margin = _WIDER * (asset.upper - asset.lower) / 2
    middle = (asset.upper + asset.lower) / 2
    cameras = view_cameras(
        "object", lower=middle - margin, upper=middle + margin, rotation=asset.frame.rotation, size_px=_SIZE_PX
    )
    rasteriser = Rasteriser()
    pictures = [
        rasteriser.render(whole.means, covariances, opacities, camera=cameras[view], colors=colors).rgb
        for view in _VIEWS
    ]
    return np.rint(np.clip(np.concatenate(pictures, axis=1), 0, 1) * 255).astype(np.uint8)
