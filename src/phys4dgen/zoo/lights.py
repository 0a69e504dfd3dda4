"""The lights that a bundled object can be baked in; ``studio`` is the default, ``unlit`` bakes none at all."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from phys4dgen.zoo.patch import Array

__all__ = ["LIGHTS", "STUDIO", "Light"]


def _direction(*components: float) -> Array:
    return np.array(components) / np.linalg.norm(components)


@dataclass(frozen=True, eq=False)
class Light:
    """A key light of 9 degrees radius, a sky that brightens towards the zenith, and the light that the ground returns.

    Attributes:
        key_direction: unit vector towards the key light, y up, shape [3].
        key_color: linear RGB times the strength, shape [3].
        zenith_color: linear RGB of the sky overhead, shape [3].
        horizon_color: linear RGB of the sky at the horizon, shape [3].
        bounce_color: linear RGB of the ground, shape [3].
    """

    key_direction: Array = field(default_factory=lambda: _direction(-0.55, 0.75, 0.62))
    key_color: Array = field(default_factory=lambda: 1.25 * np.array([1.0, 0.95, 0.86]))
    zenith_color: Array = field(default_factory=lambda: 0.68 * np.array([0.90, 0.96, 1.06]))
    horizon_color: Array = field(default_factory=lambda: 0.68 * np.array([1.00, 0.98, 0.95]))
    bounce_color: Array = field(default_factory=lambda: np.array([0.40, 0.37, 0.34]))


STUDIO = Light()

LIGHTS: dict[str, Light | None] = {
    "studio": STUDIO,
    "overcast": Light(
        key_direction=_direction(0.1, 1.0, 0.2),
        key_color=np.array([0.22, 0.23, 0.25]),
        zenith_color=np.array([1.12, 1.18, 1.26]),
        horizon_color=np.array([0.98, 1.00, 1.04]),
    ),
    "evening": Light(
        key_direction=_direction(0.86, 0.34, 0.40),
        key_color=1.70 * np.array([1.0, 0.76, 0.46]),
        zenith_color=0.42 * np.array([0.70, 0.86, 1.25]),
        horizon_color=0.42 * np.array([1.0, 0.88, 0.82]),
        bounce_color=np.array([0.30, 0.25, 0.21]),
    ),
    "backlit": Light(
        key_direction=_direction(0.30, 0.62, -0.85),
        key_color=1.90 * np.array([1.0, 0.97, 0.90]),
        zenith_color=0.55 * np.array([0.92, 0.97, 1.05]),
        horizon_color=0.50 * np.array([1.0, 0.99, 0.96]),
    ),
    "unlit": None,
}
"""By name; None leaves the plain albedo."""
