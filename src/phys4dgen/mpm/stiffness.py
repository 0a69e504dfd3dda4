"""The stiffness of a body in the shape that it has: from displacements of the grid's nodes to forces on them.

The operator is the engine's own: displacements are read and stresses are scattered by the particle pass that moves the
film, so that what is balanced here is balanced there. Rotations do not count, for displacements are infinitely small.

Displacements are those that particles can pass on (``Stiffness.through_particles``): a node at the rim of a body, with
next to no mass, follows the affine motion of the particles near it. On the nodes themselves the stiffness is all but
singular there.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label, maximum_filter

from phys4dgen.mpm.body import Body
from phys4dgen.mpm.changes import changed_body
from phys4dgen.mpm.coarse_stiffness import CoarseStiffness
from phys4dgen.mpm.contacts import Entries, ground_nodes
from phys4dgen.mpm.drives import DrivenNodes
from phys4dgen.mpm.grid import Grid
from phys4dgen.mpm.ground import origin_and_ground_node
from phys4dgen.mpm.held import HeldNodes, with_simulated_skin
from phys4dgen.mpm.kernels.compiled_pass import address_of_pass
from phys4dgen.mpm.kernels.contact import STICKY
from phys4dgen.mpm.kernels.layout import (
    AFFINE,
    FUSED,
    GATHER_ONLY,
    LAW_COLUMNS,
    MASS,
    POSITION,
    SCATTER_ONLY,
    VELOCITY,
    VOLUME,
)
from phys4dgen.mpm.kernels.sorting import NEVER_SEEN, inspect_particles, order_by_cell
from phys4dgen.mpm.kernels.stiffness import put_on_grid, strain_and_scatter, take_from_grid
from phys4dgen.mpm.laws import LAWS, NEO_HOOKEAN, LawId
from phys4dgen.mpm.settings import Settings
from phys4dgen.mpm.state import Particles
from phys4dgen.mpm.velocity_fields import VelocityFields

__all__ = ["Stiffness"]

_SMALL = 1e-14
"""Displacements are taken so many times smaller: a particle then moves by less than float32 can tell."""

_LEAST_MASS = 1e-12  # as in the grid pass: lighter nodes carry no velocity
_STIFF_POISSON_RATIO = 0.3


class Stiffness:
    """The stiffness of all of a body that hangs together with something that holds it.

    Vectors are of the nodes that its particles touch, [n, 3], zero where something holds them.

    Attributes:
        body: as simulated at t = 0, the skin of held parts moving.
        carried: particles of it whose stress counts, [P]: soft ones with a law that bears weight without end, that
            hang on something held, driven or glued to the ground. Without any there is nothing to ask for.
        hanging_share: of the mass of all that moves and keeps its shape, which hangs on nothing.
    """

    def __init__(self, body: Body, settings: Settings) -> None:
        """Prepare; raises what ``Simulator`` raises for a body that starts below its ground."""
        dx_m = self._dx_m = settings.dx_m
        self._inverse_dx = np.float32(1) / np.float32(dx_m)
        origin_m, ground_node = origin_and_ground_node(body, settings)
        places = (body.positions_m - origin_m) / dx_m
        held = HeldNodes.from_body(body, places, dx_m=dx_m, friction=settings.held_friction)
        self.body = changed_body(with_simulated_skin(body, held, places), settings.changes, 0.0)
        bears = np.isin(self.body.law, [int(law_id) for law_id, law in LAWS.items() if law.stretches is not None])
        self._particles = particles = Particles(
            _all_elastic(self.body, bears), origin_m=origin_m, chunks=settings.chunks
        )
        cells, extent = self._sort()
        fields = VelocityFields(particles.body_of_range)
        fields.assign(cells, particles.ranges)
        self._grid = grid = Grid(
            extent, chunks=settings.chunks, padding=settings.padding_cells, held=held, fields=fields.count
        )
        _, self._bounds = grid.chunk_limits(cells, particles.ranges, extent, fields.of_range)
        self._planes = fields.of_range * grid.nodes[0]
        self._passes = np.array([address_of_pass(law) for law in particles.laws])

        still = [_glued_to_ground(settings, ground_node, grid)]
        still += _driven(body, particles, fields, settings, grid, origin_m)
        is_free = _free_nodes(grid, still)
        numbers = particles.numbers
        field_of = fields.of_particles(particles.ranges)
        body_id, rigid_group = self.body.body_id, self.body.rigid_group
        assert body_id is not None and rigid_group is not None
        rigid_group = np.where(self.body.is_rigid, rigid_group, -1)
        counts = (bears | self.body.is_rigid)[numbers]
        hangs = counts.copy()
        if counts.any():
            own = numbers[counts]
            lowest = cells[:, counts].T - grid.shift
            hangs[counts] = _hangs_on_something(lowest, field_of[counts], body_id[own], rigid_group[own], is_free)
        mass = particles.columns[MASS].copy()
        whole = float(mass[counts].sum())
        self.hanging_share = float(mass[counts & ~hangs].sum()) / whole if whole > 0 else 0.0
        in_body = np.zeros(len(body), np.bool_)
        in_body[numbers[hangs]] = True
        self.carried = in_body & bears & self.body.is_soft
        if self.carried.any():
            self._prepare_columns(mass, hangs, is_free, field_of)

    def _sort(self) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
        """Put the particles in the order of their cells; their lowest nodes [3, stride] and what these span."""
        particles = self._particles
        stride = particles.columns.shape[1]
        unseen = np.full((3, stride), NEVER_SEEN, np.int32)
        cells, extent = unseen.copy(), np.zeros(6, np.int64)
        inspect_particles(particles.columns, unseen, self._inverse_dx, cells, extent)
        counts = np.zeros(int(np.prod(extent[1::2] - extent[0::2] + 1)) + 1, np.int32)
        order = np.zeros(stride, np.int32)
        for of_law in particles.ranges:
            order_by_cell(cells, extent, of_law[0, 0], of_law[-1, 1], counts, order)
        particles.columns = np.ascontiguousarray(particles.columns[:, order])
        return cells[:, order], extent

    def _prepare_columns(
        self,
        mass: NDArray[np.float32],
        hangs: NDArray[np.bool_],
        is_free: NDArray[np.bool_],
        field_of: NDArray[np.int32],
    ) -> None:
        """One copy of the particles has stress without mass, one has mass without stress."""
        columns = self._particles.columns
        columns[VELOCITY : VELOCITY + 3], columns[AFFINE : AFFINE + 9] = 0, 0
        columns[VOLUME] *= hangs
        columns[MASS] = mass * hangs
        node_count = is_free.size
        self._places = 4 * np.arange(node_count)
        everywhere = np.ones(node_count)
        self._run(columns, SCATTER_ONLY)
        weighing = self._taken(everywhere)[:, 3]
        # masses are free in a static problem: with these waves are equally fast everywhere
        smooth = columns.copy()
        mu, lam = columns[LAW_COLUMNS : LAW_COLUMNS + 2]
        smooth[MASS] = columns[VOLUME] * (lam + 2 * mu)
        stiffest = max(float(smooth[MASS].max()), 1e-30)
        smooth[MASS] /= stiffest
        smooth[VOLUME] = 0
        self._run(smooth, SCATTER_ONLY)
        inertia = self._taken(everywhere)[:, 3]
        columns[MASS] = 0
        self._smooth = smooth
        used = np.flatnonzero(inertia > 0)
        self._places = 4 * used
        self._free = (is_free.ravel()[used] & (inertia[used] > _LEAST_MASS)).astype(np.float64)
        self._inverse_inertia = self._free / np.maximum(inertia[used], _LEAST_MASS)
        self._mass = weighing[used]
        self._per_force = self._dx_m**2 / (4 * stiffest)
        places = columns[POSITION : POSITION + 3].T.astype(np.float64) / self._dx_m - self._grid.shift
        moduli = np.stack([lam, mu]).astype(np.float64) * columns[VOLUME]
        self._coarse = CoarseStiffness(used, is_free, places, field_of, moduli, self._dx_m)

    def _run(self, columns: NDArray[np.float32], stage: int) -> None:
        grid, ranges = self._grid, self._particles.ranges
        strain_and_scatter(
            self._passes,
            stage,
            columns,
            ranges,
            self._planes,
            grid.velocity,
            grid.momentum,
            grid.numbers,
            self._bounds,
            self._inverse_dx,
            np.zeros((0, 4), np.float32),
            LAW_COLUMNS + len(NEO_HOOKEAN.parameters),
        )

    def _taken(self, factors: NDArray[np.float64]) -> NDArray[np.float64]:
        sums = np.zeros((len(self._places), 4))
        take_from_grid(self._grid.momentum, self._places, factors, sums)
        return sums

    def weight(self, gravity_ms2: tuple[float, float, float]) -> NDArray[np.float64]:
        """The weight at each node, [n, 3]."""
        return (self._mass * self._free)[:, None] * (_SMALL * np.array(gravity_ms2))

    def forces(self, displacements: NDArray[np.float64]) -> NDArray[np.float64]:
        """What holds the nodes at displacements [n, 3]: K u, [n, 3]."""
        put_on_grid(displacements, self._free, self._places, self._grid.velocity)
        self._run(self._particles.columns, FUSED)
        return self._taken(-self._free)[:, :3]

    def through_particles(self, forces: NDArray[np.float64]) -> NDArray[np.float64]:
        """The motion that forces [n, 3] begin, as particles take it up and give it back, [n, 3].

        With masses for which waves are equally fast everywhere; symmetric and positive, so a preconditioner.
        """
        put_on_grid(forces, self._inverse_inertia, self._places, self._grid.velocity)
        self._run(self._smooth, FUSED)
        return self._per_force * self._taken(self._inverse_inertia)[:, :3] + self._coarse.answer(forces)

    def particles_at(self, displacements: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Displacement [P, 3] in metres and strain [P, 3, 3] of all particles; zero where they are not carried."""
        put_on_grid(displacements, self._free, self._places, self._grid.velocity)
        self._run(self._particles.columns, GATHER_ONLY)
        moved, strains = np.zeros((len(self.body), 3)), np.zeros((len(self.body), 3, 3))
        moving, mine = self._particles.moving, self.carried[self._particles.moving]
        moved[moving[mine]] = self._particles.velocities_ms()[mine] / _SMALL
        gradients = self._particles.affine_per_s()[mine].astype(np.float64) / _SMALL
        strains[moving[mine]] = (gradients + np.swapaxes(gradients, 1, 2)) / 2
        return moved, strains


