"""What is rendered round the moving object: nothing, or the still scene that it was captured in."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phys4dgen.render.gsplat_backend import GsplatRasteriser
from phys4dgen.render.rasterise import Rasteriser, RenderResult
from phys4dgen.stages.asset import Asset
from phys4dgen.types import Camera

__all__ = ["Backdrop"]

_LUMA = np.array([0.299, 0.587, 0.114], np.float32)


class Backdrop:
    """Renders the object among its surroundings; what rests is prepared once."""

    def __init__(self, asset: Asset, *, is_overlay: bool) -> None:
        """Prepare; under an overlay the surroundings are grey, so that colours mean something on the object alone."""
        self._object = asset.gaussians
        self._around = asset.surroundings
        if self._around is not None:
            whole = self._around.shown()
            self._opacities = whole.opacities
            self._sh = whole.sh
            self._means = whole.means
            covariances = whole.covariances().reshape(-1, 9)[:, [0, 1, 2, 4, 5, 8]]
            self._covariances6 = covariances.astype(np.float32)
            self._still = np.tile(np.eye(3, dtype=np.float32), (len(whole), 1, 1))
            grey = np.repeat((whole.base_colors @ _LUMA)[:, None], 3, axis=1)
            self._grey = grey if is_overlay else None

    def render(
        self,
        rasteriser: Rasteriser | GsplatRasteriser,
        positions: NDArray[np.float32],
        covariances6: NDArray[np.float32],
        rotations: NDArray[np.float32],
        *,
        camera: Camera,
        background: tuple[float, float, float],
        colors: NDArray[np.float32] | None,
    ) -> RenderResult:
        """The object as it is now, and what is around it.

        Args:
            rasteriser: draws.
            positions: of the object, [M, 3].
            covariances6: of the object, [M, 6].
            rotations: which turn its colours, [M, 3, 3].
            camera: from where.
            background: colour behind everything.
            colors: of the object in an overlay, [M, 3]; None for its own.
        """
        opacities, sh = self._object.opacities, self._object.sh
        if self._around is not None:
            positions = self._around.with_rest(positions, self._means)
            covariances6 = self._around.with_rest(covariances6, self._covariances6)
            opacities, sh = self._opacities, self._sh
            if colors is not None and self._grey is not None:
                colors = self._around.with_rest(colors, self._grey)
            else:
                rotations = self._around.with_rest(rotations, self._still)
        return rasteriser.render(
            positions,
            covariances6,
            opacities,
            camera=camera,
            sh=sh if colors is None else None,
            colors=colors,
            sh_rotations=rotations if colors is None else None,
            background=background,
        )
