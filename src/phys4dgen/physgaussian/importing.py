"""Configuration and splat folder of PhysGaussian -> scene.yaml with what it refers to."""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from phys4dgen.errors import SceneError
from phys4dgen.formats import atomic_path, load_gaussians, save_gaussians
from phys4dgen.materials import write_materials
from phys4dgen.physgaussian.boundaries import Carried, carry_over
from phys4dgen.physgaussian.camera import film_of
from phys4dgen.physgaussian.configuration import Configuration, Mode, ReadConfiguration, read_configuration
from phys4dgen.physgaussian.masses import particle_masses
from phys4dgen.physgaussian.materials import BASE_PART, labels_of_regions, material_book
from phys4dgen.physgaussian.placement import Placement, place, simulated
from phys4dgen.scene import Scene, load_scene
from phys4dgen.types import Gaussians, rotation_to_z_up
from phys4dgen.yaml12 import format_yaml

__all__ = ["Imported", "import_physgaussian"]

_FEWEST_CELLS, _MOST_CELLS = 8, 512
_FASTEST_FPS = 240


@dataclass(frozen=True)
class Imported:
    """A scene made of a configuration.

    Attributes:
        scene_yaml: the scene.
        scene: what it says.
        files: everything that was written, the scene first.
        differences: where it does not do what PhysGaussian does, one sentence each.
    """

    scene_yaml: Path
    scene: Scene
    files: tuple[Path, ...]
    differences: tuple[str, ...]


def import_physgaussian(config: Path, model: Path, out: Path, *, mode: Mode = "corrected") -> Imported:
    """Write a scene that does what a configuration of PhysGaussian says.

    Beside the scene stand ``NAME_materials.yaml``, and where needed ``NAME_object.ply`` (the Gaussians that are
    simulated), ``NAME_surroundings.ply`` (the others) and ``NAME_labels.npz`` (material regions).

    Args:
        config: its configuration, JSON.
        model: its splat folder, with ``point_cloud/iteration_N/point_cloud.ply``; or a splat file.
        out: the scene to write, ``.yaml``.
        mode: ``corrected`` does what the file means, ``compat`` what PhysGaussian makes of it, where our solver can.

    Raises:
        SceneError: an unknown key, a bad value, or numbers on which PhysGaussian stops.
        FormatError: the splat cannot be read.
    """
    read = read_configuration(config, mode=mode)
    notes = list(read.notes)
    splat = _newest_splat(model)
    everything = load_gaussians(splat)
    chosen = simulated(everything, read.values)
    gaussians = everything
    files = [out]
    if not chosen.all():
        gaussians = everything.subset(chosen)
        splat = out.with_name(f"{out.stem}_object.ply")
        save_gaussians(gaussians, splat)
        files.append(splat)
        notes.append(_left_out(read.values, int((~chosen).sum())))
        if read.values.sim_area is not None:
            files.append(out.with_name(f"{out.stem}_surroundings.ply"))
            save_gaussians(everything.subset(~chosen), files[-1])
    placement = place(gaussians, read.values)
    labels = labels_of_regions(gaussians, read.values, placement)
    parts = {int(label): f"region_{label}" if label else BASE_PART for label in np.unique(labels)}
    missing = sorted(set(range(1, len(read.values.additional_material_params) + 1)) - set(parts))
    notes += [
        f"additional_material_params.{number - 1}: its box holds no Gaussian, or later ones do." for number in missing
    ]
    materials = out.with_name(f"{out.stem}_materials.yaml")
    write_materials(materials, material_book(read.values, parts, mode=mode, notes=notes))
    files.append(materials)
    grouping: dict[str, Any] = {"backend": "none", "names": {0: parts[min(parts)]}}
    if len(parts) > 1:
        labels_file = out.with_name(f"{out.stem}_labels.npz")
        _write_labels(labels_file, labels, list(parts.values()))
        files.append(labels_file)
        grouping = {"backend": "file", "labels_file": labels_file.name}
    places = placement.to_mpm(gaussians.means)
    masses_kg = particle_masses(read.values, places, labels)
    carried = carry_over(read.values, placement, places, masses_kg=masses_kg, mode=mode)
    tree = {
        "input": splat.name if splat.parent == out.parent else splat.resolve().as_posix(),
        **_frame(gaussians, read.values, placement, mode, notes),
        "grouping": grouping,
        "materials": {"backend": "file", "file": materials.name},
        "parts": {name: {"hold": "free"} for name in parts.values()},
        **_motion(read, placement, carried, mode, notes),
        "output": {"video": film_of(read.values, placement, _folder(model), notes)},
    }
    differences = (*notes, *carried.notes, *_without_counterpart(read, mode))
    with atomic_path(out) as temporary:
        temporary.write_text(_text(tree, config, mode, differences), encoding="utf-8")
    return Imported(out, load_scene(out), tuple(files), differences)


def _newest_splat(model: Path) -> Path:
    """The splat of the highest iteration in a folder of 3D Gaussian Splatting, or the file itself."""
    if not model.is_dir():
        return model
    numbered = {
        int(match[1]): place / "point_cloud.ply"
        for place in (model / "point_cloud").glob("iteration_*")
        if (match := re.fullmatch(r"iteration_(\d{1,9})", place.name)) and (place / "point_cloud.ply").is_file()
    }
    if not numbered:
        raise SceneError(f"{model}: expected point_cloud/iteration_N/point_cloud.ply in it, as training leaves it.")
    return numbered[max(numbered)]


def _folder(model: Path) -> Path:
    return model if model.is_dir() else model.parent


