"""What a stage made, as digests of its content: equal digests, equal results further down."""

from __future__ import annotations

import hashlib
import json
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.run.stages import Needs
from phys4dgen.types import Continuum, MaterialBook, Parts

__all__ = ["MotionDigest", "book_products", "interior_products", "needs_digest", "parts_products"]

_PHYSICAL = ("name", "law", "density_kgm3", "youngs_modulus_pa", "poisson_ratio", "thickness_m", "extra")


def needs_digest(needs: Needs) -> str:
    """Digest of what a result follows from, where the result itself is not kept to the last bit."""
    return _text_digest([dict(needs.settings), dict(needs.products), needs.code])


def parts_products(parts: Parts) -> dict[str, str]:
    """Labels and names apart: the inside does not ask for names."""
    return {"parts": _arrays_digest(parts.labels), "part names": _text_digest(list(parts.names))}


def interior_products(continuum: Continuum) -> dict[str, str]:
    """The particles."""
    return {"particles": _arrays_digest(*(np.asarray(getattr(continuum, field.name)) for field in fields(continuum)))}


def book_products(book: MaterialBook) -> dict[str, str]:
    """The values that the simulation reads; where they came from and what was warned of does not count."""
    rows = {
        f"{part} {side}": {key: getattr(material, key) for key in _PHYSICAL if key != "extra"} | dict(material.extra)
        for part, sides in book.parts.items()
        for side, material in (("surface", sides.surface), ("interior", sides.interior))
    }
    return {"materials": _text_digest(rows)}


class MotionDigest:
    """Digest of a motion, taken frame by frame while it streams by."""

    def __init__(self, times_s: NDArray[np.float64]) -> None:
        self._digest = hashlib.blake2b(np.ascontiguousarray(times_s).data, digest_size=32)

    def add(self, positions: NDArray[np.float32], deformation_gradients: NDArray[np.float32]) -> None:
        """One more frame."""
        self._digest.update(np.ascontiguousarray(positions).data)
        self._digest.update(np.ascontiguousarray(deformation_gradients).data)

    def products(self) -> dict[str, str]:
        """The motion."""
        return {"motion": self._digest.hexdigest()}


def _text_digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


def _arrays_digest(*arrays: NDArray[Any]) -> str:
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(f"{array.dtype.str} {array.shape}\n".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
