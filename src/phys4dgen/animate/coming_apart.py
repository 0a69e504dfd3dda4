"""Gaussians on material that flows: they let go of particles that have left the one nearest to them.

In sand, snow or water neighbours of the rest pose part for good. A blend of eight of them that have gone eight ways
would put a Gaussian where there is nothing. Each particle's weight therefore fades out while its distance to the
Gaussian's nearest particle grows from 1.3 to 2 times what it was at rest; the nearest particle itself is never let go.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.animate.skinning import Skin

__all__ = ["ComingApart"]

_FADES_FROM, _GONE_AT = 1.3, 2.0  # of the distance at rest


class ComingApart:
    """The Gaussians whose nearest particle may part from its neighbours."""

    def __init__(self, skin: Skin, rest_positions: NDArray[Any], loose: NDArray[np.bool_]) -> None:
        """Keep the distances at rest.

        Args:
            skin: how the Gaussians hang on the particles.
            rest_positions: of the particles, shape [P, 3].
            loose: particles that may part from their neighbours, shape [P].
        """
        hangs_on_several = (skin.weights[:, 1:] > 0).any(1)  # a Gaussian that is a particle itself has nothing to drop
        self._rows = np.flatnonzero(loose[skin.particles[:, 0]] & hangs_on_several)
        self._particles = skin.particles[self._rows]
        self._rest = self._distances(rest_positions)
        # neighbours nearer than half the usual distance may well double it without having parted
        self._rest = np.maximum(self._rest, np.median(self._rest[:, 1:]) / 2) if len(self._rows) else self._rest

    def weights(self, weights: NDArray[np.float32], positions: NDArray[Any]) -> NDArray[np.float32]:
        """Weights [N, 8] with those of particles that have left taken back, rows still sum to 1."""
        stretch = self._distances(positions) / self._rest
        gone = np.clip((stretch - _FADES_FROM) / (_GONE_AT - _FADES_FROM), 0, 1)
        kept = weights[self._rows] * (1 - gone * gone * (3 - 2 * gone))
        result = weights.copy()
        result[self._rows] = kept / kept.sum(1, keepdims=True)
        return result

    def _distances(self, positions: NDArray[Any]) -> NDArray[np.float64]:
        """From each Gaussian's nearest particle to the eight that carry it, [n, 8]."""
        places = np.asarray(positions, np.float64)[self._particles]
        return np.linalg.norm(places - places[:, :1], axis=2)