def _left_out(config: Configuration, count: int) -> str:
    area = " or lie outside sim_area; PhysGaussian shows those unmoved, here they are left out" * (
        config.sim_area is not None
    )
    return f"opacity_threshold: {count:,} Gaussians are below {config.opacity_threshold:g}{area}."


def _frame(
    gaussians: Gaussians, config: Configuration, placement: Placement, mode: Mode, notes: list[str]
) -> dict[str, Any]:
    """Up and size (a unit of MPM space is a metre), a grid of the same cells, and time."""
    up = placement.vector(config.mpm_space_vertical_upward_axis)
    if not any(up):
        up = placement.vector((0.0, 0.0, 1.0))
    lower, upper = gaussians.robust_bounds(rotation=rotation_to_z_up(np.array(up)))
    longest_m = float((upper - lower).max()) * placement.scale
    cells = round(longest_m / config.cell)
    return {
        "up": up,
        "longest_m": round(longest_m, 9),
        "simulation": {
            "grid": min(max(cells, _FEWEST_CELLS), _MOST_CELLS),
            "damping_ratio": 0.0,
            **_times(config, mode, notes),
        },
    }


def _motion(
    read: ReadConfiguration, placement: Placement, carried: Carried, mode: Mode, notes: list[str]
) -> dict[str, Any]:
    """What happens, and for how long."""
    config = read.values
    forces = list(carried.forces)
    if config.grid_v_damping_scale < 1:
        # v *= s in every substep is the decay rate -ln(s)/dt, whatever our own substep is
        rate = -float(np.log(config.grid_v_damping_scale)) / config.substep_dt
        forces.append({"kind": "wind", "velocity_ms": (0.0, 0.0, 0.0), "drag_per_m": 0.0, "drag_per_s": rate})
    return {
        "motion": {"preset": "rest"},
        **_gravity(read, placement, mode, notes),
        "forces": forces,
        "boundaries": carried.boundaries,
        "interior": _interior(config, mode),
    }


def _gravity(read: ReadConfiguration, placement: Placement, mode: Mode, notes: list[str]) -> dict[str, Any]:
    given = read.values.g
    if isinstance(given, float):
        if mode == "compat":
            raise SceneError(f"g: PhysGaussian stops on the number {given:g}; give a list, or --mode corrected.")
        up = np.array(read.values.mpm_space_vertical_upward_axis)
        up = up / np.linalg.norm(up) if np.linalg.norm(up) > 0 else np.array([0.0, 0.0, 1.0])
        notes.append(f"g: PhysGaussian stops on the number {given:g}; it is taken downwards.")
        vector = placement.vector(-given * up)
    else:
        vector = placement.vector(given)
    return {"gravity": "on", "gravity_ms2": vector, "prestress": "off"} if any(vector) else {"gravity": "off"}


def _interior(config: Configuration, mode: Mode) -> dict[str, Any]:
    """Filled where it fills; every Gaussian a particle where it shall be as there."""
    method = {"method": "none"} if config.particle_filling is None else {}
    return method | ({"particles": "gaussians"} if mode == "compat" else {})


def _times(config: Configuration, mode: Mode, notes: list[str]) -> dict[str, Any]:
    substeps = int(config.frame_dt / config.substep_dt)
    frame_s = config.frame_dt
    if substeps * config.substep_dt < config.frame_dt * (1 - 1e-9):
        said = f"frame_dt: PhysGaussian makes {substeps} substeps, {substeps * config.substep_dt:g} s, of each frame"
        if mode == "compat":
            frame_s = substeps * config.substep_dt
            notes.append(f"{said}; so does this scene.")
        else:
            notes.append(f"{said}; here a frame takes {config.frame_dt:g} s.")
    fps = min(max(int(1 / config.frame_dt), 1), _FASTEST_FPS)
    return {"fps": fps, "duration_s": config.frame_num / fps, "frame_time_s": frame_s}


def _without_counterpart(read: ReadConfiguration, mode: Mode) -> tuple[str, ...]:
    """Keys that are understood and have nothing to act on here, of those that the file has."""
    config = read.values
    notes = ["frame_num: PhysGaussian's first picture is already one frame_dt in; here frame 0 is the shape at rest."]
    if config.rpic_damping != 0:
        notes.append(f"rpic_damping: {config.rpic_damping:g} is not carried over; our transfer is APIC.")
    if "pic_damping" in read.given:
        notes.append("pic_damping: PhysGaussian reads it and never uses it.")
    if config.particle_filling is not None:
        notes.append(
            "particle_filling: the inside is found by our own method; its thresholds and rays have no counterpart."
        )
    if config.show_hint:
        notes.append("show_hint: prints a hint in PhysGaussian; no effect here.")
    here = " in both modes" if mode == "compat" else ""
    notes.append(
        "covariance: PhysGaussian stretches Gaussians by the elastic deformation alone, so plastic flow does not show; "
        f"here they follow the whole deformation{here}."
    )
    return tuple(notes)


def _write_labels(path: Path, labels: Any, names: list[str]) -> None:
    buffer = io.BytesIO()
    np.savez(buffer, labels=labels, names=np.array(names))
    with atomic_path(path) as temporary:
        temporary.write_bytes(buffer.getvalue())


def _text(tree: dict[str, Any], config: Path, mode: Mode, differences: tuple[str, ...]) -> str:
    head = [f"# From {config.name} of PhysGaussian, --mode {mode}. Where it does not do what PhysGaussian does:"]
    head += [f"# - {difference}" for difference in differences]
    return "\n".join(head) + "\n" + format_yaml({key: value for key, value in tree.items() if value not in ({}, [])})
