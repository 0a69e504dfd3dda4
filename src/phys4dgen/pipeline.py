"""From a splat to a film: the stages in order, one line each.

A stage is a function of core types. What it made is kept by a ``Store`` (a run folder, ``run/generate.py``), which
also recalls it, so that an interrupted run goes on where it stopped.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, TypeVar

import numba
import numpy as np
from numpy.typing import NDArray

from phys4dgen.animate import Animator, AxisTracker, Deformer, skin
from phys4dgen.body import Assembly, assemble_body
from phys4dgen.errors import SceneError, SimulationError
from phys4dgen.formats import load_gaussians
from phys4dgen.grouping.appearance import group_by_appearance
from phys4dgen.grouping.from_file import parts_from_file, rename_parts, single_part
from phys4dgen.interior import Interior, discover_interior, welded_share, with_thickness
from phys4dgen.materials import assemble_book, identify_by_rules, read_materials
from phys4dgen.motion import Held, choose_held, damping_per_s, gust, probe_gust
from phys4dgen.mpm import Acceleration, Settings, Simulator, stiff_parts
from phys4dgen.progress import SILENT, Progress
from phys4dgen.render.cameras import video_path, view_cameras
from phys4dgen.render.rasterise import Rasteriser
from phys4dgen.render.views import render_views
from phys4dgen.scene import ALL_PARTS, Scene, check_part_names, refuse_impossible_part_names
from phys4dgen.types import Camera, Continuum, Frame, Gaussians, MaterialBook, Parts, Views, rotation_to_z_up
from phys4dgen.types.upright import guess_up

__all__ = ["Asset", "Film", "FilmFrame", "Motion", "MotionFacts", "Store", "animate_scene"]

T = TypeVar("T")


class Store(Protocol):
    """Keeps what the stages make."""

    def recall(self, stage: str, inputs: dict[str, Any]) -> Any | None:
        """What ``stage`` made in an earlier run with the same input and settings, or None."""
        ...

    def keep(self, stage: str, result: Any, inputs: dict[str, Any]) -> Any:
        """Keep the result of ``stage``; return it, or what stands for it from now on."""
        ...


def animate_scene(scene: Scene, store: Store, *, until: str = "render", progress: Progress = SILENT) -> None:
    """Run the stages of a scene up to and with ``until``."""
    refuse_impossible_part_names(scene)
    asset = load(scene, progress)

    def stage(name: str, make: Callable[[], T], **inputs: Any) -> T:
        progress.stage(name)
        found = store.recall(name, {"asset": asset, **inputs})
        if found is not None:
            progress.note(f"{name}: taken from the run folder.")
            return found
        return store.keep(name, make(), {"asset": asset, **inputs})

    views = stage("views", lambda: look(scene, asset, progress))
    if until == "views":
        return
    parts = stage("grouping", lambda: group(scene, asset, views, progress), views=views)
    check_part_names(scene, parts.names)
    if until == "grouping":
        return
    interior = stage("interior", lambda: fill(scene, asset, parts, progress), parts=parts)
    if until == "interior":
        return
    book = stage("materials", lambda: identify(scene, asset, parts, interior, progress), parts=parts)
    if until == "materials":
        return
    motion = stage("simulate", lambda: move(scene, asset, parts, interior, book, progress), parts=parts, book=book)
    if until == "simulate":
        return
    stage("render", lambda: film(scene, asset, motion, progress), motion=motion)


# ------------------------------------------------------------------------------------------------ input and frame


@dataclass(frozen=True, eq=False)
class Asset:
    """The object and how it stands in the world.

    Attributes:
        gaussians: as in the input, its N and order.
        frame: input coordinates -> metres, z up.
        lower, upper: robust box in upright axes, input units, [3].
        cell: grid cell dx of the simulation, input units.
    """

    gaussians: Gaussians
    frame: Frame
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    cell: float

    @property
    def cell_m(self) -> float:
        """Grid cell dx, metres."""
        return self.cell * self.frame.metres_per_unit

    @property
    def height_m(self) -> float:
        """Robust extent along up, metres."""
        return float(self.upper[2] - self.lower[2]) * self.frame.metres_per_unit


def load(scene: Scene, progress: Progress) -> Asset:
    """Read the splat and decide which way is up and how large it is."""
    gaussians = load_gaussians(scene.input)
    rotation = rotation_to_z_up(_up_vector(scene, gaussians, progress))
    lower, upper = gaussians.robust_bounds(rotation=rotation)
    extent = upper - lower
    if not (extent > 0).all():
        raise SceneError(f"{scene.input}: expected an object with a volume, got an extent of {extent.tolist()} units.")
    if scene.longest_m is not None:
        metres_per_unit = scene.longest_m / extent.max()
    else:
        if scene.height_m == "auto":
            progress.warn("The real size is not known: the object is taken to be 0.3 m tall; give --height-m.")
        metres_per_unit = (0.3 if isinstance(scene.height_m, str) else scene.height_m) / extent[2]
    frame = Frame(rotation, float(metres_per_unit))
    return Asset(gaussians, frame, lower, upper, float(extent.max()) / scene.simulation.grid)


def _up_vector(scene: Scene, gaussians: Gaussians, progress: Progress) -> NDArray[np.float64]:
    if not isinstance(scene.up, str):
        return np.array(scene.up)
    if scene.up != "auto":
        axis = "xyz".index(scene.up[-1])
        return np.eye(3)[axis] * (-1.0 if scene.up.startswith("-") else 1.0)
    guess = guess_up(gaussians)
    if not guess.is_sure:
        progress.warn(f"Which way is up is a guess ({guess.reason}); give --up if the picture is on its side.")
    return guess.up


# -------------------------------------------------------------------------------------------- understanding stages


def look(scene: Scene, asset: Asset, progress: Progress) -> Views:
    """Render the static object from the view table."""
    return _rendered(asset, scene.views.preset, scene.views.size_px, progress)


def _rendered(asset: Asset, preset: Any, size_px: int, progress: Progress) -> Views:
    cameras = view_cameras(preset, lower=asset.lower, upper=asset.upper, rotation=asset.frame.rotation, size_px=size_px)
    return render_views(
        asset.gaussians, cameras, on_view=lambda k: progress.update(k + 1, len(cameras), "views rendered")
    )


def group(scene: Scene, asset: Asset, views: Views, progress: Progress) -> Parts:
    """Divide the Gaussians into parts (Paper: Sec. 3.2)."""
    wanted = scene.grouping
    if wanted.labels_file is not None:
        parts = parts_from_file(wanted.labels_file, len(asset.gaussians))
    elif wanted.backend == "none":
        parts = single_part(len(asset.gaussians))
    else:
        count = None if isinstance(wanted.parts, str) else wanted.parts
        parts, _ = group_by_appearance(
            asset.gaussians,
            asset.frame,
            parts=count,
            views=_object_views(scene, asset, views, progress),
            progress=progress,
        )
    parts = rename_parts(parts, wanted.names)
    progress.note(f"{parts.count} parts by {parts.backend}: {', '.join(parts.names)}.")
    return parts


def _object_views(scene: Scene, asset: Asset, views: Views, progress: Progress) -> Views:
    """Parts are read from the ``object`` table whatever views the user wants to look at."""
    return views if scene.views.preset == "object" else _rendered(asset, "object", 256, progress)


def fill(scene: Scene, asset: Asset, parts: Parts, progress: Progress) -> Interior:
    """Find the inside and fill it with particles (Paper: Sec. 3.3)."""
    wanted = scene.interior
    spacing = 0.5 if isinstance(wanted.spacing, str) else wanted.spacing
    views = _rendered(asset, "carve", 640, progress)
    interior = discover_interior(
        asset.gaussians,
        views,
        parts,
        frame=asset.frame,
        cell=asset.cell,
        spacing_cells=spacing,
        label_grid=wanted.label_grid,
        confidence=wanted.confidence,
        max_cells_per_gaussian=wanted.max_particles_per_gaussian,
        wall_m=_given_thickness(scene, parts),
    )
    found = interior.bridges
    progress.note(
        f"{len(interior.continuum)} particles in {interior.solid_voxels} solid voxels; "
        f"{found.pieces_before} pieces, {found.pieces_after} after bridging ({found.bridge_voxels} bridge voxels)."
    )
    if found.share_in_largest < 0.995 or interior.loose_particles:
        progress.warn(
            f"The object falls into {found.pieces_after} pieces and the largest holds {found.share_in_largest:.1%} of "
            f"it; small loose ones ({interior.loose_particles} particles) are not simulated but carried by what is "
            "nearest."
        )
    return interior


def identify(scene: Scene, asset: Asset, parts: Parts, interior: Interior, progress: Progress) -> MaterialBook:
    """Name the materials of every part (Paper: Sec. 3.4); rules stand in for the multimodal model."""
    identified = identify_by_rules(asset.gaussians, parts, asset.frame, interior.continuum)
    from_file = None if scene.materials.file is None else read_materials(scene.materials.file, parts.names)
    options = scene.parts
    book = assemble_book(
        parts.names,
        identified,
        from_file=from_file,
        surface={name: o.material for name, o in options.items() if o.material is not None},
        interior={name: o.interior_material for name, o in options.items() if o.interior_material is not None},
        thickness_m={name: o.thickness_m for name, o in options.items() if o.thickness_m is not None},
    )
    for name, entry in book.parts.items():
        for warning in dict.fromkeys((*entry.surface.warnings, *entry.interior.warnings)):
            progress.warn(f"Material of part '{name}': {warning}.")
    return book


# -------------------------------------------------------------------------------------------------------- motion

_WELDED_WARNING = 0.25


@dataclass
class MotionFacts:
    """What the simulation decided and found, for the report.

    Attributes:
        preset: sway or rest.
        held: parts or region held, with the reason.
        wind_up: direction of the gust, axes with z up.
        gust_ms2, gust_s: its strength and length.
        frequency_hz: lowest frequency that the probe saw.
        damping_per_s: mass-proportional damping.
        cell_m, cfl, substeps, dt_s: of the solver; substeps and dt per frame.
        welded_share: share of thin surfaces that the grid cannot tell from their neighbours.
        thickening: parts that were simulated thicker than they are.
        capped: parts whose thick regions were simulated softer than they are.
        part_mass_g: true mass of each part.
        energy_kinetic_j, energy_elastic_j, momentum_kgms, max_speed_ms: per frame.
    """

    preset: str
    held: str
    wind_up: list[float] | None = None
    gust_ms2: float = 0.0
    gust_s: float = 0.0
    frequency_hz: float | None = None
    damping_per_s: float = 0.0
    cell_m: float = 0.0
    cfl: float = 0.0
    welded_share: float = 0.0
    thickening: list[Any] = field(default_factory=list)
    capped: list[Any] = field(default_factory=list)
    part_mass_g: dict[str, float] = field(default_factory=dict)
    substeps: list[int] = field(default_factory=list)
    dt_s: list[float] = field(default_factory=list)
    max_speed_ms: list[float] = field(default_factory=list)
    energy_kinetic_j: list[float] = field(default_factory=list)
    energy_elastic_j: list[float] = field(default_factory=list)
    momentum_kgms: list[list[float]] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Motion:
    """The motion of all Gaussians, frame by frame.

    Attributes:
        times_s: of the frames, [T].
        frames: yields (positions [N, 3], total deformation gradients [N, 3, 3]) per frame, input axes; may be asked
            again only where the store recalls it.
        facts: complete when all frames were taken.
    """

    times_s: NDArray[np.float64]
    frames: Callable[[], Iterator[tuple[NDArray[np.float32], NDArray[np.float32]]]]
    facts: MotionFacts


def move(
    scene: Scene, asset: Asset, parts: Parts, interior: Interior, book: MaterialBook, progress: Progress
) -> Motion:
    """Simulate the body with MPM and carry all Gaussians with it (Paper: Sec. 3.5)."""
    continuum = settled_thickness(scene, asset, parts, interior.continuum, book)
    preset = scene.motion.preset
    if preset == "auto":
        preset = "rest" if scene.forces else "sway"
    holds = {name: options.hold for name, options in scene.parts.items() if options.hold != "auto"}
    held = choose_held(
        continuum, parts, frame=asset.frame, holds=holds, automatic=preset == "sway" or bool(scene.forces)
    )
    if held.particles.all():
        raise SimulationError(f"Every part is held ({held.reason}); free one with 'parts: {{NAME: {{hold: free}}}}'.")
    assembly = _assembled(scene, asset, parts, continuum, book, held)
    facts = MotionFacts(preset, held.reason, cell_m=asset.cell_m, cfl=scene.simulation.cfl)
    facts.thickening = list(assembly.thickening)
    facts.capped = list(assembly.capped)
    for cap in assembly.capped:
        progress.warn(
            f"Part '{cap.part}': its thickest regions are simulated with E = {cap.simulated_youngs_modulus_pa:.2g} Pa "
            f"instead of {cap.true_youngs_modulus_pa:.2g} Pa to save time steps; strains there stay below "
            f"{100 * cap.largest_strain:.1g} %, which is not seen."
        )
    facts.welded_share = welded_share(continuum, frame=asset.frame, free=~held.particles, cell_m=asset.cell_m)
    if facts.welded_share > _WELDED_WARNING:
        progress.warn(
            f"{facts.welded_share:.0%} of the thin surfaces lie closer than two grid cells to another one and move as "
            f"if glued to it; a finer grid (--grid {2 * scene.simulation.grid}) frees them."
        )
    facts.part_mass_g = _part_masses_g(parts, continuum, assembly)
    for warning in assembly.law_warnings:
        progress.warn(f"Law: {warning}.")

    forces = _forces(scene, asset, parts)
    settings = Settings(
        dx_m=asset.cell_m,
        frame_time_s=scene.frame_time_s,
        damping_relative_to_rigid=not held.particles.any(),
        cfl=scene.simulation.cfl,
        chunks=_chunks(scene),
        max_substeps_per_frame=scene.simulation.substep_limit,
    )
    stiff = stiff_parts(assembly.body, settings)
    if stiff:
        raise SimulationError(f"Too stiff for the budget: {stiff[0]} (--hold {stiff[0].name}).")
    probe_started = time.perf_counter()
    if preset == "sway" or forces:
        probe = probe_gust(
            assembly.body,
            settings,
            direction_up=_wind_up(scene, asset),
            duration_s=scene.motion.duration_s,
            aim_m=scene.motion.amplitude_rel * asset.height_m,
            damping_ratio=scene.simulation.damping_ratio,
            on_frame=lambda k, n: progress.update(k, n, "frames of the probe"),
        )
        facts.frequency_hz = probe.frequency_hz
        facts.damping_per_s = damping_per_s(scene.simulation.damping_ratio, probe.frequency_hz)
        if preset == "sway":
            wind = _wind_up(scene, asset)
            asked = scene.motion.acceleration_ms2
            strength = probe.acceleration_ms2 if isinstance(asked, str) else asked
            facts.wind_up, facts.gust_ms2, facts.gust_s = wind.tolist(), strength, scene.motion.duration_s
            forces = (*forces, gust(wind, strength, scene.motion.duration_s))
            progress.note(
                f"Gust of {strength:.3g} m/s2 for {scene.motion.duration_s:g} s; swings at "
                f"{probe.frequency_hz:.2g} Hz; held: {held.reason}."
            )
    settings = replace(settings, accelerations=forces, damping_per_s=facts.damping_per_s)
    simulator = Simulator(assembly.body, settings)
    estimate = simulator.estimate()
    probe_s = time.perf_counter() - probe_started
    progress.note(
        f"{int((~held.particles).sum())} moving particles, about {estimate.substeps_per_frame} substeps per frame, "
        f"{scene.frame_count} frames (the probe took {probe_s:.0f} s)."
    )
    animator = Animator(
        asset.gaussians,
        skin(
            asset.gaussians,
            parts.labels,
            continuum,
            frame=asset.frame,
            held_parts=[parts.names.index(name) for name in held.parts],
        ),
        continuum.positions,
    )
    times_s = np.arange(scene.frame_count, dtype=np.float64) * scene.frame_time_s

    def frames() -> Iterator[tuple[NDArray[np.float32], NDArray[np.float32]]]:
        for k in range(scene.frame_count):
            state = simulator.frame if k == 0 else simulator.advance()
            facts.substeps.append(state.substeps)
            facts.dt_s.append(state.dt_s)
            facts.max_speed_ms.append(state.max_speed_ms)
            facts.energy_kinetic_j.append(state.kinetic_energy_j)
            facts.energy_elastic_j.append(state.elastic_energy_j)
            facts.momentum_kgms.append(state.momentum_kgms.tolist())
            positions_m = assembly.true_positions_m(state.positions_m, state.deformation_gradients)
            positions = asset.frame.from_metres(positions_m)
            gradients = asset.frame.tensor_to_input_axes(state.deformation_gradients)
            if k == 0:  # the rest pose is the input, to the bit
                yield asset.gaussians.means, _identities(len(asset.gaussians))
            else:
                yield animator.carry(positions, gradients)
            progress.update(k + 1, scene.frame_count, "frames simulated")

    return Motion(times_s, frames, facts)


def settled_thickness(scene: Scene, asset: Asset, parts: Parts, continuum: Continuum, book: MaterialBook) -> Continuum:
    """The continuum with the thickness that the user gave, else measured, else the material's usual one."""
    surfaces = {number: book.parts[name].surface for number, name in enumerate(parts.names)}
    usual = {number: surface.thickness_m for number, surface in surfaces.items() if surface.thickness_m is not None}
    return with_thickness(continuum, frame=asset.frame, given_m=_given_thickness(scene, parts), library_m=usual)


