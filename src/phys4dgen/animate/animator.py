"""Moving Gaussians: positions, deformation, covariances and rotations of every Gaussian, frame by frame.

Paper: Sec. 3.5, Eq. for Sigma(t) = F(t) Sigma(0) F(t)^T. The colour of a Gaussian turns with it: its spherical
harmonics are evaluated in the direction R^T d, R the rotation of the polar decomposition F = R S.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.animate.coming_apart import ComingApart
from phys4dgen.animate.kernels import LANES, blocked, carry_slice, covariance_slice
from phys4dgen.animate.skinning import Skin
from phys4dgen.animate.slices import run_slices
from phys4dgen.animate.stretch import STRETCH_LIMITS, checked_limits, polar_and_limited
from phys4dgen.errors import StageError
from phys4dgen.types import Gaussians

__all__ = ["AnimatedFrame", "Animator", "Deformer"]


@dataclass(frozen=True, eq=False)
class AnimatedFrame:
    """All Gaussians at one time, in the input's coordinates.

    Attributes:
        positions: centres, shape [N, 3], float32.
        deformation: total deformation gradient F as the particles have it, not limited, shape [N, 3, 3], float32.
        rotations: R of F = R S; spherical harmonics are evaluated at R^T d, shape [N, 3, 3], float32.
        covariances6: xx, xy, xz, yy, yz, zz of F_c Sigma F_c^T, F_c the F with limited stretch, [N, 6], float32.
    """

    positions: NDArray[np.float32]
    deformation: NDArray[np.float32]
    rotations: NDArray[np.float32]
    covariances6: NDArray[np.float32]


class Deformer:
    """Covariances and rotations of N Gaussians under given deformation gradients (from a Trajectory, say)."""

    def __init__(
        self,
        gaussians: Gaussians,
        *,
        stretch_limits: tuple[float, float] = STRETCH_LIMITS,
        threads: int | None = None,
    ) -> None:
        """Keep what stays the same in all frames.

        Args:
            gaussians: at rest.
            stretch_limits: least (0.1 to 1) and greatest (1 to 10) singular value of F that is shown.
            threads: None for Numba's thread count; the result does not depend on it.

        Raises:
            StageError: the limits are out of range.
        """
        self._limits = checked_limits(stretch_limits)
        self._threads = threads
        self._count = len(gaussians)
        covariances = gaussians.covariances().reshape(-1, 9)[:, [0, 1, 2, 4, 5, 8]]
        self._covariances = blocked(covariances)

    def deform(self, deformation: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Rotations [N, 3, 3] and packed covariances [N, 6] for deformation gradients [N, 3, 3]."""
        rotations, limited = polar_and_limited(deformation, self._count, limits=self._limits, threads=self._threads)
        covariances6 = np.zeros((self._count, 6), np.float32)
        run_slices(covariance_slice, limited, self._covariances, covariances6, threads=self._threads)
        return rotations.reshape(-1, 3, 3), covariances6


class Animator:
    """Moves N Gaussians with P particles."""

    def __init__(
        self,
        gaussians: Gaussians,
        skin: Skin,
        rest_positions: NDArray[Any],
        *,
        loose: NDArray[np.bool_] | None = None,
        stretch_limits: tuple[float, float] = STRETCH_LIMITS,
        threads: int | None = None,
    ) -> None:
        """Keep what stays the same in all frames.

        Args:
            gaussians: at rest, N.
            skin: how they hang on the particles.
            rest_positions: X_p of the particles whose x_p ``frame`` will be given, shape [P, 3], input coordinates.
            loose: particles that may part from their neighbours (``coming_apart``), shape [P]; none by default.
            stretch_limits: see ``Deformer``.
            threads: None for Numba's thread count; the result does not depend on it.

        Raises:
            StageError: ``skin`` belongs to another number of Gaussians or particles.
        """
        rest = np.asarray(rest_positions, np.float64)
        if len(skin) != len(gaussians):
            raise StageError(f"skin: expected {len(gaussians)} Gaussians, got {len(skin)}; make the skin again.")
        if rest.ndim != 2 or rest.shape[1] != 3 or skin.particles.max() >= len(rest):
            raise StageError(
                f"rest_positions: expected [P, 3] with P > {int(skin.particles.max())}, got {rest.shape}; "
                "give the positions of the particles that the skin was made for."
            )
        self._deformer = Deformer(gaussians, stretch_limits=stretch_limits, threads=threads)
        self._threads = threads
        self._rest = rest
        self._origin = rest.mean(0)
        self._means = gaussians.means
        self._centred = blocked(gaussians.means - self._origin)
        self._rigidity = blocked(skin.rigidity[:, None])
        self._arm = blocked(skin.arm)
        padding = -len(skin) % LANES
        self._particles = np.pad(skin.particles, ((0, padding), (0, 0)))
        self._weights = np.pad(skin.weights, ((0, padding), (0, 0)))
        self._coming_apart = None if loose is None or not loose.any() else ComingApart(skin, rest, loose)

    def frame(self, positions: NDArray[Any], deformation_gradients: NDArray[Any]) -> AnimatedFrame:
        """All Gaussians when the particles stand at ``positions`` [P, 3] with total F [P, 3, 3], input axes."""
        carried_positions, carried = self.carry(positions, deformation_gradients)
        rotations, covariances6 = self._deformer.deform(carried)
        return AnimatedFrame(carried_positions, carried, rotations, covariances6)

    def carry(
        self, positions: NDArray[Any], deformation_gradients: NDArray[Any]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Positions [N, 3] and deformation gradients [N, 3, 3] of the Gaussians alone: what a Trajectory keeps."""
        n = len(self._means)
        carried_positions = np.zeros((n, 3), np.float32)
        carried = np.zeros((n, 9), np.float32)
        run_slices(
            carry_slice,
            self._motion(positions, deformation_gradients),
            self._particles,
            self._weights if self._coming_apart is None else self._coming_apart.weights(self._weights, positions),
            self._means,
            self._centred,
            self._rigidity,
            self._arm,
            carried_positions,
            carried,
            threads=self._threads,
        )
        return carried_positions, carried.reshape(-1, 3, 3)

    def _motion(self, positions: NDArray[Any], deformation_gradients: NDArray[Any]) -> NDArray[np.float32]:
        """Each particle's affine displacement field c + H (X - O) and its displacement, 16 floats, flat."""
        p = len(self._rest)
        if np.shape(positions) != (p, 3) or np.shape(deformation_gradients) != (p, 3, 3):
            raise StageError(
                f"particles: expected positions ({p}, 3) and deformation gradients ({p}, 3, 3), "
                f"got {np.shape(positions)} and {np.shape(deformation_gradients)}."
            )
        displacement = np.asarray(positions, np.float64) - self._rest
        gradient = np.asarray(deformation_gradients, np.float64) - np.eye(3)
        motion = np.zeros((p, 16), np.float32)
        motion[:, :3] = displacement - np.einsum("pab,pb->pa", gradient, self._rest - self._origin)
        motion[:, 3:12] = gradient.reshape(p, 9)
        motion[:, 12:15] = displacement
        return motion.ravel()
