"""Names that the user has given on a picture, for the stage that finds parts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phys4dgen.clip import ClipEncoder
from phys4dgen.errors import StageError
from phys4dgen.grouping.correspondence import NamedSegments, name_parts_by_picture, read_segments
from phys4dgen.progress import Progress
from phys4dgen.reconstruct.picture import read_picture
from phys4dgen.render.views import render_label_maps
from phys4dgen.scene import Scene
from phys4dgen.stages.asset import Asset
from phys4dgen.types import Parts, Views
from phys4dgen.weights import chosen_device, weights_folder

__all__ = ["clip_encoder", "names_from_picture"]


def names_from_picture(scene: Scene, asset: Asset, views: Views, parts: Parts, progress: Progress) -> dict[int, str]:
    """Names by part number, from the scene's picture; every match is told with its margin."""
    wanted = scene.grouping.named_picture
    assert wanted is not None
    picture = read_picture(wanted.picture)
    segments = read_segments(wanted.segments, *picture.size)
    named = NamedSegments(_eight_bit(picture.rgb), segments, wanted.names)
    encoder = None if wanted.compare == "descriptor" else _encoder(scene, progress)
    maps = render_label_maps(asset.gaussians, parts.labels, views.cameras)
    found, view = name_parts_by_picture(named, [_eight_bit(rgb) for rgb in views.rgb], list(maps), encoder=encoder)
    how = "colour and shape (stand-in for CLIP)" if encoder is None else f"CLIP ({encoder.name})"
    names: dict[int, str] = {}
    for naming in found:
        if naming.part is None:
            progress.warn(
                f"No part resembles '{naming.name}' of the picture enough (best {naming.similarity:.2f}); name it with "
                "--part-name NUMBER=NAME."
            )
            continue
        names[naming.part] = naming.name
        progress.note(
            f"Part {naming.part} is '{naming.name}' of the picture by {how} in view_{view:02d}: similarity "
            f"{naming.similarity:.2f}, {naming.margin:.2f} ahead of the next."
        )
    return names


def clip_encoder(scene: Scene) -> ClipEncoder:
    """The CLIP that a scene names.

    Raises:
        StageError: it is not ready; says what to do.
    """
    folder = weights_folder(scene.clip.weights, model="CLIP")
    return ClipEncoder(folder, name=scene.clip.weights, device=chosen_device(scene.clip.device))


def _encoder(scene: Scene, progress: Progress) -> ClipEncoder | None:
    """CLIP, or None where it was not asked for by name and is not ready."""
    wanted = scene.grouping.named_picture
    try:
        return clip_encoder(scene)
    except StageError as error:
        if wanted is not None and wanted.compare == "clip":
            raise
        progress.note(f"The picture is compared by colour and shape, because {error}")
        return None


def _eight_bit(rgb: NDArray[np.float32]) -> NDArray[np.uint8]:
    return np.rint(np.clip(rgb, 0, 1) * 255).astype(np.uint8)