def _given_thickness(scene: Scene, parts: Parts) -> dict[int, float]:
    """Thickness that the user gave, by part number: of sheets and rods, and of the wall of a vessel."""
    return {
        parts.names.index(name): options.thickness_m
        for name, options in scene.parts.items()
        if options.thickness_m is not None
    }


def _assembled(
    scene: Scene, asset: Asset, parts: Parts, continuum: Continuum, book: MaterialBook, held: Held
) -> Assembly:
    """The body, its thin parts thickened until a frame needs no more than max_substeps."""
    slowest = asset.cell_m * scene.simulation.cfl * scene.simulation.max_substeps / scene.frame_time_s
    # A tenth of the speed is left to the motion itself.
    return assemble_body(
        continuum,
        parts,
        book,
        frame=asset.frame,
        held=held.particles,
        cell_m=asset.cell_m,
        max_wave_speed_ms=0.9 * slowest,
    )


def _chunks(scene: Scene) -> int:
    """Chunks of the solver: as many as threads, unless the scene fixes them."""
    chosen = scene.simulation.chunks
    return numba.get_num_threads() if isinstance(chosen, str) else chosen


def _wind_up(scene: Scene, asset: Asset) -> NDArray[np.float64]:
    """Unit direction of the gust in upright axes; by default to the right in the film."""
    wind = scene.motion.wind
    if isinstance(wind, str):
        return np.array([1.0, 0.0, 0.0])
    direction = asset.frame.rotation @ np.array(wind)
    return direction / np.linalg.norm(direction)


