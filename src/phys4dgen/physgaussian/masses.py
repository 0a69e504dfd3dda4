"""Masses of PhysGaussian's particles: a cell's volume is shared by the particles in it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phys4dgen.physgaussian.configuration import Configuration

__all__ = ["particle_masses"]


def particle_masses(
    config: Configuration, places: NDArray[np.float64], labels: NDArray[np.int32]
) -> NDArray[np.float64]:
    """Mass of each simulated Gaussian as a particle, kg, shape [N]; particles that fill the inside are not counted.

    Args:
        config: the configuration.
        places: in MPM space, [N, 3].
        labels: region of each, as ``materials.labels_of_regions`` gives them, [N].
    """
    cells = np.floor(places / config.cell).astype(np.int64)
    _, which, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    volumes = config.cell**3 / counts[which.reshape(-1)]
    if config.material == "sand":
        volumes = np.full(len(places), volumes.mean())
    densities = [config.density]
    densities += [config.density if r.density is None else r.density for r in config.additional_material_params]
    return volumes * np.array(densities)[labels]
