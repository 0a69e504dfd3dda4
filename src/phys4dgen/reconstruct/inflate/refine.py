"""Small corrections of the colours until the canonical camera sees the picture itself."""

from __future__ import annotations

import numpy as np
import scipy.ndimage as nd
from numpy.typing import NDArray

from phys4dgen.reconstruct.inflate.surface import at
from phys4dgen.reconstruct.mask_geometry import shrunk
from phys4dgen.render.rasterise import Rasteriser, packed_covariances
from phys4dgen.types import Camera, Gaussians

__all__ = ["refined_colors"]

_STEPS = 4
_GAIN = 1.2


def refined_colors(
    gaussians: Gaussians,
    colors: NDArray[np.float64],
    *,
    picture: NDArray[np.float32],
    camera: Camera,
    position: NDArray[np.float64],
    facing: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Colours after a few Jacobi steps on the residual of the front view.

    Pixels that are not opaque are left alone: to correct those would paint grey streaks on the sides.

    Args:
        gaussians: N Gaussians; their own colours are not used.
        colors: RGB to start from, shape [N, 3].
        picture: target, straight sRGB and opacity, shape [S, S, 4].
        camera: of the picture.
        position: where each Gaussian lies in the picture, px, shape [N, 2 or 3].
        facing: cosine between the normal and the direction to the camera, shape [N].
    """
    rasteriser = Rasteriser()
    covariances = packed_covariances(gaussians.covariances())
    inner = shrunk(picture[..., 3] > 0.5, 2)
    weight = np.clip(2.5 * facing - 0.1, 0, 1)[:, None]
    for _ in range(_STEPS):
        seen = rasteriser.render(
            gaussians.means, covariances, gaussians.opacities,
            camera=camera, colors=colors.astype(np.float32), antialiased=False,
        )  # fmt: skip
        trusted = (inner & (seen.alpha > 0.9))[..., None]
        residual = np.where(trusted, picture[..., :3] - seen.rgb, 0).astype(np.float64)
        residual = nd.gaussian_filter(residual, (0.7, 0.7, 0))
        colors = np.clip(colors + _GAIN * weight * at(residual, position), 0, 1)
    return colors
