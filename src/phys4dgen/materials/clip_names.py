"""Materials named by CLIP without any training: which sentence about a material fits the picture of a part best.

Another identifier beside the multimodal model (Paper: Sec. 3.4) that runs on this machine. It sees surfaces only, so
the interior takes the same material. How often it is right has not been measured.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from phys4dgen.clip import ClipEncoder
from phys4dgen.materials.library import library_entries
from phys4dgen.types import MaterialBook, PartMaterials

__all__ = ["identify_by_clip"]

_SENTENCES = (
    "a photo of something made of {}.",
    "a photo of {}.",
    "a close-up of the surface of {}.",
    "a part of an object that is made of {}.",
)
_UNSURE = 0.25
"""A probability below this, of some sixty materials, is a guess."""


def identify_by_clip(
    part_names: Sequence[str],
    rules: MaterialBook,
    pictures: Mapping[int, NDArray[np.uint8]],
    encoder: ClipEncoder,
) -> MaterialBook:
    """Name the material of every part that can be seen.

    Args:
        part_names: in the order of the part numbers.
        rules: materials of the parts that no picture shows.
        pictures: a picture of each part alone, by its number, shape [H, W, 3].
        encoder: the model.
    """
    book = dict(rules.parts)
    for name in part_names:
        book[name] = _with_warning(book[name], "no view shows enough of this part for CLIP, so the rule table decides")
    if pictures:
        names, materials = _material_vectors(encoder)
        numbers = sorted(pictures)
        cosines = encoder.pictures([pictures[number] for number in numbers]) @ materials.T
        for number, row in zip(numbers, cosines, strict=True):
            book[part_names[number]] = _named(names, row.astype(np.float64) / encoder.temperature, encoder.name)
    return MaterialBook(book)


def _material_vectors(encoder: ClipEncoder) -> tuple[list[str], NDArray[np.float32]]:
    """Names of the library's materials and a unit vector for each, the mean over its names and sentences."""
    entries = list(library_entries().values())
    words = [[word.replace("_", " ") for word in (entry.name, *entry.aliases)] for entry in entries]
    sentences = [form.format(word) for own in words for word in own for form in _SENTENCES]
    owner = np.repeat(np.arange(len(entries)), [len(own) * len(_SENTENCES) for own in words])
    found = encoder.sentences(sentences)
    vectors = np.zeros((len(entries), found.shape[1]), np.float32)
    np.add.at(vectors, owner, found)
    return [entry.name for entry in entries], vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _named(names: Sequence[str], logits: NDArray[np.float64], model: str) -> PartMaterials:
    """The most probable material, and how probable the next one is."""
    weight = np.exp(logits - logits.max())
    probability = weight / weight.sum()
    first, second = (int(place) for place in np.argsort(-probability, kind="stable")[:2])
    warnings = ["CLIP judges a surface by its look; how often it is right has not been measured"]
    if probability[first] < _UNSURE:
        warnings.append(f"CLIP is not sure: {names[first]} with a probability of {probability[first]:.2f}")
    chosen = replace(
        library_entries()[names[first]].material(),
        source="clip",
        evidence=f"{model}: {names[first]} {probability[first]:.2f}, next {names[second]} {probability[second]:.2f}",
        warnings=tuple(warnings),
    )
    return PartMaterials(surface=chosen, interior=chosen)


def _with_warning(materials: PartMaterials, why: str) -> PartMaterials:
    surface, interior = (replace(m, warnings=(why, *m.warnings)) for m in (materials.surface, materials.interior))
    return PartMaterials(surface=surface, interior=interior)
