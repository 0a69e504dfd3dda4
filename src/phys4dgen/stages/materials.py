"""What every part is made of, at its surface and inside (Paper: Sec. 3.4)."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from phys4dgen.errors import Phys4DGenError
from phys4dgen.interior import Interior
from phys4dgen.materials import assemble_book, identify_by_rules, material, read_materials
from phys4dgen.progress import Progress
from phys4dgen.scene import Scene, options_by_part
from phys4dgen.stages.asset import Asset
from phys4dgen.stages.reconstruct import Source
from phys4dgen.types import MaterialBook, PartMaterials, Parts

if TYPE_CHECKING:
    from phys4dgen.materials.mllm import Asking, Endpoint, Identification, SubImages

__all__ = ["as_told", "asking", "identify", "model_endpoint", "pictures_for_model"]

_TOKENS_PER_SAMPLE = 40_000
_REQUESTS_PER_SAMPLE = 4
_ANSWERS = "answers"


def identify(
    scene: Scene, source: Source, asset: Asset, parts: Parts, interior: Interior, run: Path, progress: Progress
) -> MaterialBook:
    """Name the materials of every part (Paper: Sec. 3.4); rules stand in for the multimodal model.

    Args:
        scene: who names them, and what the user says about single parts.
        source: the picture that the object was made from, if any.
        asset: the object.
        parts: its parts.
        interior: its particles, which know what is thin.
        run: folder that holds what earlier stages made; answers of a model are kept in its folder ``answers``.
        progress: told what is sent and found.
    """
    wanted = scene.materials
    if wanted.backend == "library":
        identified = MaterialBook({name: PartMaterials(material(name), material(name)) for name in parts.names})
    else:
        identified = identify_by_rules(asset.evenly_lit, parts, asset.frame, interior.continuum)
    if wanted.backend == "mllm" or (wanted.backend == "auto" and wanted.file is None and wanted.allow_upload):
        identified = _by_model(scene, source, asset, parts, identified, run / _ANSWERS, progress)
    elif wanted.backend == "clip":
        identified = _by_clip(scene, source, asset, parts, identified, run / _ANSWERS, progress)
    elif wanted.backend == "command":
        identified = _by_command(scene, parts, identified, run, progress)
    book = as_told(scene, parts, identified)
    for name, entry in book.parts.items():
        for warning in dict.fromkeys((*entry.surface.warnings, *entry.interior.warnings)):
            progress.warn(f"Material of part '{name}': {warning}.")
    return book


def as_told(scene: Scene, parts: Parts, identified: MaterialBook) -> MaterialBook:
    """The materials with what the scene and its materials file say of single parts in place of what was identified."""
    wanted = scene.materials
    from_file = None if wanted.file is None else read_materials(wanted.file, parts.names)
    options = options_by_part(scene, parts.names)
    return assemble_book(
        parts.names,
        identified,
        from_file=from_file,
        surface={name: o.material for name, o in options.items() if o.material is not None},
        interior={name: o.interior_material for name, o in options.items() if o.interior_material is not None},
        thickness_m={name: o.thickness_m for name, o in options.items() if o.thickness_m is not None},
    )


def _by_model(
    scene: Scene,
    source: Source,
    asset: Asset,
    parts: Parts,
    rules: MaterialBook,
    answers: Path,
    progress: Progress,
) -> MaterialBook:
    """The materials that a model names; where it was not asked for by name and fails, those of the rules."""
    from phys4dgen.materials.mllm import identify_by_model

    try:
        found = identify_by_model(
            model_endpoint(scene),
            pictures_for_model(source, asset, parts, answers),
            parts.names,
            rules,
            asking=asking(scene),
            folder=answers,
            progress=progress,
        )
    except Phys4DGenError as error:
        if scene.materials.backend == "mllm":
            raise
        progress.warn(f"The rule table names the materials, because {error}")
        return rules
    _judge_size(found, scene, asset, progress)
    return found.book


def _by_clip(
    scene: Scene,
    source: Source,
    asset: Asset,
    parts: Parts,
    rules: MaterialBook,
    pictures: Path,
    progress: Progress,
) -> MaterialBook:
    """The materials that CLIP sees in the pictures that a language model would be shown."""
    from phys4dgen.materials.clip_names import identify_by_clip
    from phys4dgen.stages.naming import clip_encoder

    encoder = clip_encoder(scene)
    shown = pictures_for_model(source, asset, parts, pictures)
    alone = {number: _decoded(shown.crops[letter]) for number, letter in shown.letters.items()}
    progress.update(0, 1, "parts compared with the materials of the library")
    return identify_by_clip(parts.names, rules, alone, encoder)


def _by_command(scene: Scene, parts: Parts, rules: MaterialBook, run: Path, progress: Progress) -> MaterialBook:
    """The materials that a program of the user names."""
    from phys4dgen.materials.command import identify_by_command

    wanted = scene.materials
    return identify_by_command(
        run, parts.names, rules, wanted.argv, timeout_s=wanted.timeout_s,
        on_wait=lambda passed_s: progress.update(passed_s, wanted.timeout_s, "seconds of what the command may take"),
    )  # fmt: skip


def _decoded(png: bytes) -> NDArray[np.uint8]:
    return np.asarray(Image.open(BytesIO(png)).convert("RGB"))


def _judge_size(found: Identification, scene: Scene, asset: Asset, progress: Progress) -> None:
    """Say how large the model takes the object to be, where that matters."""
    if found.height_m is None:
        return
    said = f"{scene.materials.model} takes the object for {found.thing or 'something'} of {found.height_m:.2g} m"
    is_unknown = scene.height_m == "auto" and scene.longest_m is None
    if is_unknown or not 1 / 3 < found.height_m / asset.height_m < 3:
        progress.warn(f"{said}, the run for {asset.height_m:.2g} m; --height-m {found.height_m:.2g} would follow it.")
    else:
        progress.note(f"{said}.")


def pictures_for_model(source: Source, asset: Asset, parts: Parts, folder: Path) -> SubImages:
    """The pictures that a model is shown: of the user's picture where there is one, else of the front view.

    They are kept in ``folder`` and drawn only where it has none of this object with these parts.
    """
    from phys4dgen.materials.mllm import front_views, kept_pictures, make_sub_images, picture_view, pictures_digest

    def draw() -> SubImages:
        canonical, others = front_views(asset.gaussians, parts, asset.frame)
        if source.picture is not None and source.camera is not None:
            canonical = picture_view(asset.gaussians, parts, source.picture, source.camera)
        return make_sub_images(canonical, others, parts.count)

    g = asset.gaussians
    shown = (g.means, g.quats_wxyz, g.scales, g.opacities, g.sh, parts.labels, asset.frame.rotation, source.picture)
    return kept_pictures(folder, pictures_digest(shown), draw)


def model_endpoint(scene: Scene) -> Endpoint:
    """The model that a scene names.

    Raises:
        SceneError: its settings make no endpoint.
    """
    from phys4dgen.materials.mllm import endpoint

    return endpoint(scene.materials.model, scene.materials.base_url)


def asking(scene: Scene) -> Asking:
    """How a scene wants a model to be asked."""
    from phys4dgen.materials.mllm import Asking, Limits

    wanted = scene.materials
    limits = Limits(
        requests=_REQUESTS_PER_SAMPLE * wanted.samples if isinstance(wanted.max_requests, str) else wanted.max_requests,
        tokens=_TOKENS_PER_SAMPLE * wanted.samples if isinstance(wanted.max_tokens, str) else wanted.max_tokens,
        total_s=wanted.max_wait_s,
    )
    return Asking(
        samples=wanted.samples,
        temperature=wanted.temperature,
        limits=limits,
        allow_upload=wanted.allow_upload,
        offline=wanted.offline,
        trust=wanted.trust,
        origin=None if wanted.origin == "ask" else wanted.origin,
    )
