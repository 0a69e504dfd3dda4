"""The readers that ``fuzz`` tries, each with small files that it takes."""

from __future__ import annotations

import io
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from phys4dgen.export.trajectory import read_trajectory
from phys4dgen.formats import load_gaussians
from phys4dgen.grouping.from_file import parts_from_file
from phys4dgen.grouping.label_maps import read_cameras, read_label_maps, read_label_png
from phys4dgen.materials.materials_yaml import read_materials
from phys4dgen.materials.mllm.reading import read_answer
from phys4dgen.physgaussian.configuration import read_configuration
from phys4dgen.reconstruct.lgm.safetensors_file import stored_tensors
from phys4dgen.reconstruct.mesh.files import read_surfaces, trimesh_is_installed
from phys4dgen.reconstruct.picture import read_picture
from phys4dgen.scene import Scene, dump_scene, load_scene
from phys4dgen.types import Camera, Gaussians
from ply_bytes import inria_columns, ply_bytes  # pyright: ignore[reportMissingImports]
from test_formats_compressed import compressed  # pyright: ignore[reportMissingImports]

__all__ = ["Target", "targets"]


class Target(NamedTuple):
    """A reader and files that it takes."""

    suffix: str
    seeds: Sequence[bytes]
    read: Callable[[Path], Any]


def targets() -> dict[str, Target]:
    """Every reader of files of unknown origin."""
    labels = np.arange(12, dtype=np.int32) % 3
    names = np.array(["a", "b", "c"])
    camera = Camera(viewmat=np.eye(4), K=np.diag([8.0, 8.0, 1.0]), width=8, height=6)
    maps = np.tile(np.arange(8, dtype=np.int32) % 3 - 1, (2, 6, 1))
    plain = [ply_bytes(inria_columns(5, degree=1)), ply_bytes(inria_columns(3), encoding="ascii")]
    packed = [compressed(gaussians(300)), compressed(gaussians(5, degree=1), degree=1)]
    motion = {"times_s": np.zeros(2), "positions": np.zeros((2, 5, 3), np.float32)}
    motion["deformation_gradients"] = np.zeros((2, 5, 3, 3), np.float32)
    answers = [json.dumps(ANSWER).encode(), ANSWER_IN_PROSE]
    return {
        "ply": Target(".ply", plain, load_gaussians),
        "compressed": Target(".ply", packed, load_gaussians),
        "splat": Target(".splat", [splat_bytes()], load_gaussians),
        "labels": Target(
            ".npz",
            [archive(labels=labels, names=names), archive(np.savez_compressed, labels=labels.astype(np.uint8))],
            lambda path: parts_from_file(path, 12),
        ),
        "labels_npy": Target(".npy", [npy(labels)], lambda path: parts_from_file(path, 12)),
        "maps": Target(
            ".npz",
            [archive(masks=maps), archive(np.savez_compressed, masks=maps)],
            lambda path: read_label_maps(path, cameras=[camera] * 2),
        ),
        "trajectory": Target(
            ".npz",
            [archive(**motion)],
            read_trajectory,
        ),
        "scene": Target(".yaml", [dump_scene(Scene(input=Path("a.splat"))).encode(), SCENE], load_scene),
        "materials": Target(".yaml", [MATERIALS], read_materials),
        "answer": Target(".txt", answers, lambda path: read_answer(path.read_text("utf-8", "replace"), "AB")),
        "png": Target(".png", [image("PNG", "RGBA"), image("PNG", "P"), image("PNG", "I;16")], read_picture),
        "jpeg": Target(".jpg", [image("JPEG", "RGB"), image("JPEG", "CMYK")], read_picture),
        "webp": Target(".webp", [image("WEBP", "RGBA")], read_picture),
        "label_png": Target(
            ".png", [image("PNG", "L"), image("PNG", "P")], lambda path: read_label_png(path, max_side_px=4096)
        ),
        "cameras": Target(".json", [json.dumps({"cameras": [CAMERA]}).encode()], read_cameras),
        "physgaussian": Target(
            ".json", [json.dumps(PHYSGAUSSIAN).encode()], lambda path: read_configuration(path, mode="corrected")
        ),
        "safetensors": Target(
            ".safetensors", [safetensors()], lambda path: stored_tensors(path, TENSORS, network="a network")
        ),
        **(meshes() if trimesh_is_installed() else {}),
    }


def gaussians(count: int, *, degree: int = 0) -> Gaussians:
    """Some Gaussians."""
    rng = np.random.default_rng(0)
    quats = rng.normal(size=(count, 4))
    return Gaussians(
        means=rng.normal(size=(count, 3)).astype(np.float32),
        quats_wxyz=(quats / np.linalg.norm(quats, axis=1, keepdims=True)).astype(np.float32),
        scales=np.exp(rng.normal(-4, 1, (count, 3))).astype(np.float32),
        opacities=rng.uniform(0.1, 0.9, count).astype(np.float32),
        sh=rng.normal(0, 0.5, (count, (degree + 1) ** 2, 3)).astype(np.float32),
    )


def splat_bytes() -> bytes:
    """A .splat of five Gaussians."""
    rng = np.random.default_rng(1)
    row = np.zeros(5, [("f", "<f4", 6), ("u", "u1", 8)])
    row["f"], row["u"] = rng.uniform(0.1, 1, (5, 6)), rng.integers(1, 255, (5, 8))
    return row.tobytes()