def _all_elastic(body: Body, bears: NDArray[np.bool_]) -> Body:
    """The same body of Neo-Hookean matter, what is rigid as stiff as the stiffest of the rest."""
    soft = body.is_soft & bears
    modulus, poisson = body.youngs_modulus_pa.copy(), body.poisson_ratio.copy()
    modulus[body.is_rigid] = modulus[soft].max(initial=1.0)
    poisson[body.is_rigid] = _STIFF_POISSON_RATIO
    return replace(
        body,
        law=np.full(len(body), int(LawId.NEO_HOOKEAN), np.int32),
        youngs_modulus_pa=modulus,
        poisson_ratio=poisson,
        law_numbers={},
        rigid_group=None,
    )


def _glued_to_ground(settings: Settings, ground_node: int, grid: Grid) -> Entries:
    """The nodes of a ground that lets nothing go."""
    none = np.zeros((0, 3), np.int64), np.zeros((0, 4), np.int32), np.zeros((0, 7), np.float32)
    if settings.ground is None or settings.ground.contact != "sticky":
        return none
    return ground_nodes(ground_node, STICKY, 0.0, -1, shift=grid.shift, nodes=grid.nodes)


def _driven(
    body: Body,
    particles: Particles,
    fields: VelocityFields,
    settings: Settings,
    grid: Grid,
    origin_m: NDArray[np.float64],
) -> list[Entries]:
    """The nodes of what is told where to be at t = 0, as pins are."""
    driven = DrivenNodes(body, settings.drives, origin_m=origin_m, dx_m=settings.dx_m)
    return driven.entries(
        particles.columns,
        particles.numbers,
        fields.of_particles(particles.ranges),
        from_s=0.0,
        to_s=0.0,
        solids=lambda points_m: [],
        shift=grid.shift,
        nodes=grid.nodes,
    )


