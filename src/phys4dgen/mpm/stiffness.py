"""The stiffness of a body in the shape that it has: from displacements of the grid's nodes to forces on them.

The operator is the engine's own particle pass for infinitely small displacements, so that what is balanced here is
balanced there; but strands of matter that only come close to each other have nodes of their own (``strands``).
Rotations do not count.

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
from phys4dgen.mpm.kernels.contact import STICKY
from phys4dgen.mpm.kernels.layout import MASS
from phys4dgen.mpm.kernels.sorting import NEVER_SEEN, inspect_particles, order_by_cell
from phys4dgen.mpm.kernels.stiffness import to_nodes, to_particles
from phys4dgen.mpm.laws import LAWS, LawId
from phys4dgen.mpm.settings import Settings
from phys4dgen.mpm.state import Particles
from phys4dgen.mpm.strands import Strands
from phys4dgen.mpm.velocity_fields import VelocityFields

__all__ = ["Stiffness"]

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
        origin_m, ground_node = origin_and_ground_node(body, settings)
        self._origin_m = origin_m
        places = (body.positions_m - origin_m) / dx_m
        held = HeldNodes.from_body(body, places, dx_m=dx_m, friction=settings.held_friction)
        self.body = changed_body(with_simulated_skin(body, held, places), settings.changes, 0.0)
        bears = np.isin(self.body.law, [int(law_id) for law_id, law in LAWS.items() if law.stretches is not None])
        self._elastic = _all_elastic(self.body, bears)
        self._particles = particles = Particles(self._elastic, origin_m=origin_m, chunks=settings.chunks)
        cells, extent = self._sort()
        fields = VelocityFields(particles.body_of_range)
        fields.assign(cells, particles.ranges)
        self._grid = grid = Grid(
            extent, chunks=settings.chunks, padding=settings.padding_cells, held=held, fields=fields.count
        )

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
        mass = particles.columns[MASS]
        whole = float(mass[counts].sum())
        self.hanging_share = float(mass[counts & ~hangs].sum()) / whole if whole > 0 else 0.0
        in_body = np.zeros(len(body), np.bool_)
        in_body[numbers[hangs]] = True
        self.carried = in_body & bears & self.body.is_soft
        if self.carried.any():
            self._prepare(cells, hangs, is_free, field_of)

    def _sort(self) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
        """Put the particles in the order of their cells; their lowest nodes [3, stride] and what these span."""
        particles = self._particles
        stride = particles.columns.shape[1]
        unseen = np.full((3, stride), NEVER_SEEN, np.int32)
        cells, extent = unseen.copy(), np.zeros(6, np.int64)
        inspect_particles(particles.columns, unseen, np.float32(1) / np.float32(self._dx_m), cells, extent)
        counts = np.zeros(int(np.prod(extent[1::2] - extent[0::2] + 1)) + 1, np.int32)
        order = np.zeros(stride, np.int32)
        for of_law in particles.ranges:
            order_by_cell(cells, extent, of_law[0, 0], of_law[-1, 1], counts, order)
        particles.columns = np.ascontiguousarray(particles.columns[:, order])
        return cells[:, order], extent

    def _prepare(
        self, cells: NDArray[np.int32], hangs: NDArray[np.bool_], is_free: NDArray[np.bool_], field: NDArray[np.int32]
    ) -> None:
        """List the nodes of all particles that hang on something, and what these bring to them.

        Args:
            cells: lowest node of each column of the particles, int32 [3, stride].
            hangs: columns that count.
            is_free: nodes of all fields.
            field: of each column.
        """
        particles, grid, dx_m = self._particles, self._grid, self._dx_m
        columns = np.flatnonzero(hangs & (particles.body_index >= 0))
        own = self._own = particles.numbers[columns]
        lowest = cells[:, columns].T.astype(np.int64) - grid.shift
        places = (self.body.positions_m[own] - self._origin_m) / dx_m - grid.shift
        self._offsets = places - lowest - 1
        self._weights = np.stack(
            [0.5 * (0.5 - self._offsets) ** 2, 0.75 - self._offsets**2, 0.5 * (0.5 + self._offsets) ** 2], 1
        )
        around = lowest[:, None] + np.array(list(product(range(3), repeat=3)))
        nodes = np.ravel_multi_index((field[columns][:, None], *np.moveaxis(around, 2, 0)), is_free.shape)
        self._strands = strands = Strands(nodes, places, is_free.ravel())
        elastic = self._elastic
        volume_m3 = elastic.volume_m3[own]
        lame = np.stack([elastic.lame_lambda_pa[own], elastic.lame_mu_pa[own]], 1) * volume_m3[:, None]
        # masses are free in a static problem: with these waves are equally fast everywhere
        inertia = lame @ np.array([1.0, 2.0])
        stiffest = max(float(inertia.max()), 1e-300)
        nothing = np.zeros_like(inertia)
        self._elasticity = nothing, lame
        self._inertia = inertia / stiffest, np.zeros_like(lame)
        self._reading = np.ones_like(nothing), np.zeros_like(lame)
        self._carried = np.zeros((len(own), 12))
        self._mass_kg = self._to_nodes(self.body.mass_kg[own])
        inertia = self._to_nodes(inertia / stiffest)
        self._free = (is_free.ravel()[strands.node] & (inertia > _LEAST_MASS)).astype(np.float64)
        self._inverse_inertia = self._free / np.maximum(inertia, _LEAST_MASS)
        self._per_force = dx_m**2 / (4 * stiffest)
        self._coarse = CoarseStiffness(strands.node, is_free, places, field[columns], lame.T.copy(), dx_m)

    def _to_nodes(self, amounts: NDArray[np.float64]) -> NDArray[np.float64]:
        """What particles give of their amounts [K] to the nodes, [n]."""
        self._carried[:] = 0
        self._carried[:, 0] = amounts
        return self._collected()[:, 0]

    def _collected(self) -> NDArray[np.float64]:
        result = np.zeros((len(self._strands.node), 3))
        to_nodes(self._carried, self._strands.copies, self._weights, self._offsets, result)
        return result

    def _read(
        self, values: NDArray[np.float64], kind: tuple[NDArray[np.float64], NDArray[np.float64]]
    ) -> NDArray[np.float64]:
        mass, lame = kind
        to_particles(
            values, self._strands.copies, self._weights, self._offsets, mass, lame, 1 / self._dx_m, self._carried
        )
        return self._carried

    def weight(self, gravity_ms2: tuple[float, float, float]) -> NDArray[np.float64]:
        """The weight at each node, N, [n, 3]."""
        return (self._mass_kg * self._free)[:, None] * np.array(gravity_ms2)

    def forces(self, displacements: NDArray[np.float64]) -> NDArray[np.float64]:
        """What holds the nodes at displacements [n, 3] in metres: K u, N, [n, 3]."""
        self._read(displacements * self._free[:, None], self._elasticity)
        return self._free[:, None] * self._collected()

    def through_particles(self, forces: NDArray[np.float64]) -> NDArray[np.float64]:
        """The motion that forces [n, 3] begin, as particles take it up and give it back, [n, 3].

        With masses for which waves are equally fast everywhere; symmetric and positive, so a preconditioner.
        """
        self._read(forces * self._inverse_inertia[:, None], self._inertia)
        answer = self._inverse_inertia[:, None] * self._collected()
        return self._per_force * answer + self._coarse.answer(forces)

    def particles_at(self, displacements: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Displacement [P, 3] in metres and strain [P, 3, 3] of all particles; zero where they are not carried."""
        read = self._read(displacements * self._free[:, None], self._reading)
        mine = self.carried[self._own]
        moved, strains = np.zeros((len(self.body), 3)), np.zeros((len(self.body), 3, 3))
        moved[self._own[mine]] = read[mine, :3]
        gradients = read[mine, 3:].reshape(-1, 3, 3) / self._dx_m
        strains[self._own[mine]] = (gradients + np.swapaxes(gradients, 1, 2)) / 2
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