def _forces(scene: Scene, asset: Asset, parts: Parts) -> tuple[Acceleration, ...]:
    found = []
    for force in scene.forces:
        x, y, z = (float(v) for v in asset.frame.rotation @ np.array(force.value_ms2))
        part = None if force.part == ALL_PARTS else parts.names.index(force.part)
        found.append(Acceleration((x, y, z), force.from_s, force.to_s, part=part))
    return tuple(found)


def _part_masses_g(parts: Parts, continuum: Continuum, assembly: Assembly) -> dict[str, float]:
    totals = 1e3 * np.bincount(continuum.part, assembly.mass_kg, parts.count)
    return dict(zip(parts.names, totals.tolist(), strict=True))


def _identities(count: int) -> NDArray[np.float32]:
    return np.tile(np.eye(3, dtype=np.float32), (count, 1, 1))


# ---------------------------------------------------------------------------------------------------------- film


@dataclass(frozen=True, eq=False)
class FilmFrame:
    """One frame as it is rendered and written.

    Attributes:
        index: from 0.
        image: [H, W, 3], uint8.
        means, quats_wxyz, scales, rotations: of all Gaussians; rotations turn the colours.
    """

    index: int
    image: NDArray[np.uint8]
    means: NDArray[np.float32]
    quats_wxyz: NDArray[np.float32]
    scales: NDArray[np.float32]
    rotations: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Film:
    """All frames of the film, made one at a time.

    Attributes:
        fps: of the video.
        times_s: simulated time of each frame, [T].
        cameras: one per frame.
        frames: yields the frames.
    """

    fps: float
    times_s: NDArray[np.float64]
    cameras: list[Camera]
    frames: Callable[[], Iterator[FilmFrame]]


