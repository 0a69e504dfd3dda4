"""Surfaces -> flat Gaussians that lie in them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from phys4dgen.errors import FormatError
from phys4dgen.reconstruct.mesh.colors import colors_at
from phys4dgen.reconstruct.mesh.files import read_surfaces
from phys4dgen.reconstruct.mesh.sampling import even_samples
from phys4dgen.reconstruct.mesh.surface import Surface
from phys4dgen.types import SH_C0, Gaussians

__all__ = ["gaussians_from_mesh", "gaussians_on_surfaces"]

WIDTH = 0.7
"""Standard deviation in the surface, of the root of the area per Gaussian: neighbours overlap to an opaque wall."""
FLATNESS = 0.18
"""Standard deviation across the surface, of the one in it."""
OPACITY = 0.98
LEAST_OPACITY = 0.02


def gaussians_from_mesh(path: Path, *, count: int) -> Gaussians:
    """Gaussians in the surface of a mesh file, in its units and axes.

    Args:
        path: .glb, .obj, .ply or .stl.
        count: about so many; transparent places get none.

    Raises:
        FormatError: the file is no usable mesh.
        StageError: trimesh is absent.
    """
    surfaces = read_surfaces(path)
    try:
        return gaussians_on_surfaces(surfaces, count=count)
    except ValueError as error:
        raise FormatError(f"{path}: cannot make Gaussians of the mesh: {error}") from error


def gaussians_on_surfaces(surfaces: list[Surface], *, count: int) -> Gaussians:
    """Gaussians in surfaces.

    Args:
        surfaces: of one object.
        count: about so many.

    Raises:
        ValueError: the surfaces have no area, or all of them is transparent.
    """
    triangles = np.concatenate([surface.triangles for surface in surfaces])
    samples = even_samples(triangles, count)
    normals = samples.normals * _outward(triangles)
    first_face = np.cumsum([0, *(len(surface.triangles) for surface in surfaces)])
    owner = np.searchsorted(first_face, samples.faces, side="right") - 1
    rgb = np.zeros((len(owner), 3), np.float32)
    alpha = np.zeros(len(owner), np.float32)
    for index, surface in enumerate(surfaces):
        mine = owner == index
        rgb[mine], alpha[mine] = colors_at(
            surface,
            samples.faces[mine] - first_face[index],
            samples.weights[mine],
            normals=normals[mine],
            spacing=samples.spacing,
        )
    seen = alpha > LEAST_OPACITY
    if not seen.any():
        raise ValueError("all of its surface is transparent.")
    width = WIDTH * samples.spacing
    n = int(seen.sum())
    return Gaussians(
        means=samples.points[seen].astype(np.float32),
        quats_wxyz=_facing(normals[seen]),
        scales=np.tile(np.array([width, width, FLATNESS * width], np.float32), (n, 1)),
        opacities=OPACITY * alpha[seen],
        sh=((rgb[seen] - 0.5) / SH_C0)[:, None],
    )


def _outward(triangles: NDArray[np.float64]) -> float:
    """-1 where the corners of a closed surface run the wrong way round, so that its volume is negative."""
    local = triangles - triangles.mean((0, 1))
    return -1.0 if float((local[:, 0] * np.cross(local[:, 1], local[:, 2])).sum()) < 0 else 1.0


def _facing(normals: NDArray[np.float64]) -> NDArray[np.float32]:
    """Unit quaternions [N, 4] that turn z to the normals [N, 3]."""
    helper = np.where(np.abs(normals[:, 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    first = np.cross(helper, normals)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    axes = np.stack([first, np.cross(normals, first), normals], -1)
    return Rotation.from_matrix(axes).as_quat(scalar_first=True).astype(np.float32)
