"""The particle columns that the kernels work on, made from a body and read back in the body's order."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm.body import Body
from phys4dgen.mpm.kernels.layout import (
    AFFINE,
    DISPLACEMENT_GRADIENT,
    INDEX,
    LAW_COLUMNS,
    MASS,
    PADDED_TO,
    POSITION,
    POSITION_REST,
    VELOCITY,
    VOLUME,
)
from phys4dgen.mpm.laws import NEO_HOOKEAN, Gradient, Law
from phys4dgen.mpm.laws.elastic_strain import strains_of_gradient

__all__ = ["ELASTIC_STRAIN", "REMEMBERED_STRETCH", "STRAIN_INDICES", "Particles"]

ELASTIC_STRAIN = tuple(f"strain_{ij}" for ij in ("xx", "xy", "xz", "yy", "yz", "zz"))
"""State columns of laws that carry b - I."""

STRAIN_INDICES = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))

REMEMBERED_STRETCH = (0.25, 4.0)
"""Least and greatest singular value that the total F of flowing material keeps from frame to frame."""

_SURELY_WITHIN = 0.7  # |F - I| below which no singular value of F is outside


class Particles:
    """Columns of the particles that move: soft ones ordered by law, then rigid ones, each range padded to full batches.

    A range holds the particles of one law and one body (``Body.body_id``).

    Padding are massless copies. Rigid particles are Neo-Hookean with Lame parameters of zero: without stress.

    Attributes:
        laws: the law of each range; of soft and rigid particles apart.
        ranges: first and one past last column place of each law in each chunk, int64 [laws, chunks, 2].
        body_of_range: body 0 .. B - 1 that each range belongs to, int64 [laws].
        soft_ranges: how many ranges are soft; rigid ones follow.
        moving: numbers of the moving particles in the body, int64 [M].
        mass_unit_kg: mean mass of the moving particles.
        columns: see ``kernels.layout``, float32 [columns, stride].
        spare: as ``columns``; a segment reads one and writes the other.
    """

    def __init__(self, body: Body, *, origin_m: NDArray[np.float64], chunks: int) -> None:
        self.moving = np.flatnonzero(~body.held)
        self._origin_m = origin_m
        self.mass_unit_kg = float(body.mass_kg[self.moving].mean())
        laws, places, ranges, bodies, start = [], [], [], [], 0
        assert body.body_id is not None
        names = np.unique(body.body_id[self.moving])
        self.soft_ranges = 0
        for is_rigid in (False, True):
            chosen = self.moving[body.is_rigid[self.moving] == is_rigid]
            of_laws = [(NEO_HOOKEAN, chosen)] if is_rigid and len(chosen) else body.by_law(chosen)
            of_bodies = [(law, name, of_law[body.body_id[of_law] == name]) for law, of_law in of_laws for name in names]
            for law, name, members in of_bodies:
                if len(members) == 0:
                    continue
                batches = -(-len(members) // PADDED_TO)
                padded = np.concatenate([members, np.full(batches * PADDED_TO - len(members), members[-1])])
                bounds = start + PADDED_TO * np.linspace(0, batches, chunks + 1).round().astype(np.int64)
                ranges.append(np.stack([bounds[:-1], bounds[1:]], 1))
                laws.append(law)
                bodies.append(np.searchsorted(names, name))
                places.append(np.stack([padded, np.arange(len(padded)) < len(members)], 1))
                start += len(padded)
                self.soft_ranges += not is_rigid
        self.laws: tuple[Law, ...] = tuple(laws)
        self.ranges = np.stack(ranges)
        self.body_of_range = np.array(bodies, np.int64)
        index, real = np.concatenate(places).T
        self.columns = self._fill(body, index, real.astype(bool))
        self.spare = np.zeros_like(self.columns)

    def _fill(self, body: Body, index: NDArray[np.int64], real: NDArray[np.bool_]) -> NDArray[np.float32]:
        assert body.velocities_ms is not None
        columns = np.zeros((LAW_COLUMNS + max(law.column_count for law in self.laws), len(index)), np.float32)
        position = (body.positions_m[index] - self._origin_m).T
        columns[POSITION : POSITION + 3] = position
        columns[POSITION_REST : POSITION_REST + 3] = position - columns[POSITION : POSITION + 3]
        columns[MASS] = np.where(real, body.mass_kg[index] / self.mass_unit_kg, 0)
        columns[VOLUME] = np.where(real, body.volume_m3[index] / self.mass_unit_kg, 0)
        for law, places in zip(self.laws[: self.soft_ranges], self._places(), strict=False):
            parameters = slice(LAW_COLUMNS, LAW_COLUMNS + len(law.parameters))
            columns[parameters, places] = body.law_columns(law, index[places])
        columns[VELOCITY : VELOCITY + 3] = body.velocities_ms[index].T
        if body.initial_gradients is not None:
            self._strain(columns, body.initial_gradients[index])
        columns[INDEX] = np.where(real, index, ~index).astype(np.int32).view(np.float32)
        return columns

    def _strain(self, columns: NDArray[np.float32], gradients: NDArray[np.float64]) -> None:
        """Set the deformation gradients [n, 3, 3] of soft particles, and the elastic strain that goes with them."""
        strains = gradients @ np.swapaxes(gradients, 1, 2) - np.eye(3)
        for law, places in zip(self.laws[: self.soft_ranges], self._places(), strict=False):
            H = (gradients[places] - np.eye(3)).reshape(-1, 9).T
            columns[DISPLACEMENT_GRADIENT : DISPLACEMENT_GRADIENT + 9, places] = H
            if ELASTIC_STRAIN[0] in law.state:
                first = LAW_COLUMNS + len(law.parameters) + law.state.index(ELASTIC_STRAIN[0])
                for column, (i, j) in enumerate(STRAIN_INDICES, first):
                    columns[column, places] = strains[places, i, j]

    @property
    def body_index(self) -> NDArray[np.int32]:
        """Number in the body of the particle at each place; of padding, its bitwise complement, which is negative."""
        return self.columns[INDEX].view(np.int32)

    @property
    def numbers(self) -> NDArray[np.int64]:
        """Number in the body of the particle at each place, padding as what it copies."""
        index = self.body_index.astype(np.int64)
        return np.where(index < 0, ~index, index)

    def _places(self) -> list[slice]:
        """Where each law's particles stand, padding too."""
        return [slice(int(of_law[0, 0]), int(of_law[-1, 1])) for of_law in self.ranges]

    def soft_states(
        self, *, stiffening_only: bool = False
    ) -> Iterator[tuple[Law, NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]]:
        """Law, numbers in the body, parameter columns [m, n] and state columns [k, n] of soft particles, law by law."""
        index = self.body_index
        for law, places in list(zip(self.laws, self._places(), strict=True))[: self.soft_ranges]:
            if stiffening_only and law.stiffening is None:
                continue
            real = np.arange(places.start, places.stop)[index[places] >= 0]
            columns = self.columns[LAW_COLUMNS:, real].astype(np.float64)
            count = len(law.parameters)
            yield law, index[real].astype(np.int64), columns[:count], columns[count : count + len(law.state)]

    def read(self, first: int, count: int) -> NDArray[np.float32]:
        """Columns ``first`` to ``first + count`` of the moving particles in the body's order, [M, count]."""
        index = self.body_index
        real = np.flatnonzero(index >= 0)
        places = np.zeros(int(self.moving[-1]) + 1, np.int64)
        places[index[real]] = real
        return np.take(self.columns[first : first + count], places[self.moving], axis=1).T

    def positions_m(self) -> NDArray[np.float64]:
        """Positions of the moving particles, metres, [M, 3]."""
        return self.read(POSITION, 3) + self.read(POSITION_REST, 3).astype(np.float64) + self._origin_m

    def velocities_ms(self) -> NDArray[np.float32]:
        """Velocities of the moving particles, [M, 3]."""
        return self.read(VELOCITY, 3)

    def deformation_gradients(self) -> NDArray[np.float32]:
        """F of the moving particles as their laws carry it (``Gradient``), [M, 3, 3]."""
        return self.read(DISPLACEMENT_GRADIENT, 9).reshape(-1, 3, 3) + np.eye(3, dtype=np.float32)

    def limit_stretch(self) -> None:
        """Keep the singular values of F within ``REMEMBERED_STRETCH`` where F does not carry the stress.

        What flows would stretch its F without end; beyond the limits only its directions go on following the flow.
        """
        for law, places in zip(self.laws[: self.soft_ranges], self._places(), strict=False):
            if law.gradient is not Gradient.TOTAL:
                continue
            columns = self.columns[DISPLACEMENT_GRADIENT : DISPLACEMENT_GRADIENT + 9, places]
            far = np.flatnonzero(~(np.square(columns).sum(0) < _SURELY_WITHIN**2))
            F = columns[:, far].T.reshape(-1, 3, 3).astype(np.float64) + np.eye(3)
            broken = ~np.isfinite(F).all((1, 2))
            F[broken] = np.eye(3)
            least, greatest = REMEMBERED_STRETCH
            strains = strains_of_gradient(F)
            changes = broken | (strains < least**2 - 1).any(1) | (strains > greatest**2 - 1).any(1)
            far, F = far[changes], F[changes]
            left, stretch, right = np.linalg.svd(F)
            limited = (left * np.clip(stretch, *REMEMBERED_STRETCH)[:, None, :]) @ right
            columns[:, far] = (limited - np.eye(3)).reshape(-1, 9).T

    def affine_per_s(self) -> NDArray[np.float32]:
        """APIC velocity gradient C of the moving particles, 1/s, [M, 3, 3]."""
        return self.read(AFFINE, 9).reshape(-1, 3, 3)