_BACKGROUNDS = {"white": (1.0, 1.0, 1.0), "black": (0.0, 0.0, 0.0), "grey": (0.5, 0.5, 0.5)}


def film(scene: Scene, asset: Asset, motion: Motion, progress: Progress) -> Film:
    """Turn covariances and colours with the motion and render every frame."""
    wanted = scene.output.video
    lower, upper = _swept_box(asset, motion)
    extent = upper - lower
    across = math.hypot(extent[0], extent[1])
    if isinstance(wanted.height, str):
        height = int(np.clip(wanted.width * extent[2] / across * 1.05, 0.6 * wanted.width, 1.25 * wanted.width))
        height += height % 2
    else:
        height = wanted.height
    cameras = video_path(
        len(motion.times_s),
        lower=lower,
        upper=upper,
        rotation=asset.frame.rotation,
        width=wanted.width,
        height=height,
        orbit_deg=wanted.orbit_deg,
        elevation_deg=wanted.elevation_deg,
    )
    gaussians = asset.gaussians

    def frames() -> Iterator[FilmFrame]:
        deformer, tracker, rasteriser = Deformer(gaussians), AxisTracker(gaussians), Rasteriser()
        for k, (positions, gradients) in enumerate(motion.frames()):
            rotations, covariances6 = deformer.deform(gradients)
            quats, scales = tracker.advance(gradients)
            picture = rasteriser.render(
                positions,
                covariances6,
                gaussians.opacities,
                camera=cameras[k],
                sh=gaussians.sh,
                sh_rotations=rotations,
                background=_BACKGROUNDS[wanted.background],
            )
            image = np.rint(np.clip(picture.rgb, 0, 1) * 255).astype(np.uint8)
            yield FilmFrame(k, image, positions, quats, scales, rotations)
            progress.update(k + 1, len(cameras), "frames rendered")

    fps = scene.simulation.fps if isinstance(wanted.fps, str) else wanted.fps
    return Film(fps, motion.times_s, cameras, frames)


def _swept_box(asset: Asset, motion: Motion) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The robust box of everything the object passes through, upright axes, input units."""
    # The haze round a capture would make the object small in the picture.
    solid = np.flatnonzero(asset.gaussians.opacities > 0.3)
    visible = solid if len(solid) > 1000 else np.arange(len(asset.gaussians))
    sample = visible[:: max(1, len(visible) // 20_000)]
    lower, upper = np.full(3, np.inf), np.full(3, -np.inf)
    for positions, _ in motion.frames():
        points = positions[sample].astype(np.float64) @ asset.frame.rotation.T
        low, high = np.percentile(points, [0.2, 99.8], axis=0)
        lower, upper = np.minimum(lower, low), np.maximum(upper, high)
    margin = 0.02 * (upper - lower).max()
    return lower - margin, upper + margin
