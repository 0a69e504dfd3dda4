"""Painted surface samples and their way into lit Gaussians."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from phys4dgen.types import SH_C0, Gaussians
from phys4dgen.zoo import shading
from phys4dgen.zoo.lights import Light
from phys4dgen.zoo.patch import Array, Patch, joined

__all__ = ["Dressed", "lit_gaussians"]

OPACITY = 0.97


@dataclass(frozen=True, eq=False)
class Dressed:
    """Samples of one part with their colour and how they take light.

    Attributes:
        part: number of the part.
        patch: N samples.
        albedo: sRGB colour in [0, 1], shape [N, 3].
        transmission: share of the light on the far side that shines through.
        gloss: change of sRGB colour towards the mirror image of the key light.
    """

    part: int
    patch: Patch
    albedo: Array
    transmission: float = 0.0
    gloss: float = 0.0


def lit_gaussians(
    dressed: Sequence[Dressed], *, metres_per_unit: float, pixel_m: float, light: Light | None
) -> Gaussians:
    """Light the samples and turn them into Gaussians with spherical harmonics of degree 1, in input units.

    Args:
        dressed: samples in metres, y up, the ground at y = 0.
        metres_per_unit: length of an input unit.
        pixel_m: resolution of the shadows, see ``shading.bake_irradiance``.
        light: None leaves the plain albedo.
    """
    counts = [len(d.patch) for d in dressed]
    patch = joined([d.patch for d in dressed])
    sh = np.zeros((len(patch), 4, 3))
    color = np.clip(np.concatenate([d.albedo for d in dressed]), 0, 1)
    if light is not None:
        irradiance = shading.bake_irradiance(
            patch.points,
            patch.normals,
            transmission=np.repeat([d.transmission for d in dressed], counts),
            light=light,
            pixel_m=pixel_m,
        )
        color = shading.linear_to_srgb(shading.srgb_to_linear(color) * irradiance)
        gloss = np.repeat([d.gloss for d in dressed], counts)
        sh[:, 1:] = shading.gloss_sh1(patch.normals, gloss, light.key_direction)[:, :, None]
    sh[:, 0] = (color - 0.5) / SH_C0
    axes = np.stack([patch.tangents, np.cross(patch.normals, patch.tangents), patch.normals], -1)
    return Gaussians(
        means=(patch.points / metres_per_unit).astype(np.float32),
        quats_wxyz=Rotation.from_matrix(axes).as_quat(canonical=True)[:, [3, 0, 1, 2]].astype(np.float32),
        scales=(patch.sigmas / metres_per_unit).astype(np.float32),
        opacities=np.full(len(patch), OPACITY, np.float32),
        sh=sh.astype(np.float32),
    )
