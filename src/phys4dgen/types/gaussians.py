"""Static 3D Gaussians: what a splat file holds, with every activation already applied."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.types.checks import checked_array

__all__ = ["SH_C0", "Gaussians", "covariance_from_quats_scales", "rotation_from_quats"]

SH_C0 = 0.28209479177387814
"""Value of the constant spherical harmonic; colour = 0.5 + SH_C0 * sh[:, 0]."""


@dataclass(frozen=True, eq=False)
class Gaussians:
    """N Gaussians in the coordinates of the input (units are the input's own; see ``Frame`` for metres).

    Attributes:
        means: centres, shape [N, 3], float32.
        quats_wxyz: unit quaternions (w, x, y, z), shape [N, 4], float32.
        scales: standard deviations along the local axes, linear, positive, shape [N, 3], float32.
        opacities: in [0, 1], shape [N], float32.
        sh: spherical-harmonic coefficients, shape [N, K, 3] with K = 1, 4, 9 or 16, float32.
    """

    means: NDArray[np.float32]
    quats_wxyz: NDArray[np.float32]
    scales: NDArray[np.float32]
    opacities: NDArray[np.float32]
    sh: NDArray[np.float32]

    def __post_init__(self) -> None:
        means = checked_array(self.means, "means", (None, 3), np.float32)
        n = len(means)
        if n == 0:
            raise ValueError("means: expected at least one Gaussian, got none.")
        quats = checked_array(self.quats_wxyz, "quats_wxyz", (n, 4), np.float32)
        norms = np.linalg.norm(quats, axis=1)
        if not (np.abs(norms - 1) < 1e-3).all():
            worst = int(np.argmax(np.abs(norms - 1)))
            raise ValueError(f"quats_wxyz: expected unit quaternions, got norm {norms[worst]:.4g} at index {worst}.")
        scales = checked_array(self.scales, "scales", (n, 3), np.float32)
        if not (scales > 0).all():
            raise ValueError(f"scales: expected positive standard deviations, got {float(scales.min())}.")
        opacities = checked_array(self.opacities, "opacities", (n,), np.float32)
        if opacities.min() < 0 or opacities.max() > 1:
            raise ValueError(f"opacities: expected [0, 1], got [{opacities.min()}, {opacities.max()}].")
        sh = checked_array(self.sh, "sh", (n, None, 3), np.float32)
        if sh.shape[1] not in (1, 4, 9, 16):
            raise ValueError(f"sh: expected 1, 4, 9 or 16 coefficients per channel, got {sh.shape[1]}.")
        for name, value in zip(
            ("means", "quats_wxyz", "scales", "opacities", "sh"), (means, quats, scales, opacities, sh), strict=True
        ):
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.means)

    @property
    def sh_degree(self) -> int:
        """0, 1, 2 or 3."""
        return round(self.sh.shape[1] ** 0.5) - 1

    @property
    def base_colors(self) -> NDArray[np.float32]:
        """View-independent RGB of each Gaussian, clipped to [0, 1], shape [N, 3]."""
        return np.clip(0.5 + SH_C0 * self.sh[:, 0], 0, 1).astype(np.float32)

    def covariances(self) -> NDArray[np.float64]:
        """Covariance matrices Sigma = R S S^T R^T, shape [N, 3, 3]."""
        return covariance_from_quats_scales(self.quats_wxyz, self.scales)

    def subset(self, index: NDArray[Any]) -> Gaussians:
        """The Gaussians that an index or boolean mask selects, in that order."""
        return Gaussians(
            means=self.means[index],
            quats_wxyz=self.quats_wxyz[index],
            scales=self.scales[index],
            opacities=self.opacities[index],
            sh=self.sh[index],
        )

    def robust_bounds(
        self, *, rotation: NDArray[np.float64] | None = None, min_opacity: float = 0.02, tail_percent: float = 0.5
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower and upper corner of the box that floaters do not blow up (ARCHITECTURE.md 2, Views).

        Args:
            rotation: 3x3 matrix applied to the centres first (for example input axes -> z up).
            min_opacity: Gaussians below it do not count (for the box only).
            tail_percent: percentage cut off at either end of each axis.
        """
        seen = self.opacities > min_opacity
        points = self.means[seen if seen.any() else slice(None)].astype(np.float64)
        if rotation is not None:
            points = points @ np.asarray(rotation, np.float64).T
        lower, upper = np.percentile(points, [tail_percent, 100 - tail_percent], axis=0)
        return lower, upper


def rotation_from_quats(quats_wxyz: NDArray[Any]) -> NDArray[np.float64]:
    """Rotation matrices of (not necessarily unit) quaternions (w, x, y, z); shape [N, 3, 3]."""
    q = np.asarray(quats_wxyz, np.float64)
    w, x, y, z = np.moveaxis(q / np.linalg.norm(q, axis=-1, keepdims=True), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, -1) for row in rows], -2)


def covariance_from_quats_scales(quats_wxyz: NDArray[Any], scales: NDArray[Any]) -> NDArray[np.float64]:
    """Sigma = R diag(s^2) R^T; shape [N, 3, 3]."""
    axes = rotation_from_quats(quats_wxyz) * np.asarray(scales, np.float64)[..., None, :]
    return axes @ np.swapaxes(axes, -1, -2)
