"""PhysGaussian's configuration file: every key with its default; unknown keys are refused with a suggestion.

Names are the file's own, misspellings included. "MPM space" is the cube of side ``grid_lim`` in which it simulates,
with the object scaled to ``scale`` about (1, 1, 1) after its rotations.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationError, model_validator

from phys4dgen.errors import SceneError, did_you_mean
from phys4dgen.physgaussian.boundary_types import BOUNDARY_TYPES, BoundaryCondition
from phys4dgen.physgaussian.values import Keys, Triple, as_tuple
from phys4dgen.scene.errors import explain

__all__ = ["Configuration", "Mode", "RegionMaterial", "read_configuration"]

Mode = Literal["corrected", "compat"]
MATERIALS = ("jelly", "metal", "sand", "foam", "snow", "plasticine")
MAX_FILE_BYTES = 4 * 2**20

_SPELLINGS = {
    "init_azimuth": "init_azimuthm",
    "init_azimuth_m": "init_azimuthm",
    "max_particles_per_cell": "max_partciels_per_cell",
    "max_particle_per_cell": "max_partciels_per_cell",
    "material_params": "additional_material_params",
}
"""What users write -> the key that PhysGaussian reads; it ignores the others without a word."""


class RegionMaterial(Keys):
    """Other numbers for what lies in a box of MPM space at first."""

    point: Triple
    size: Triple
    E: Annotated[float, Field(gt=0, le=1e15)]
    nu: Annotated[float, Field(ge=0, le=0.5)]
    density: Annotated[float, Field(gt=0, le=1e6)] | None = None


class Filling(Keys):
    """How the inside is filled; its grid, thresholds and rays have no counterpart here."""

    n_grid: Annotated[int, Field(ge=1, le=4096)] | None = None
    density_threshold: float = 5.0
    search_threshold: float = 3.0
    max_particles_num: Annotated[float, Field(gt=0, le=1e10)] = 2_000_000
    max_partciels_per_cell: Annotated[int, Field(ge=1, le=10_000)] = 1
    search_exclude_direction: int = 5
    ray_cast_direction: int = 4
    boundary: Annotated[tuple[float, ...], BeforeValidator(as_tuple), Field(min_length=6, max_length=6)] | None = None
    smooth: bool = False
    visualize: bool = False


class Configuration(Keys):
    """The whole file."""

    material: str = "jelly"
    grid_lim: Annotated[float, Field(gt=0, le=1e4)] = 2.0
    n_grid: Annotated[int, Field(ge=4, le=4096)] = 50
    nu: Annotated[float, Field(ge=0, le=0.5)] = 0.4
    E: Annotated[float, Field(gt=0, le=1e15)] = 1e5
    density: Annotated[float, Field(gt=0, le=1e6)] = 200.0
    g: Triple | float = 9.8
    yield_stress: float = 0.0
    hardening: float = 0.0
    xi: float = 0.0
    friction_angle: Annotated[float, Field(ge=0, lt=90)] = 25.0
    plastic_viscosity: Annotated[float, Field(ge=0)] = 0.0
    softening: float = 0.1
    rpic_damping: float = 0.0
    pic_damping: float = 0.0
    grid_v_damping_scale: Annotated[float, Field(gt=0)] = 1.1
    opacity_threshold: Annotated[float, Field(ge=0, lt=1)] = 0.02
    rotation_degree: Annotated[tuple[float, ...], BeforeValidator(as_tuple)] = ()
    rotation_axis: Annotated[tuple[Literal[0, 1, 2], ...], BeforeValidator(as_tuple)] = ()
    sim_area: Annotated[tuple[float, ...], BeforeValidator(as_tuple), Field(min_length=6, max_length=6)] | None = None
    scale: Annotated[float, Field(gt=0, le=1e4)] = 1.0
    substep_dt: Annotated[float, Field(gt=0, le=1)] = 1e-4
    frame_dt: Annotated[float, Field(gt=0, le=10)] = 1e-2
    frame_num: Annotated[int, Field(ge=1, le=100_000)] = 100
    boundary_conditions: Annotated[tuple[BoundaryCondition, ...], BeforeValidator(as_tuple)] = ()
    additional_material_params: Annotated[tuple[RegionMaterial, ...], BeforeValidator(as_tuple)] = ()
    particle_filling: Filling | None = None
    mpm_space_viewpoint_center: Triple = (1.0, 1.0, 1.0)
    mpm_space_vertical_upward_axis: Triple = (0.0, 0.0, 1.0)
    default_camera_index: int = 0
    show_hint: bool = False
    init_azimuthm: float | None = None
    init_elevation: float | None = None
    init_radius: float | None = None
    move_camera: bool = False
    delta_a: float | None = None
    delta_e: float | None = None
    delta_r: float | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Configuration:
        if self.material not in MATERIALS:
            raise ValueError(
                f"material must be one of {', '.join(MATERIALS)}, got '{self.material[:40]}'."
                f"{did_you_mean(self.material, MATERIALS)}"
            )
        if len(self.rotation_degree) != len(self.rotation_axis):
            raise ValueError(
                f"rotation_degree and rotation_axis go together, got {len(self.rotation_degree)} and "
                f"{len(self.rotation_axis)} values"
            )
        area = self.sim_area
        if area is not None and not all(area[2 * axis] < area[2 * axis + 1] for axis in range(3)):
            raise ValueError("sim_area must be [xmin, xmax, ymin, ymax, zmin, zmax]")
        if self.frame_dt < self.substep_dt:
            raise ValueError(f"frame_dt {self.frame_dt:g} s is shorter than substep_dt {self.substep_dt:g} s")
        return self

    @property
    def cell(self) -> float:
        """Grid cell in MPM space."""
        return self.grid_lim / self.n_grid

    @property
    def end_s(self) -> float:
        """Simulated time of the whole film."""
        return self.frame_num * self.frame_dt


@dataclass(frozen=True)
class ReadConfiguration:
    """A configuration file as read.

    Attributes:
        values: every key.
        given: names of the top-level keys that the file has.
        notes: spellings that differ from PhysGaussian's, one sentence each.
    """

    values: Configuration
    given: frozenset[str]
    notes: tuple[str, ...]


def read_configuration(path: Path, *, mode: Mode) -> ReadConfiguration:
    """Read a configuration file.

    Args:
        path: JSON.
        mode: in ``compat`` keys that PhysGaussian does not know for their spelling are ignored as it does; in
            ``corrected`` they count. Both are noted.

    Raises:
        SceneError: missing, not JSON, an unknown key (with a suggestion) or a bad value.
    """
    tree = _json(path)
    notes: list[str] = []
    tree = _respelt(tree, "", mode, notes)
    if isinstance(tree.get("particle_filling"), dict):
        tree["particle_filling"] = _respelt(tree["particle_filling"], "particle_filling.", mode, notes)
    if isinstance(tree.get("boundary_conditions"), list):
        conditions = enumerate(tree["boundary_conditions"])
        tree["boundary_conditions"] = [_condition(entry, path, number) for number, entry in conditions]
    try:
        values = Configuration.model_validate(tree)
    except ValidationError as error:
        raise SceneError(explain(error, Configuration, source=str(path), places={})) from error
    return ReadConfiguration(values, frozenset(tree), tuple(notes))


def _condition(entry: Any, path: Path, number: int) -> BoundaryCondition:
    """One boundary condition."""
    place = f"{path}: boundary_conditions.{number}"
    kind = entry.get("type") if isinstance(entry, dict) else None
    if not isinstance(kind, str) or kind not in BOUNDARY_TYPES:
        raise SceneError(
            f"{place}: expected a type, one of {', '.join(BOUNDARY_TYPES)}, got {kind!r:.60}."
            f"{did_you_mean(str(kind), BOUNDARY_TYPES)}"
        )
    try:
        return BOUNDARY_TYPES[kind].model_validate(entry)
    except ValidationError as error:
        raise SceneError(explain(error, BOUNDARY_TYPES[kind], source=place, places={})) from error


def _json(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise SceneError(f"{path}: there is no such file; expected a configuration of PhysGaussian (.json).")
    if path.stat().st_size > MAX_FILE_BYTES:
        raise SceneError(f"{path}: expected a configuration of PhysGaussian, got {path.stat().st_size:,} bytes.")
    try:
        tree = json.loads(path.read_text("utf-8"))
    except json.JSONDecodeError as error:
        raise SceneError(
            f"{path} line {error.lineno}: not JSON ({error.msg}); a key may stand without its value."
        ) from error
    except (ValueError, RecursionError) as error:
        raise SceneError(f"{path}: not JSON ({error}); expected a configuration of PhysGaussian.") from error
    if not isinstance(tree, dict):
        raise SceneError(f"{path}: expected a JSON object with keys such as 'material', got {tree!r:.60}.")
    return tree


def _respelt(tree: Mapping[str, Any], prefix: str, mode: Mode, notes: list[str]) -> dict[str, Any]:
    """The tree with the keys as PhysGaussian spells them; what it would ignore is dropped in ``compat``."""
    known = Filling.model_fields if prefix else Configuration.model_fields
    result: dict[str, Any] = {}
    for key, value in tree.items():
        own = _SPELLINGS.get(key)
        if key in known or own is None or own not in known:
            result[key] = value
            continue
        ignored = f"{prefix}{key}: PhysGaussian knows only '{own}' and ignores this key"
        if mode == "compat":
            notes.append(f"{ignored}; so does this import.")
        elif own in tree:
            notes.append(f"{ignored}; both are given, '{own}' counts.")
        else:
            notes.append(f"{ignored}; this import takes it.")
            result[own] = value
    return result
