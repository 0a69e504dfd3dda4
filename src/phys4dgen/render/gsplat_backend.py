"""The renderer on an NVIDIA GPU: gsplat's CUDA kernels behind the signature of ``Rasteriser.render``.

gsplat (Apache-2.0) composites with the same rules as ours (0.3 px^2 blur, alpha >= 1/255), with two differences: it
has the expected depth only, so views whose median depth is wanted stay on the CPU; and it drops the Gaussian at which
transmittance falls below 1e-4 instead of blending it. Written against gsplat 1.5. Its projection and spherical
harmonics are compared with ours on the CPU in the tests; its CUDA compositing has not been run by us.
"""

from __future__ import annotations

import ctypes
import importlib.util
import sys
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from phys4dgen.render.rasterise import WHITE, RenderResult, default_near, packed_covariances
from phys4dgen.types import Camera

if TYPE_CHECKING:
    import torch  # pyright: ignore[reportMissingImports]

__all__ = ["GsplatRasteriser", "cuda_driver_is_installed", "gsplat_is_ready"]

_UPPER = [0, 1, 2, 1, 3, 4, 2, 4, 5]
"""Places of the packed xx, xy, xz, yy, yz, zz in the nine of a symmetric matrix."""


@cache
def gsplat_is_ready() -> bool:
    """Whether torch with a CUDA device and gsplat are installed; costs next to nothing where they are not."""
    if importlib.util.find_spec("torch") is None or importlib.util.find_spec("gsplat") is None:
        return False
    if not cuda_driver_is_installed():
        return False
    import torch  # pyright: ignore[reportMissingImports]

    return torch.cuda.is_available()


def cuda_driver_is_installed() -> bool:
    """Whether the system has NVIDIA's driver: importing torch to learn that there is none takes seconds."""
    try:
        ctypes.CDLL("nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1")
    except OSError:
        return False
    return True


class GsplatRasteriser:
    """Renders pictures one after another on a torch device.

    Args:
        device: "cuda", or "cuda:1" and so on.
    """

    def __init__(self, device: str = "cuda") -> None:
        self.device = device

    def render(
        self,
        means: ArrayLike,
        covariances: ArrayLike,
        opacities: ArrayLike,
        *,
        camera: Camera,
        sh: ArrayLike | None = None,
        colors: ArrayLike | None = None,
        background: ArrayLike = WHITE,
        antialiased: bool = False,
        sh_rotations: ArrayLike | None = None,
        near: float | None = None,
    ) -> RenderResult:
        """Render one picture; the arguments are those of ``rasterise``, the depth is the expected one.

        Raises:
            ValueError: neither or both of ``sh`` and ``colors`` are given.
        """
        import gsplat  # pyright: ignore[reportMissingImports]
        import torch  # pyright: ignore[reportMissingImports]

        if (sh is None) == (colors is None):
            raise ValueError(f"sh, colors: expected exactly one of the two, got {'none' if sh is None else 'both'}.")
        places = np.asarray(means, np.float32)
        near = default_near(places, camera) if near is None else float(near)
        centres = self._tensor(places)
        shading = self._tensor(colors) if sh is None else self._evaluated(centres, camera, sh, sh_rotations)
        n = len(places)
        with torch.no_grad():
            picture, alpha, _ = gsplat.rasterization(
                means=centres,
                quats=torch.zeros((n, 4), device=self.device),  # unused: the covariances are given
                scales=torch.zeros((n, 3), device=self.device),
                opacities=self._tensor(opacities),
                colors=shading[None],
                viewmats=self._tensor(camera.viewmat)[None],
                Ks=self._tensor(camera.K)[None],
                width=camera.width,
                height=camera.height,
                near_plane=near,
                covars=self._tensor(packed_covariances(covariances)[:, _UPPER].reshape(n, 3, 3)),
                render_mode="RGB+ED",
                rasterize_mode="antialiased" if antialiased else "classic",
                packed=False,
            )
        channels, coverage = picture[0].cpu().numpy(), alpha[0, ..., 0].cpu().numpy()
        rgb = channels[..., :3] + (1 - coverage[..., None]) * np.asarray(background, np.float32)
        return RenderResult(rgb=rgb, alpha=coverage, depth=np.where(coverage > 0, channels[..., 3], np.float32(0)))

    def _evaluated(
        self, centres: torch.Tensor, camera: Camera, sh: ArrayLike, sh_rotations: ArrayLike | None
    ) -> torch.Tensor:
        """Colours seen from the camera, [N, 3]: gsplat itself cannot turn the direction of each Gaussian."""
        import gsplat  # pyright: ignore[reportMissingImports]
        import torch  # pyright: ignore[reportMissingImports]

        coefficients = self._tensor(sh)
        rotation, shift = camera.viewmat[:3, :3], camera.viewmat[:3, 3]
        directions = centres - self._tensor(-rotation.T @ shift)
        if sh_rotations is not None:
            directions = torch.einsum("nab,na->nb", self._tensor(sh_rotations), directions)
        degree = round(coefficients.shape[1] ** 0.5) - 1
        return (gsplat.spherical_harmonics(degree, directions, coefficients) + 0.5).clamp_min(0)

    def _tensor(self, array: Any) -> torch.Tensor:
        import torch  # pyright: ignore[reportMissingImports]

        return torch.from_numpy(np.ascontiguousarray(array, np.float32).copy()).to(self.device)
