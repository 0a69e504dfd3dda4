"""What the stage ``reconstruct`` leaves in a run folder, and how it is read back."""

from __future__ import annotations

import json

import numpy as np

from phys4dgen.export.pictures import write_png
from phys4dgen.formats import load_gaussians, save_gaussians
from phys4dgen.input_kinds import is_picture
from phys4dgen.reconstruct.inflate.perspective import InflatedSolid
from phys4dgen.reconstruct.mesh.files import is_mesh
from phys4dgen.reconstruct.picture import read_picture
from phys4dgen.run.folder import RunFolder
from phys4dgen.scene import Scene
from phys4dgen.stages.reconstruct import Source, source_of_splat
from phys4dgen.types import Camera

__all__ = ["read_source", "write_source"]


def write_source(run: RunFolder, source: Source) -> None:
    """Write ``gaussians.ply`` and ``reconstruct/``: the maker and, where it knows them, cut-out, camera and inside.

    Of several objects it is their Gaussians in the scene's coordinates, and the grid cell that they share.
    """
    whole = source.gaussians if source.surroundings is None else source.surroundings.whole
    save_gaussians(whole, run.gaussians_ply)
    if source.cell_m is not None:
        run.write_json(run.source_json, {"backend": source.backend, "up": [0, 0, 1], "cell_m": source.cell_m})
        return
    if source.picture is None or source.camera is None:
        run.write_json(run.source_json, {"backend": source.backend, "up": source.up})
        return
    write_png(np.rint(source.picture * 255).astype(np.uint8), run.cutout_png)
    camera = source.camera
    facts = {
        "convention": "OpenCV (x right, y down, z forward); viewmat maps input coordinates to the camera",
        "backend": source.backend,
        "up": source.up,
        "width": camera.width,
        "height": camera.height,
        "K": camera.K,
        "viewmat": camera.viewmat,
    }
    run.write_json(run.source_json, facts)
    if source.solid is not None:
        run.write_npz(run.solid_npz, source.solid.arrays())
    if source.even_colors is not None:
        run.write_npz(run.even_light_npz, {"colors": source.even_colors})


def read_source(run: RunFolder, scene: Scene) -> Source:
    """Read it back; a single splat that was given is read from where it lies."""
    if scene.input is not None and not is_picture(scene.input) and not is_mesh(scene.input):
        return source_of_splat(scene)
    facts = json.loads(run.source_json.read_text("utf-8"))
    if scene.input is None:
        return Source(load_gaussians(run.gaussians_ply), facts["backend"], cell_m=facts["cell_m"])
    up = None if facts["up"] is None else np.array(facts["up"])
    if "viewmat" not in facts:
        return Source(load_gaussians(run.gaussians_ply), facts["backend"], up=up)
    camera = Camera(
        viewmat=np.array(facts["viewmat"]), K=np.array(facts["K"]), width=facts["width"], height=facts["height"]
    )
    cutout = read_picture(run.cutout_png)
    solid = None
    if run.solid_npz.is_file():
        with np.load(run.solid_npz, allow_pickle=False) as arrays:
            solid = InflatedSolid.from_arrays(dict(arrays))
    even_colors = None
    if run.even_light_npz.is_file():
        with np.load(run.even_light_npz, allow_pickle=False) as arrays:
            even_colors = arrays["colors"]
    return Source(
        load_gaussians(run.gaussians_ply),
        facts["backend"],
        up=up,
        picture=None if cutout.alpha is None else np.concatenate([cutout.rgb, cutout.alpha[..., None]], -1),
        camera=camera,
        solid=solid,
        even_colors=even_colors,
    )