def npy(array: np.ndarray[Any, Any]) -> bytes:
    """A .npy file."""
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def archive(save: Callable[..., None] = np.savez, **arrays: np.ndarray[Any, Any]) -> bytes:
    """A .npz file."""
    stream = io.BytesIO()
    save(stream, **arrays)
    return stream.getvalue()


def image(kind: str, mode: str) -> bytes:
    """A small picture."""
    stream = io.BytesIO()
    ramp = Image.linear_gradient("L").resize((24, 16))
    ramp.convert("I;16" if mode == "I;16" else mode).save(stream, kind)
    return stream.getvalue()


def safetensors() -> bytes:
    """Two tensors."""
    header: dict[str, Any] = {}
    at = 0
    for name, shape in TENSORS.items():
        size = 2 * int(np.prod(shape))
        header[name] = {"dtype": "F16", "shape": list(shape), "data_offsets": [at, at + size]}
        at += size
    text = json.dumps(header).encode()
    return len(text).to_bytes(8, "little") + text + bytes(at)


def meshes() -> dict[str, Target]:
    """A box in every format of meshes, with colours where it has them."""
    import trimesh  # pyright: ignore[reportMissingImports]
    from trimesh.visual import ColorVisuals, TextureVisuals  # pyright: ignore[reportMissingImports]

    box, textured = trimesh.creation.box(), trimesh.creation.box()
    box.visual = ColorVisuals(box, vertex_colors=np.arange(32, dtype=np.uint8).reshape(8, 4))
    picture = Image.linear_gradient("L").resize((4, 4)).convert("RGB")
    textured.visual = TextureVisuals(uv=textured.vertices[:, :2] + 0.5, image=picture)
    seeds = {
        "glb": [exported(mesh, "glb") for mesh in (box, textured)],
        "obj": [exported(box, "obj"), OBJ],
        "stl": [exported(box, kind) for kind in ("stl", "stl_ascii")],
    }
    return {name: Target(f".{name}", files, read_surfaces) for name, files in seeds.items()}


def exported(mesh: Any, kind: str) -> bytes:
    """A mesh as trimesh writes it."""
    content = mesh.export(file_type=kind)
    return content.encode() if isinstance(content, str) else content


TENSORS = {"encoder.conv_in.weight": (4, 3), "encoder.conv_in.bias": (4,)}
CAMERA = {
    "name": "view_00",
    "width": 8,
    "height": 6,
    "K": [[8.0, 0.0, 4.0], [0.0, 8.0, 3.0], [0.0, 0.0, 1.0]],
    "viewmat": np.eye(4).tolist(),
}
PHYSGAUSSIAN: dict[str, Any] = {
    "material": "jelly",
    "E": 1e5,
    "nu": 0.4,
    "density": 200,
    "g": [0, 0, -9.8],
    "n_grid": 50,
    "sim_area": [-1, 1, -1, 1, -1, 1],
    "rotation_degree": [10.0],
    "rotation_axis": [0],
    "particle_filling": {"n_grid": 64, "density_threshold": 5.0, "boundary": None},
    "boundary_conditions": [
        {"type": "cuboid", "point": [1, 1, 0.5], "size": [0.1, 0.1, 0.1], "velocity": [0, 0, 0], "end_time": 1e3},
        {"type": "enforce_particle_translation", "point": [1, 1, 1], "size": [0.2, 0.2, 0.2], "velocity": [0, 0, 1]},
    ],
}
OBJ = b"""# a square and a triangle
v 0 0 0 1.0 0.5 0.2
v 1 0 0
v 1 1 0
v 0 1 -1e-1
vt 0 0
vn 0 0 1
g top
f 1/1/1 2/1/1 3/1/1 4/1/1
f -1//1 -2//1 -3//1
"""
SCENE = b"""input: a.splat
up: [0, 1, 0]
parts:
  pot: {hold: fixed, thickness_m: 1e-3}
forces:
  - {kind: acceleration, part: leaves, value_ms2: [3, 0, 0], from_s: 0.0, to_s: 0.3}
simulation: {grid: 64, duration_s: 2.0}
grouping: {names: {0: pot}, edits: [{merge: [a, b]}]}
"""
MATERIALS = b"""parts:
  pot:
    surface: {name: ceramic, law: neo_hookean, density_kgm3: 2000, youngs_modulus_pa: 1e9, poisson_ratio: 0.2}
    interior: {name: soil, density_kgm3: 1.2e+3, youngs_modulus_pa: 1.0e6, poisson_ratio: 0.3, source: user}
  leaves:
    surface: {name: leaf, thickness_m: 0.0008}
"""
ANSWER = {
    "object": "a plant",
    "height_m": {"min": 0.2, "max": 0.5, "best": 0.3},
    "parts": [
        {
            "letter": letter,
            "name": "pot",
            "surface": {"material": "ceramic", "density_kgm3": 2000, "youngs_modulus_pa": 1e9, "poisson_ratio": 0.2},
            "interior": {
                "material": "soil",
                "density_kgm3": "1.2 g/cm3",
                "youngs_modulus_pa": 1e6,
                "poisson_ratio": 0.3,
            },
        }
        for letter in "AB"
    ],
}
ANSWER_IN_PROSE = b"Here it is:\n```json\n" + json.dumps(ANSWER, indent=1).encode() + b"\n```\nBest wishes"
