"""Mesh files -> surfaces, through trimesh."""

from __future__ import annotations

import importlib.util
import io
import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from phys4dgen.errors import FormatError, StageError
from phys4dgen.formats.ply_header import read_ply_header
from phys4dgen.reconstruct.mesh.bounds import MAX_TRIANGLES, FilesBeside, check_bounds, glb_header, refuse
from phys4dgen.reconstruct.mesh.colors import srgb_to_linear
from phys4dgen.reconstruct.mesh.surface import Surface

__all__ = ["MESH_SUFFIXES", "is_mesh", "read_surfaces", "trimesh_is_installed"]

MESH_SUFFIXES = (".glb", ".obj", ".stl")
"""And .ply, where it holds faces."""
MAX_TEXTURE_PIXELS = 200_000_000
_LARGEST = 1e18
_GREY = 0.55
"""Linear brightness of a mesh without colours."""


@cache
def trimesh_is_installed() -> bool:
    """Whether trimesh can be imported; does not import it."""
    return importlib.util.find_spec("trimesh") is not None


def is_mesh(path: Path | str) -> bool:
    """Whether a file is a mesh by its suffix; a .ply by its header: faces, and no Gaussians."""
    path = Path(path)
    if path.suffix.lower() != ".ply" or not path.is_file():
        return path.suffix.lower() in MESH_SUFFIXES
    try:
        with path.open("rb") as stream:
            elements = {element.name: element for element in read_ply_header(stream, path).elements}
    except (FormatError, OSError):
        return False  # the reader of splats says what is wrong with it
    has_faces = "face" in elements and elements["face"].count > 0
    columns = {column.name for column in elements["vertex"].properties} if "vertex" in elements else set()
    return has_faces and "f_dc_0" not in columns


def read_surfaces(path: Path) -> list[Surface]:
    """The triangles of a mesh file, one surface per material, in the file's units and axes.

    Raises:
        FormatError: missing, damaged, too large, or without triangles.
        StageError: trimesh is absent.
    """
    if not trimesh_is_installed():
        raise StageError(f"{path}: reading a mesh needs trimesh; pip install 'phys4dgen[mesh]'.")
    check_bounds(path)
    linear_colors = path.suffix.lower() == ".glb" and not _by_trimesh(glb_header(path))
    surfaces, count, pixels = [], 0, 0
    for geometry, matrix in _placed(path):
        count += len(geometry.faces)
        if count > MAX_TRIANGLES:
            raise refuse(path, f"it has more than {MAX_TRIANGLES:,} triangles")
        image = _image(geometry.visual)
        pixels += 0 if image is None else image.width * image.height
        if pixels > MAX_TEXTURE_PIXELS:
            raise refuse(path, f"its textures have more than {MAX_TEXTURE_PIXELS:,} pixels")
        surfaces.append(_surface(path, geometry, matrix, image, linear_colors=linear_colors))
    if count == 0:
        raise refuse(path, "it holds no triangles")
    return surfaces


def _placed(path: Path) -> list[tuple[Any, NDArray[np.float64]]]:
    """Every mesh of the file with the 4x4 matrix of each place where it stands, as trimesh reads them."""
    import trimesh  # pyright: ignore[reportMissingImports]

    stream = io.BytesIO(path.read_bytes())
    try:
        with warnings.catch_warnings(), _quiet_log("trimesh"):
            warnings.simplefilter("ignore")
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            scene = trimesh.load_scene(
                stream, file_type=path.suffix.lower()[1:], resolver=FilesBeside(path.parent), process=False
            )
            placed = [
                (scene.geometry[name], matrix) for matrix, name in map(scene.graph.get, scene.graph.nodes_geometry)
            ]
    except Exception as error:
        raise refuse(path, " ".join(str(error).split())[:120] or type(error).__name__) from error
    return [
        (geometry, np.asarray(matrix, np.float64))
        for geometry, matrix in placed
        if isinstance(geometry, trimesh.Trimesh) and len(geometry.faces)
    ]


@contextmanager
def _quiet_log(name: str) -> Iterator[None]:
    """A library that logs what it survives: without a handler Python would write it to the terminal."""
    logger, silent = logging.getLogger(name), logging.NullHandler()
    before, logger.propagate = logger.propagate, False
    logger.addHandler(silent)
    try:
        yield
    finally:
        logger.removeHandler(silent)
        logger.propagate = before


