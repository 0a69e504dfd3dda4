"""PhysGaussian's boundary conditions as its file has them; coordinates in MPM space, sizes are half-sizes."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from phys4dgen.physgaussian.values import Keys, Seconds, Triple, as_tuple

__all__ = [
    "BOUNDARY_TYPES",
    "BoundaryCondition",
    "BoundingBox",
    "Cuboid",
    "Impulse",
    "ReleaseSequentially",
    "Rotation",
    "SurfaceCollider",
    "Translation",
]

Pair = Annotated[tuple[float, float], BeforeValidator(as_tuple)]


class _Windowed(Keys):
    start_time: Seconds = 0.0
    end_time: Seconds = 999.0


class BoundingBox(_Windowed):
    """Walls three cells inside the domain; take the velocity into them."""

    type: Literal["bounding_box"]


class Cuboid(_Windowed):
    """A box in which the grid has a given velocity, and which moves with it."""

    type: Literal["cuboid"]
    point: Triple
    size: Triple
    velocity: Triple
    end_time: Seconds = 1e3
    reset: Literal[0, 1] = 0


class Impulse(Keys):
    """The same force on every particle in a box, for some substeps."""

    type: Literal["particle_impulse"]
    force: Triple
    num_dt: Annotated[int, Field(ge=1, le=10**9)] = 1
    start_time: Seconds = 0.0
    point: Triple = (1.0, 1.0, 1.0)
    size: Triple = (1.0, 1.0, 1.0)


class Translation(_Windowed):
    """The velocity of the particles that lie in a box at first."""

    type: Literal["enforce_particle_translation"]
    point: Triple
    size: Triple
    velocity: Triple


class Rotation(_Windowed):
    """A turn and a shift of the particles that lie in a cylinder at first."""

    type: Literal["enforce_particle_velocity_rotation"]
    point: Triple
    normal: Triple
    half_height_and_radius: Pair
    rotation_scale: float
    translation_scale: float


class SurfaceCollider(_Windowed):
    """A half space."""

    type: Literal["surface_collider"]
    point: Triple
    normal: Triple
    surface: str = "sticky"
    friction: Annotated[float, Field(ge=0)] = 0.0


class ReleaseSequentially(_Windowed):
    """Particles between two positions along an axis, held at first and let go one layer after another."""

    type: Literal["release_particles_sequentially"]
    normal: Triple
    start_position: float
    end_position: float
    num_layers: int = 50


BoundaryCondition = Annotated[
    BoundingBox | Cuboid | Impulse | Translation | Rotation | SurfaceCollider | ReleaseSequentially,
    Field(discriminator="type"),
]

BOUNDARY_TYPES = {
    "bounding_box": BoundingBox,
    "cuboid": Cuboid,
    "particle_impulse": Impulse,
    "enforce_particle_translation": Translation,
    "enforce_particle_velocity_rotation": Rotation,
    "surface_collider": SurfaceCollider,
    "release_particles_sequentially": ReleaseSequentially,
}
