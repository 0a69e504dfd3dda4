"""Random scenes from a seed: materials of the whole library, shapes, sizes, grids, forces, obstacles.

A scene is small (some thousand particles, some hundred substeps) but may stand in a grid of 128 cells: what is wide is
thin. Loads begin and end with frames, so that the work that they do can be told from outside (``accounting.py``).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from phys4dgen.materials.library import LibraryEntry, library_entries
from phys4dgen.mpm import (
    Acceleration,
    Attractor,
    Body,
    Drive,
    Ground,
    HalfSpace,
    HollowBall,
    Impulse,
    LawId,
    Motion,
    Noise,
    Obstacle,
    PerParticleForce,
    RoundedBox,
    Settings,
    TotalForce,
    Vortex,
    Wind,
)
from phys4dgen.types import KNOWN_NUMBERS, complete_numbers
from validation.bodies import lattice

__all__ = ["FRAMES", "Scene", "random_scene"]

FRAMES = 12
_SUBSTEPS_PER_FRAME = 40  # aimed at, of the fastest soft part
_MOST_PARTICLES = 2500  # of one part
_LONGEST_FRAME_S = 1 / 24
_G_MS2 = 9.81

Vector = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Scene:
    """What is to be simulated.

    Attributes:
        seed: it was made from.
        title: its materials, loads and solids in one line.
        body, settings: for the simulator.
    """

    seed: int
    title: str
    body: Body
    settings: Settings


def random_scene(seed: int) -> Scene:
    """The scene of a seed, always the same."""
    rng = np.random.default_rng(seed)
    size_m = 10 ** rng.uniform(-2, 1)
    cells = int(rng.integers(24, 129))
    dx_m = size_m / cells
    pieces = [_piece(rng, cells) for _ in range(rng.integers(1, 4))]
    entries = [_material(rng) for _ in pieces]
    body, kinds = _assemble(rng, pieces, entries, dx_m)
    frame_time_s, speed_ms = _pace(body, dx_m)
    body = replace(body, velocities_ms=_start(rng, body, speed_ms))
    settings = Settings(dx_m, frame_time_s, max_substeps_per_frame=4000, max_grid_nodes=8_000_000)
    settings, told = _surroundings(rng, body, settings, speed_ms)
    names = ", ".join(f"{name} ({kind})" for name, kind in zip(body.part_names, kinds, strict=True))
    return Scene(seed, f"{names}; {size_m:.2g} m, {cells} cells; {'; '.join(told) or 'no load'}", body, settings)


def _material(rng: np.random.Generator) -> LibraryEntry:
    entries = list(library_entries().values())
    return entries[int(rng.integers(len(entries)))]


# Shapes: particles in cells and the volume of each in cells.


def _solid(rng: np.random.Generator, cells: int) -> tuple[NDArray[np.float64], float, str]:
    sides = rng.integers(1, 8, 3)
    x = lattice((2 * int(sides[0]), 2 * int(sides[1]), 2 * int(sides[2])), 0.5)
    if rng.random() < 0.4:
        middle = x.mean(0)
        x = x[(((x - middle) / (sides / 2)) ** 2).sum(1) <= 1]
        return x, 1 / 8, "ball"
    return x, 1 / 8, "block"


def _shell(rng: np.random.Generator, cells: int) -> tuple[NDArray[np.float64], float, str]:
    """A hollow ball of two layers of particles."""
    radius, thickness = rng.uniform(2, 5), rng.uniform(0.1, 1.0)
    count = int(4 * np.pi * radius**2 * 4)
    k = np.arange(count) + 0.5
    height, angle = 1 - 2 * k / count, np.pi * (1 + np.sqrt(5)) * k  # Fibonacci's lattice
    across = np.sqrt(1 - height**2)
    unit = np.stack([across * np.cos(angle), across * np.sin(angle), height], 1)
    x = np.concatenate([unit * (radius - thickness / np.sqrt(12)), unit * (radius + thickness / np.sqrt(12))])
    return x, 4 * np.pi * radius**2 * thickness / len(x), "shell"


def _sheet(rng: np.random.Generator, cells: int) -> tuple[NDArray[np.float64], float, str]:
    thickness = rng.uniform(0.1, 1.2)
    a = int(rng.integers(4, min(cells, 60)))
    b = int(np.clip(_MOST_PARTICLES / 8 / a, 2, a))
    x = lattice((2 * a, 2 * b, 2), 0.5)
    x[:, 2] = np.where(x[:, 2] > 0.5, thickness, -thickness) / np.sqrt(12)
    return x, thickness / 8, "sheet"


def _rod(rng: np.random.Generator, cells: int) -> tuple[NDArray[np.float64], float, str]:
    thickness, length = rng.uniform(0.2, 1.5), int(rng.integers(4, cells))
    x = lattice((2 * length, 2, 2), 0.5)
    x[:, 1:] = np.where(x[:, 1:] > 0.5, thickness / 4, -thickness / 4)
    return x, thickness**2 * np.pi / 4 / 8, "rod"


def _crumbs(rng: np.random.Generator, cells: int) -> tuple[NDArray[np.float64], float, str]:
    count = int(rng.integers(1, 25))
    return rng.uniform(0, rng.uniform(2, cells / 2), (count, 3)), 1 / 8 * rng.uniform(0.01, 1), "crumbs"


_SHAPES: tuple[Callable[..., tuple[NDArray[np.float64], float, str]], ...] = (_solid, _shell, _sheet, _rod, _crumbs)


def _piece(rng: np.random.Generator, cells: int) -> tuple[NDArray[np.float64], float, str]:
    """One shape, turned at random and placed within the grid, some with uneven particles."""
    x, volume, kind = _SHAPES[rng.choice(len(_SHAPES), p=(0.4, 0.15, 0.2, 0.15, 0.1))](rng, cells)
    if rng.random() < 0.3:
        x = x + rng.uniform(-0.15, 0.15, x.shape)
    if rng.random() < 0.6:
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        x = (x - x.mean(0)) @ turn.T
    x = x - x.min(0)
    return x + rng.uniform(0, np.maximum(cells - np.ptp(x, axis=0), 1e-6) * rng.choice([0.05, 1.0])), volume, kind


def _assemble(
    rng: np.random.Generator,
    pieces: list[tuple[NDArray[np.float64], float, str]],
    entries: list[LibraryEntry],
    dx_m: float,
) -> tuple[Body, list[str]]:
    """All pieces as one body; stiff materials are rigid, as the product makes them, or held, or softened."""
    x = np.concatenate([piece[0] for piece in pieces]) * dx_m
    counts = [len(piece[0]) for piece in pieces]
    part = np.repeat(np.arange(len(pieces)), counts)
    materials = [entry.material() for entry in entries]
    numbers = {name: np.full(len(x), np.nan) for name in KNOWN_NUMBERS}
    modulus = np.array([material.youngs_modulus_pa for material in materials])
    rigid, held = np.full(len(x), -1, np.int32), np.zeros(len(x), np.bool_)
    kinds = []
    for number, (entry, material) in enumerate(zip(entries, materials, strict=True)):
        for key, value in complete_numbers(material.law, material.extra).items():
            numbers[key][part == number] = value
        fate = rng.random()
        kind = pieces[number][2]
        stiff = entry.rigid_candidate or modulus[number] > 1e8
        if (stiff and fate < 0.6) or fate < 0.05:
            rigid[part == number] = number
            kind = f"rigid {kind}"
        elif fate > 0.93 and len(pieces) > 1 and not held.any():
            held[part == number] = True
            kind = f"held {kind}"
        elif stiff:
            softer = min(1.0, 10 ** rng.uniform(6, 8) / modulus[number])
            modulus[number] *= softer
            for key in ("yield_stress_pa", "residual_yield_stress_pa", "hardening_modulus_pa"):
                numbers[key][part == number] *= softer
        kinds.append(kind)
    body = Body(
        positions_m=x,
        volume_m3=np.repeat([piece[1] for piece in pieces], counts) * dx_m**3,
        density_kgm3=np.repeat([material.density_kgm3 for material in materials], counts),
        youngs_modulus_pa=np.repeat(modulus, counts),
        poisson_ratio=np.repeat([material.poisson_ratio for material in materials], counts),
        law=np.repeat([int(LawId[material.law.upper()]) for material in materials], counts).astype(np.int32),
        part=part.astype(np.int32),
        held=held,
        part_names=tuple(f"{number}_{material.name}" for number, material in enumerate(materials)),
        rigid_group=rigid,
        bonded_to_held=np.full(len(x), rng.random() < 0.5),
        law_numbers=numbers,
    )
    return body, kinds


def _pace(body: Body, dx_m: float) -> tuple[float, float]:
    """Frame time, and a speed that crosses some cells in a scene without breaking the softest part at once."""
    soft = body.is_soft
    if not soft.any():
        return min(_LONGEST_FRAME_S, 0.3 * np.sqrt(dx_m / _G_MS2)), 10 * dx_m
    waves = body.wave_speed_ms[soft]
    frame_time_s = min(_LONGEST_FRAME_S, _SUBSTEPS_PER_FRAME * 0.4 * dx_m / float(waves.max()))
    return frame_time_s, min(0.3 * float(waves.min()), 20 * dx_m / (FRAMES * frame_time_s))


def _direction(rng: np.random.Generator) -> NDArray[np.float64]:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def _vector(values: NDArray[np.float64]) -> Vector:
    return float(values[0]), float(values[1]), float(values[2])


def _start(rng: np.random.Generator, body: Body, speed_ms: float) -> NDArray[np.float64]:
    """Parts at rest, thrown, spinning or shaking."""
    v = np.zeros((len(body), 3))
    for number in range(len(body.part_names)):
        mine = body.part == number
        x = body.positions_m[mine] - body.positions_m[mine].mean(0)
        reach = max(float(np.linalg.norm(x, axis=1).max()), 1e-9)
        v[mine] = rng.choice([0.0, 1.0]) * rng.uniform(0, 1) * speed_ms * _direction(rng)
        if rng.random() < 0.3:
            v[mine] += np.cross(_direction(rng) * speed_ms * rng.uniform(0, 1) / reach, x)
        if rng.random() < 0.1:
            v[mine] += rng.normal(0, 0.2 * speed_ms, x.shape)
    return np.where(body.held[:, None], 0.0, v)


def _surroundings(
    rng: np.random.Generator, body: Body, settings: Settings, speed_ms: float
) -> tuple[Settings, list[str]]:
    """Settings with gravity, loads, ground, obstacles or a drive, and their names."""
    frame_s, dx_m = settings.frame_time_s, settings.dx_m
    low, high = body.positions_m.min(0), body.positions_m.max(0)
    middle, size = (low + high) / 2, float(np.linalg.norm(high - low)) + dx_m
    strength = speed_ms / (FRAMES * frame_s)  # reaches that speed during the scene
    told: list[str] = []
    changes: dict[str, object] = {}
    weight = rng.choice([0.0, _G_MS2, 0.7 * strength])
    if weight > 0:
        changes["gravity_ms2"] = (0.0, 0.0, -float(weight))
        told.append(f"gravity {weight:.2g}")
    if rng.random() < 0.3:
        changes["damping_per_s"] = float(rng.uniform(0, 5) / (FRAMES * frame_s))
        told.append("damped")
    movable = [g for g in range(len(body.part_names)) if not body.held[body.part == g].any()]
    driven = rng.random() < 0.1 and not body.held.any()
    if not driven and rng.random() < 0.7:
        first, last = sorted(rng.choice(FRAMES + 1, 2, replace=False).tolist())
        part = None if rng.random() < 0.5 else int(rng.choice(movable))
        window = {"from_s": first * frame_s, "to_s": last * frame_s, "part": part}
        push = float(rng.uniform(0.2, 1.5)) * strength * FRAMES / (last - first)
        mass = float(body.mass_kg[~body.held if part is None else body.part == part].sum())
        heading = _direction(rng)
        load = [
            lambda: Acceleration(_vector(push * heading), **window),
            lambda: TotalForce(_vector(mass * push * heading), **window),
            lambda: Impulse(_vector(mass * speed_ms * heading), from_s=first * frame_s, part=part),
            lambda: PerParticleForce(_vector(push * heading * float(body.mass_kg.min())), **window),
            lambda: Wind(_vector(speed_ms * heading), drag_per_s=push / speed_ms, **window),
            lambda: Wind(_vector(speed_ms * heading), drag_per_m=push / speed_ms**2, **window),
            lambda: Attractor(_vector(middle), push, size / 2, float(rng.uniform(-1, 1)), **window),
            lambda: Vortex(_vector(middle), _vector(heading), push, size / 2, push / 3, **window),
            lambda: Noise(push, size / 3, 6 * frame_s, int(rng.integers(1000)), **window),
        ][int(rng.integers(9))]()
        changes["loads"] = (load,)
        told.append(type(load).__name__.lower() + ("" if part is None else f" on {body.part_names[part]}"))
    if rng.random() < 0.5:
        free_low = float(body.positions_m[~body.held, 2].min())
        contact = str(rng.choice(["separate", "separate", "slip", "sticky"]))
        height = free_low - float(rng.uniform(0, 3)) * dx_m
        changes["ground"] = Ground(height, contact, float(rng.uniform(0, 1)), float(rng.uniform(0, 0.8)))  # type: ignore[arg-type]
        told.append(f"{contact} ground")
    if driven:
        part = int(rng.choice(movable))
        changes["drives"] = (Drive(part=part, velocity_ms=_vector(speed_ms * _direction(rng)), to_s=8 * frame_s),)
        told.append(f"drive of {body.part_names[part]}")
    elif rng.random() < 0.35:
        obstacle, name = _obstacle(rng, middle, high - low, size, settings, speed_ms)
        changes["obstacles"] = (obstacle,)
        told.append(name)
    return replace(settings, **changes), told  # type: ignore[arg-type]


def _obstacle(
    rng: np.random.Generator,
    middle: NDArray[np.float64],
    extent: NDArray[np.float64],
    size: float,
    settings: Settings,
    speed_ms: float,
) -> tuple[Obstacle, str]:
    """A ball or box that flies into the body, a wall beside it, or a hollow ball around it."""
    dx_m, heading = settings.dx_m, _direction(rng)
    contact = rng.choice(["separate", "separate", "slip", "sticky"])
    how = {"contact": str(contact), "friction": float(rng.uniform(0, 1))}
    kind = rng.integers(4)
    if kind == 0:
        return Obstacle(HollowBall(_vector(middle), 0.5 * size + 2 * dx_m), **how), "hollow ball"  # type: ignore[arg-type]
    if kind == 1:
        away = float(np.abs(heading) @ extent) / 2 + float(rng.uniform(1, 3)) * dx_m
        return Obstacle(HalfSpace(_vector(middle - away * heading), _vector(heading)), **how), "wall"  # type: ignore[arg-type]
    radius = float(rng.uniform(1, 4)) * dx_m
    half = (0.0, 0.0, 0.0) if kind == 2 else _vector(rng.uniform(0.5, 4, 3) * dx_m)
    away = float(np.abs(heading) @ extent) / 2 + radius + max(half) * np.sqrt(3) + 2 * dx_m
    flight = Motion.steady(_vector(-speed_ms * heading), from_s=0.0, to_s=FRAMES * settings.frame_time_s)
    shape = RoundedBox(_vector(middle + away * heading), half, radius)
    return Obstacle(shape, motion=flight, **how), "ball that flies in" if kind == 2 else "box that flies in"  # type: ignore[arg-type]