def _by_trimesh(header: dict[str, Any]) -> bool:
    """Trimesh writes colours of vertices as sRGB where glTF wants them linear; many generators export through it."""
    return "trimesh" in str(header.get("asset", ""))


def _image(visual: Any) -> Image.Image | None:
    """The colour texture of a mesh."""
    if getattr(visual, "kind", None) != "texture" or visual.uv is None or visual.material is None:
        return None
    material = visual.material
    return getattr(material, "baseColorTexture", None) or getattr(material, "image", None)


def _surface(
    path: Path, geometry: Any, matrix: NDArray[np.float64], image: Image.Image | None, *, linear_colors: bool
) -> Surface:
    """One mesh of the scene, in its place."""
    faces = np.asarray(geometry.faces, np.int64)
    vertices = np.asarray(geometry.vertices, np.float64)
    if vertices.shape[1:] != (3,) or faces.shape[1:] != (3,) or matrix.shape != (4, 4):
        raise refuse(path, "its vertices are not points in space")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise refuse(path, "a triangle names a vertex that is not there")
    with np.errstate(invalid="ignore", over="ignore"):
        vertices = vertices @ matrix[:3, :3].T + matrix[:3, 3]
        if not (np.abs(vertices) < _LARGEST).all():
            raise refuse(path, "a vertex has no usable place")
    corner_rgba = _corner_colors(geometry, faces, image, linear=linear_colors)
    uv, texture, cutoff = None, None, None
    if image is not None:
        uv = np.asarray(geometry.visual.uv, np.float64)
        if uv.shape != (len(vertices), 2) or not (np.abs(uv) < _LARGEST).all():
            raise refuse(path, "its texture coordinates are not two numbers for each vertex")
        uv = uv[faces]
        try:
            texture = np.asarray(image.convert("RGBA"), np.float32) / np.float32(255)
        except (OSError, ValueError, SyntaxError) as error:
            raise refuse(path, f"its texture is damaged ({error})") from error
        texture, cutoff = _with_opacity(texture, geometry.visual.material)
    return Surface(vertices[faces], corner_rgba, uv, texture, cutoff)


def _corner_colors(
    geometry: Any, faces: NDArray[np.int64], image: Image.Image | None, *, linear: bool
) -> NDArray[np.float32]:
    """Linear RGBA of the corners, [F, 3, 4]: white under a texture, grey where the file names no colour."""
    visual = geometry.visual
    white = np.ones((len(faces), 3, 4), np.float32)
    rgba = white
    if visual.kind == "vertex":
        rgba = _unit(visual.vertex_colors)[faces]
    elif visual.kind == "face":
        rgba = np.repeat(_unit(visual.face_colors)[:, None], 3, 1)
    elif visual.kind == "texture":
        factor = getattr(visual.material, "baseColorFactor", None)
        if factor is None and image is None:
            factor = getattr(visual.material, "diffuse", None)  # of .mtl, where a texture stands instead of it
        rgba = white if factor is None else np.broadcast_to(_unit(factor), white.shape)
        per_vertex = visual.vertex_attributes.get("color")
        if per_vertex is not None and len(per_vertex) == len(geometry.vertices):
            rgba = rgba * _unit(per_vertex)[faces]
    elif image is None:
        return white * np.array([_GREY, _GREY, _GREY, 1], np.float32)
    if not linear:
        rgba = np.concatenate([srgb_to_linear(rgba[..., :3]), rgba[..., 3:]], -1)
    return rgba.astype(np.float32)


def _unit(colors: Any) -> NDArray[np.float32]:
    """Colours as floats in [0, 1] with opacity, shape [.., 4]; whole numbers go up to the largest of their type."""
    array = np.asarray(colors)
    scale = np.iinfo(array.dtype).max if array.dtype.kind in "iu" else 1
    unit = np.clip(array.astype(np.float32) / np.float32(scale), 0, 1)
    return unit if unit.shape[-1] == 4 else np.concatenate([unit, np.ones((*unit.shape[:-1], 1), np.float32)], -1)


def _with_opacity(texture: NDArray[np.float32], material: Any) -> tuple[NDArray[np.float32], float | None]:
    """The texture with the opacity that its material means, and the cut-off of a mask."""
    mode = getattr(material, "alphaMode", None) if hasattr(material, "baseColorTexture") else "BLEND"
    if mode == "MASK":
        cutoff = getattr(material, "alphaCutoff", None)
        return texture, 0.5 if cutoff is None else float(cutoff)
    if mode != "BLEND":
        texture[..., 3] = 1
    return texture, None