def _free_nodes(grid: Grid, still: list[Entries]) -> NDArray[np.bool_]:
    """Whether each node of each field may move, [fields, nx, ny, nz]."""
    count = int(np.prod(grid.nodes))
    free = np.tile((grid.free[:count] > 0).reshape(grid.nodes), (grid.fields, 1, 1, 1))
    for places, kinds, _ in still:
        x, y, z = (places - grid.shift).T
        for field in range(grid.fields):
            mine = (kinds[:, 3] < 0) | (kinds[:, 3] == field)
            free[field, x[mine], y[mine], z[mine]] = False
    return free


def _hangs_on_something(
    lowest: NDArray[Any],
    field: NDArray[np.int32],
    body_id: NDArray[np.int32],
    rigid_group: NDArray[np.int32],
    is_free: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Which of K particles hang together, node by node, with a node that is not free.

    Args:
        lowest: lowest nodes of the particles, [K, 3].
        field: velocity field of each, [K].
        body_id: bodies that touch do not hang together, [K].
        rigid_group: -1 for soft particles, [K].
        is_free: nodes of all fields, [fields, nx, ny, nz].
    """
    touches = np.zeros(len(lowest), np.bool_)
    for offset in product(range(3), repeat=3):
        x, y, z = (lowest + np.array(offset)).T
        touches |= ~is_free[field, x, y, z]
    piece, count = np.zeros(len(lowest), np.int64), 0
    for name in np.unique(body_id):
        mine = body_id == name
        # on a lattice twice as fine, blocks of three nodes meet only where they share one
        at = 2 * (lowest[mine] - lowest[mine].min(0)) + 2
        middles = np.zeros(at.max(0) + 3, np.bool_)
        middles[tuple(at.T)] = True
        blocks: Any = maximum_filter(middles, 5, mode="constant")
        labelled: Any = label(blocks, np.ones((3, 3, 3)))
        piece[mine] = count + labelled[0][tuple(at.T)] - 1
        count = int(piece[mine].max()) + 1
    hangs = np.zeros(count, np.bool_)
    hangs[piece[touches]] = True
    while True:  # a rigid group hangs with all of its pieces
        groups = np.unique(rigid_group[(rigid_group >= 0) & hangs[piece]])
        before = hangs.copy()
        hangs[piece[np.isin(rigid_group, groups)]] = True
        if (hangs == before).all():
            return hangs[piece]
