"""What may not cross from one body to another: joints, clamps, skin, and who is held by itself.

A body is one of several objects, or a part that the scene calls separate. Bodies that touch share the grid and nothing
else. Where nothing is apart, there is one body.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.animate import Skin, skin
from phys4dgen.joints import bonded_to_held, rigid_bodies
from phys4dgen.motion import Held, choose_held
from phys4dgen.scene import Scene, object_of, options_by_part
from phys4dgen.stages.asset import Asset
from phys4dgen.types import Continuum, Parts

__all__ = [
    "Apart",
    "bodies_apart",
    "body_numbers",
    "bonded_by_body",
    "held_by_body",
    "parts_apart",
    "rigid_by_body",
    "skin_by_body",
    "starting_velocities",
]


@dataclass(frozen=True, eq=False)
class Apart:
    """One body among several.

    Attributes:
        name: of its object, empty where there is one alone, or of the separate part.
        is_separate: it is a separate part.
        numbers: of its parts, ascending.
        particles: those that are its own, [P], bool.
    """

    name: str
    is_separate: bool
    numbers: NDArray[np.intp]
    particles: NDArray[np.bool_]


def parts_apart(scene: Scene, parts: Parts) -> dict[tuple[str, bool], NDArray[np.intp]]:
    """Numbers of the parts that hang together, by name of their object, or of the separate part and that it is one."""
    options = options_by_part(scene, parts.names)
    owners = [
        (name, True)
        if name in options and options[name].separate
        else (object_of(name) if scene.objects else "", False)
        for name in parts.names
    ]
    return {body: np.flatnonzero([owner == body for owner in owners]) for body in dict.fromkeys(owners)}


def bodies_apart(scene: Scene, parts: Parts, continuum: Continuum) -> tuple[Apart, ...]:
    """The bodies that there are, in the order of their parts."""
    return tuple(
        Apart(name, is_separate, numbers, np.isin(continuum.part, numbers))
        for (name, is_separate), numbers in parts_apart(scene, parts).items()
    )


def body_numbers(scene: Scene, parts: Parts, continuum: Continuum) -> NDArray[np.int32]:
    """Number of the body that each particle belongs to, [P]: bodies touch and do not weld."""
    numbers = np.zeros(len(continuum), np.int32)
    for number, own in enumerate(bodies_apart(scene, parts, continuum)):
        numbers[own.particles] = number
    return numbers


def held_by_body(
    scene: Scene,
    asset: Asset,
    parts: Parts,
    continuum: Continuum,
    *,
    holds: Mapping[str, str],
    automatic: bool,
    lowest_share: float,
) -> Held:
    """``choose_held`` for each body by itself; of separate parts only what the user names is held."""
    particles = np.zeros(len(continuum), np.bool_)
    names: list[str] = []
    reasons: dict[str, str] = {}
    for own in bodies_apart(scene, parts, continuum):
        mine = np.isin(parts.labels, own.numbers)
        labels = np.searchsorted(own.numbers, parts.labels[mine]).astype(np.int32)
        own_parts = Parts(labels, tuple(parts.names[number] for number in own.numbers), parts.backend)
        points = continuum.subset(own.particles)
        points = replace(points, part=np.searchsorted(own.numbers, points.part).astype(np.int32))
        held = choose_held(
            points,
            own_parts,
            frame=asset.frame,
            holds={name: hold for name, hold in holds.items() if name in own_parts.names},
            automatic=automatic and not own.is_separate,
            lowest_share=lowest_share,
        )
        particles[own.particles] = held.particles
        names += held.parts
        reasons[own.name] = held.reason
    if len(set(reasons.values())) == 1:
        return Held(particles, tuple(names), next(iter(reasons.values())))
    return Held(particles, tuple(names), "; ".join(f"{name}: {reason}" for name, reason in reasons.items()))


def rigid_by_body(
    scene: Scene, asset: Asset, parts: Parts, continuum: Continuum, *, rigid_parts: list[int], held: NDArray[np.bool_]
) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """``rigid_bodies`` for each body by itself: two that touch are never one body, nor held by one another."""
    rest_m = asset.frame.to_metres(continuum.positions)
    body, stuck = np.full(len(continuum), -1, np.int32), np.zeros(len(continuum), np.bool_)
    for own in bodies_apart(scene, parts, continuum):
        mine = own.particles
        bodies, stuck[mine] = rigid_bodies(
            rest_m[mine], continuum.part[mine], rigid_parts=rigid_parts, held=held[mine], cell_m=asset.cell_m
        )
        body[mine] = np.where(bodies < 0, -1, bodies + body.max() + 1)
    return body, stuck


def bonded_by_body(
    scene: Scene, asset: Asset, parts: Parts, continuum: Continuum, *, held: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """``bonded_to_held`` for each body by itself; what is near another body's held matter only touches it."""
    rest_m = asset.frame.to_metres(continuum.positions)
    pieces = np.stack([continuum.part, continuum.piece], 1)
    piece = np.unique(pieces, axis=0, return_inverse=True)[1].reshape(-1)
    bonded = np.ones(len(continuum), np.bool_)
    for own in bodies_apart(scene, parts, continuum):
        mine = own.particles
        anything_held = bool(held[mine].any()) or not held.any()
        bonded[mine] = anything_held
        if anything_held:
            bonded[mine] = bonded_to_held(rest_m[mine], held[mine], piece=piece[mine], cell_m=asset.cell_m)
    return bonded


def skin_by_body(scene: Scene, asset: Asset, parts: Parts, continuum: Continuum, *, held_parts: list[int]) -> Skin:
    """``skin`` for each body by itself, so that none carries Gaussians of another."""
    bodies = bodies_apart(scene, parts, continuum)
    if len(bodies) == 1:
        return skin(asset.gaussians, parts.labels, continuum, frame=asset.frame, held_parts=held_parts)
    joined: dict[str, NDArray[Any]] = {}
    for own in bodies:
        rows, members = np.flatnonzero(np.isin(parts.labels, own.numbers)), np.flatnonzero(own.particles)
        points = continuum.subset(own.particles)
        itself = np.where(points.gaussian_index < 0, -1, np.searchsorted(rows, points.gaussian_index))
        points = replace(points, gaussian_index=itself)
        found = skin(asset.gaussians.subset(rows), parts.labels[rows], points, frame=asset.frame, held_parts=held_parts)
        for entry in fields(Skin):
            values = getattr(found, entry.name)
            whole = joined.setdefault(entry.name, np.zeros((len(asset.gaussians), *values.shape[1:]), values.dtype))
            whole[rows] = members[values] if entry.name == "particles" else values
    return Skin(**joined)


def starting_velocities(
    scene: Scene, asset: Asset, parts: Parts, continuum: Continuum, *, mass_kg: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Velocity with which each particle starts, metres per second, z up, [P, 3]."""
    rest_m = asset.frame.to_metres(continuum.positions)
    velocities = np.zeros((len(continuum), 3))
    owner = np.array([object_of(name) for name in parts.names])[continuum.part]
    for name, placed in scene.objects.items():
        mine = owner == name
        center = np.average(rest_m[mine], axis=0, weights=mass_kg[mine])
        spin = np.array([math.radians(value) for value in placed.spin_deg_s])
        velocities[mine] = np.array(placed.velocity_ms) + np.cross(spin, rest_m[mine] - center)
    return velocities
