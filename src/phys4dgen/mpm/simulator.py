"""The simulator: a body and settings in, one frame after the other out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import SimulationError
from phys4dgen.mpm import diagnostics
from phys4dgen.mpm.body import Body
from phys4dgen.mpm.changes import carry_over, changed_body, check_changes
from phys4dgen.mpm.contacts import CONTACT_KINDS, GROUND_GAP_CELLS
from phys4dgen.mpm.drives import DrivenNodes
from phys4dgen.mpm.forces import Kicks
from phys4dgen.mpm.grid import Grid
from phys4dgen.mpm.held import HeldNodes, with_simulated_skin
from phys4dgen.mpm.kernels.compiled_pass import address_of_pass
from phys4dgen.mpm.kernels.layout import AFFINE, LOAD, MASS, POSITION, VELOCITY
from phys4dgen.mpm.kernels.rigid_pass import place_rigid
from phys4dgen.mpm.kernels.shares import node_masses
from phys4dgen.mpm.kernels.sorting import NEVER_SEEN, inspect_particles, order_by_cell
from phys4dgen.mpm.laws import LawId
from phys4dgen.mpm.rigid import RigidParts
from phys4dgen.mpm.settings import Settings
from phys4dgen.mpm.solids import Solids
from phys4dgen.mpm.state import Particles
from phys4dgen.mpm.step import advance
from phys4dgen.mpm.timestep import Estimate, expected_speed_ms, sort_interval, stiff_parts, substeps_for
from phys4dgen.mpm.velocity_fields import VelocityFields, no_pairs

__all__ = ["Frame", "Simulator"]

_STIFFENED = 1.05  # waves faster by more than this shorten the rest of the frame's substeps
_SHEARED_PER_CELL = 12.0  # see ``Simulator._wet_contacts``
_SAFE_CFL = 0.6  # stable in every run of the benchmarks
_GROWTH_CELLS = 4  # beyond the padding, so that a moving body does not lay a new grid at every sort


@dataclass(frozen=True, eq=False)
class Frame:
    """The body at one time; held particles stand in their rest pose with F = I.

    Attributes:
        time_s: simulated time.
        positions_m: shape [P, 3], float64.
        deformation_gradients: total F, shape [P, 3, 3], float32; of material that flows within limits
            (``state.REMEMBERED_STRETCH``).
        velocities_ms: shape [P, 3], float32.
        substeps: taken since the last frame.
        dt_s: their length, at the end of the frame.
        max_speed_ms: of the fastest particle.
        kinetic_energy_j, elastic_energy_j: of all that moves.
        momentum_kgms, angular_momentum_kgm2s: of all that moves, the latter about the coordinate origin, [3].
        reactions_n: mean force of the body on each obstacle since the last frame, then on the ground if there is one,
            [O or O + 1, 3].
        obstacle_shifts_m: how far each obstacle has moved, [O, 3].
    """

    time_s: float
    positions_m: NDArray[np.float64]
    deformation_gradients: NDArray[np.float32]
    velocities_ms: NDArray[np.float32]
    substeps: int
    dt_s: float
    max_speed_ms: float
    kinetic_energy_j: float
    elastic_energy_j: float
    momentum_kgms: NDArray[np.float64]
    angular_momentum_kgm2s: NDArray[np.float64]
    reactions_n: NDArray[np.float64]
    obstacle_shifts_m: NDArray[np.float64]


class Simulator:
    """Advances a body frame by frame.

    Attributes:
        body, settings: as given.
        frame: the last frame that succeeded; at first the rest pose at t = 0.
    """

    def __init__(self, body: Body, settings: Settings) -> None:
        """Prepare; raises SimulationError where the body cannot be simulated with these settings."""
        if body.held.all():
            raise SimulationError("Nothing can move: all particles are held; hold fewer parts.")
        check_changes(body, settings.changes)
        too_stiff = [
            *stiff_parts(body, settings),
            *stiff_parts(changed_body(body, settings.changes, math.inf), settings),
        ]
        if too_stiff:
            raise SimulationError(f"The time step gets too small: {too_stiff[0]}.")
        self.body = body
        self.settings = settings
        self._dx = np.float32(settings.dx_m)
        self._origin_m = body.positions_m.min(0)
        self._ground_node = self._align_with_ground()
        places = (body.positions_m - self._origin_m) / settings.dx_m
        self._held = HeldNodes.from_body(body, places, dx_m=settings.dx_m, friction=settings.held_friction)
        self._at_first = with_simulated_skin(body, self._held, places)
        self._simulated = changed_body(self._at_first, settings.changes, 0.0)
        self._particles = Particles(self._simulated, origin_m=self._origin_m, chunks=settings.chunks)
        self._kicks = Kicks(body, gravity_ms2=settings.gravity_ms2, loads=settings.loads, origin_m=self._origin_m)
        self._driven = DrivenNodes(body, settings.drives, origin_m=self._origin_m, dx_m=settings.dx_m)
        self._solids = Solids(settings, origin_m=self._origin_m, mass_unit_kg=self._particles.mass_unit_kg)
        self._prepare_laws()
        self._rigid = RigidParts.from_body(
            body,
            origin_m=self._origin_m,
            mass_unit_kg=self._particles.mass_unit_kg,
            dx_m=settings.dx_m,
            obstacle_count=self._solids.count,
        )
        if self._rigid is not None:
            rigid = self._rigid
            for first, last in self._particles.ranges[self._particles.soft_ranges :].reshape(-1, 2):
                index = self._particles.body_index[first:last]
                velocities = rigid.velocities_ms(np.where(index < 0, ~index, index))
                self._particles.columns[VELOCITY : VELOCITY + 3, first:last] = velocities.T
                place_rigid(
                    self._particles.columns, first, last, rigid.group_of, rigid.offsets, rigid.motion, rigid.constraint
                )
        self._extent = np.zeros(6, np.int64)
        self._max_speed_ms = self._inspect(frame=0, time_s=0.0)
        self._grid = self._lay_grid(frame=0, time_s=0.0)
        self._counts = np.zeros(0, np.int32)
        self._frames_done = 0
        self.frame = self._make_frame(substeps=0, dt_s=0.0)

    def _prepare_laws(self) -> None:
        """All that depends on which particles have which law."""
        particles, body = self._particles, self._simulated
        particles.columns[LOAD] = self._kicks.row_of[particles.numbers]
        self._passes = np.array([address_of_pass(law) for law in particles.laws])
        viscosity = body.kinematic_viscosity_m2s
        self._viscosity_m2s = float(viscosity[body.is_soft].max(initial=0.0))
        self._is_fluid = ((body.law == LawId.FLUID) & body.is_soft).astype(np.float32)
        self._fluid_viscosity_m2s = self._is_fluid * viscosity.astype(np.float32)
        self._resting_wave_speed_ms = body.wave_speed_ms
        self._wave_speed_ms = self._fastest_wave_ms()
        self._cells = np.full((3, particles.columns.shape[1]), NEVER_SEEN, np.int32)
        self._order = np.zeros(particles.columns.shape[1], np.int32)
        self._fields = VelocityFields(particles.body_of_range)

    def _take_materials_of(self, time_s: float) -> None:
        """Give particles the materials that they have at a time."""
        body = changed_body(self._at_first, self.settings.changes, time_s)
        if body.has_materials_of(self._simulated):
            return
        before, self._simulated = self._particles, body
        self._particles = Particles(body, origin_m=self._origin_m, chunks=self.settings.chunks)
        carry_over(before, self._particles)
        self._prepare_laws()

    def _align_with_ground(self) -> int:
        """Lower the origin until the ground's highest node is a node of the grid; returns that node.

        Raises:
            SimulationError: something that moves starts below the ground.
        """
        ground, body, dx_m = self.settings.ground, self.body, self.settings.dx_m
        if ground is None:
            return 0
        heights = np.where(body.held, np.inf, body.positions_m[:, 2])
        lowest = int(heights.argmin())
        if heights[lowest] < ground.height_m - 0.5 * dx_m:
            raise SimulationError(
                f"Part '{body.part_names[body.part[lowest]]}' starts {ground.height_m - heights[lowest]:.3g} m below "
                f"the ground at z = {ground.height_m:.4g} m; lower the ground or raise the body."
            )
        plane_m = ground.height_m - GROUND_GAP_CELLS * dx_m
        self._origin_m[2] -= (self._origin_m[2] - plane_m) % dx_m
        return round((plane_m - self._origin_m[2]) / dx_m)

    def estimate(self) -> Estimate:
        """Work of one frame, from the material and from speed and loads at t = 0."""
        substeps = self._substeps_for(expected_speed_ms(self.body, self.settings))
        dt_s = self.settings.frame_time_s / substeps
        return Estimate(substeps, substeps * len(self._particles.moving), dt_s)

    def advance(self) -> Frame:
        """Simulate up to the next frame.

        Raises:
            SimulationError: a particle left its cell's neighbourhood between two sorts or is not finite any more, or
                the grid or the substeps would exceed the settings; ``frame`` is then still the last good one.
        """
        settings = self.settings
        number = self._frames_done + 1
        start_s = self._frames_done * settings.frame_time_s
        end_s = number * settings.frame_time_s
        self._solids.forget()
        if self.settings.changes:
            self._take_materials_of(start_s)
            self._max_speed_ms = self._inspect(frame=number, time_s=start_s)
        load = self._kicks.peak_acceleration_ms2(start_s, end_s, **self._felt())
        taken, done, substeps, dt_s, planned_ms = 0, 0, 0, 0.0, 0.0
        while done < substeps or taken == 0:
            if taken == 0 or self._wave_speed_ms > _STIFFENED * planned_ms:
                # plan the rest of the frame: all of it at first, again where the material has stiffened meanwhile
                start_s += dt_s * done
                speed = max(self._max_speed_ms, self._set_speed_ms(start_s, end_s)) + load * settings.frame_time_s
                substeps, done, planned_ms = self._substeps_for(speed, end_s - start_s), 0, self._wave_speed_ms
                dt_s = (end_s - start_s) / substeps
                if taken + substeps > settings.max_substeps_per_frame:
                    raise SimulationError(
                        f"Frame {number} at {start_s:.4g} s needs {taken + substeps} substeps for a speed of "
                        f"{speed:.3g} m/s, {settings.max_substeps_per_frame} are allowed; use weaker forces or raise "
                        f"max_substeps_per_frame."
                    )
            now_s = start_s + dt_s * done
            speed = max(self._max_speed_ms, self._set_speed_ms(now_s, end_s))
            speed += load * dt_s * sort_interval(substeps, dt_s, 0.0, settings.dx_m)
            count = min(sort_interval(substeps, dt_s, speed, settings.dx_m), substeps - done)
            times_s = start_s + dt_s * np.arange(done, done + count + 1)
            self._segment(times_s, dt_s)
            done, taken = done + count, taken + count
            self._max_speed_ms = self._inspect(frame=number, time_s=start_s + dt_s * done)
            self._wave_speed_ms = self._fastest_wave_ms()
            if not self._grid.holds(self._extent) or self._fields.count > self._grid.fields:
                self._grid = self._lay_grid(frame=number, time_s=start_s + dt_s * done)
        self._frames_done = number
        self.frame = self._make_frame(substeps=taken, dt_s=dt_s)
        return self.frame

    def checkpoint(self) -> dict[str, NDArray[Any]]:
        """Arrays by name that ``restore`` needs to go on from the last frame, to the bit; between frames only."""
        done = np.array([self._frames_done, self.frame.substeps], np.int64)
        state = {"done": done, "dt_s": np.array(self.frame.dt_s), "columns": self._particles.columns}
        state["solids"] = self._solids.state
        if self._rigid is not None:
            state |= {f"rigid_{name}": getattr(self._rigid, name) for name in self._rigid.STATE}
        return {name: array.copy() for name, array in state.items()}

    def restore(self, saved: Mapping[str, NDArray[Any]]) -> Frame:
        """Take back what ``checkpoint`` of a simulator of the same body and settings gave; returns its frame.

        Raises:
            SimulationError: it belongs to another body.
        """
        if self.settings.changes and "done" in saved:  # the columns are those of the frame before the next change
            self._take_materials_of((int(saved["done"][0]) - 1) * self.settings.frame_time_s)
        own = self.checkpoint()
        misfit = [name for name in own if name not in saved or not _alike(own[name], saved[name])]
        if misfit or len(saved) != len(own):
            raise SimulationError(
                f"The checkpoint does not fit the body: expected {', '.join(own)} of the body's sizes, got "
                f"{', '.join(f'{name} {array.shape}' for name, array in saved.items())}; simulate from the start."
            )
        self._frames_done, substeps = (int(value) for value in saved["done"])
        self._particles.columns[:] = saved["columns"]
        self._solids.state[:] = saved["solids"]
        if self._rigid is not None:
            for name in self._rigid.STATE:
                getattr(self._rigid, name)[:] = saved[f"rigid_{name}"]
        self._cells = np.full_like(self._cells, NEVER_SEEN)
        time_s = self._frames_done * self.settings.frame_time_s
        self._max_speed_ms = self._inspect(frame=self._frames_done, time_s=time_s)
        self._wave_speed_ms = self._fastest_wave_ms()
        self._grid = self._lay_grid(frame=self._frames_done, time_s=time_s)
        self.frame = self._make_frame(substeps=substeps, dt_s=float(saved["dt_s"]))
        return self.frame

    def _substeps_for(self, speed_ms: float, time_s: float | None = None) -> int:
        return substeps_for(
            self._wave_speed_ms,
            speed_ms,
            self.settings,
            viscosity_m2s=self._viscosity_m2s,
            rigid_contact=self._rigid is not None and self._solids.count > 0,
            time_s=time_s,
        )

    def _fastest_wave_ms(self) -> float:
        """Speed of the fastest pressure wave, with what laws have stiffened."""
        wave_speed = self._resting_wave_speed_ms
        fastest = float(wave_speed[self._simulated.is_soft].max(initial=0.0))
        for law, index, parameters, state in self._particles.soft_states(stiffening_only=True):
            assert law.stiffening is not None
            stiffened = wave_speed[index] * np.sqrt(law.stiffening(parameters, state))
            fastest = max(fastest, float(stiffened.max(initial=0.0)))
        return fastest

    def _segment(self, times_s: NDArray[Any], dt_s: float) -> None:
        """Sort, then take the substeps that ``times_s`` bounds."""
        settings, particles = self.settings, self._particles
        cell_count = math.prod(int(n) for n in self._extent[1::2] - self._extent[0::2] + 1)
        if len(self._counts) <= cell_count:
            self._counts = np.zeros(cell_count + 1, np.int32)
        for law_ranges in particles.ranges:
            order_by_cell(self._cells, self._extent, law_ranges[0, 0], law_ranges[-1, 1], self._counts, self._order)
        grid = self._grid
        spans, bounds = grid.chunk_limits(
            self._cells[:, self._order], particles.ranges, self._extent, self._fields.of_range
        )
        everything, kicks = self._kicks.gains(times_s, **self._felt())
        span_s = float(times_s[0]), float(times_s[-1])
        self._solids.begin(*span_s)
        self._set_contacts(*span_s)
        pairs = no_pairs(grid.nodes[0] * grid.nodes[1])
        if grid.fields > 1:
            pairs = self._fields.pairs(
                particles.columns,
                particles.ranges,
                self._is_fluid[particles.numbers],
                dx_m=settings.dx_m,
                mass_unit_kg=particles.mass_unit_kg,
                friction=settings.body_friction,
                shift=grid.shift,
                nodes=grid.nodes,
            )
        self._cells = self._cells[:, self._order]
        self._wet_contacts()
        soft_share = self._soft_share_at_contacts()
        damping = -math.expm1(-settings.damping_per_s * dt_s)
        advance(
            self._passes,
            particles.columns,
            particles.spare,
            self._order,
            particles.ranges,
            self._fields.of_range,
            spans,
            bounds,
            grid.momentum,
            grid.velocity,
            grid.free,
            grid.contacts,
            pairs,
            grid.numbers,
            grid.nodes[0],
            self._dx,
            np.float32(dt_s),
            everything.astype(np.float32),
            kicks.astype(np.float32),
            np.float32(damping),
            self._undamped_motion(everything, kicks, dt_s),
            self._rigid_arguments(),
        )
        particles.columns, particles.spare = particles.spare, particles.columns
        reactions = None if self._rigid is None else self._rigid.reactions
        self._solids.end(*span_s, grid.contacts, rigid=reactions, soft_share=soft_share)

    def _felt(self) -> dict[str, NDArray[Any]]:
        """What fields ask for: particles of the body, where they are and how fast; nothing where there are none."""
        columns = self._particles.columns if self._kicks.has_fields else self._particles.columns[:, :0]
        return {
            "index": self._particles.numbers[: columns.shape[1]],
            "positions_m": columns[POSITION : POSITION + 3].T.astype(np.float64),
            "velocities_ms": columns[VELOCITY : VELOCITY + 3].T.astype(np.float64),
        }

    def _set_contacts(self, from_s: float, to_s: float) -> None:
        """Let obstacles and drives act on the grid during a segment; once per grid where they never change."""
        grid = self._grid
        if grid.contacts_are_set and self._solids.always_stand and not self.settings.drives:
            return
        particles, place = self._particles, {"shift": grid.shift, "nodes": grid.nodes}
        fields = self._fields.of_particles(particles.ranges)
        driven = self._driven.entries(
            particles.columns, particles.numbers, fields, from_s=from_s, to_s=to_s, solids=self._solids.met_by, **place
        )
        grid.set_contacts([*self._solids.entries(**place), *driven])

    def _soft_share_at_contacts(self) -> NDArray[np.float64] | None:
        """Share of soft particles in the mass at each contact, [fields, K]; None where all is soft, or nobody asks."""
        if self._rigid is None or self._solids.count == 0:
            return None
        if self._particles.soft_ranges == 0:
            return np.zeros((self._grid.fields, len(self._grid.contacts[1])))
        return self._mean_at_contacts((self._rigid.group_of[self._particles.numbers] < 0).astype(np.float32))

    def _mean_at_contacts(self, values: NDArray[np.float32]) -> NDArray[np.float64]:
        """Mean by mass, in each field around each contact, of what the particles carry, [fields, K]."""
        grid = self._grid
        fields = self._fields.of_particles(self._particles.ranges)
        starts, nodes = grid.contacts[:2]
        row = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
        place = row * grid.nodes[2] + nodes[:, 0]
        mean = np.zeros((grid.fields, len(place)))
        for field in range(grid.fields):
            total, weighted = np.zeros((2, *grid.nodes), np.float32)
            mine = fields == field
            columns = self._particles.columns if mine.all() else self._particles.columns[:, mine]
            node_masses(columns, values[mine], 1 / self._dx, grid.shift, total, weighted)
            mean[field] = weighted.ravel()[place] / np.maximum(total.ravel()[place], 1e-12)
        return mean

    def _wet_contacts(self) -> None:
        """Give contacts the friction of what is at them: a fluid has none of Coulomb's, it shears at the wall.

        The nodes that a wall stops hold about a twelfth of a cell of the fluid beside it; the shear stress eta v / dx
        of fluid that rests on the wall a cell away slows them at the rate 12 eta / (rho dx^2).
        """
        if not self._is_fluid.any() or len(self._grid.contacts[1]) == 0:
            return
        planes, rubbing = self._grid.contacts[2], self._grid.contacts[4]
        numbers = self._particles.numbers
        rubbing[..., 0] = planes[:, 3] * (1 - self._mean_at_contacts(self._is_fluid[numbers]))
        viscosity_m2s = self._mean_at_contacts(self._fluid_viscosity_m2s[numbers])
        rubbing[..., 1] = _SHEARED_PER_CELL * viscosity_m2s / self.settings.dx_m**2

    def _set_speed_ms(self, from_s: float, to_s: float) -> float:
        """The largest speed of what obstacles and drives move between two times."""
        return max(self._driven.top_speed_ms(from_s), self._solids.top_speed_ms(from_s, to_s))

    def _part_name_at(self, place: int) -> str:
        return self.body.part_names[int(self.body.part[self._particles.numbers[place]])]

    def _rigid_arguments(self) -> tuple[Any, ...] | None:
        if self._rigid is None:
            return None
        return self._rigid.kernel_arguments(
            soft_ranges=self._particles.soft_ranges,
            unblocked=self._grid.unblocked,
            chunks=self.settings.chunks,
            obstacles=self._solids.table(),
        )

    def _undamped_motion(
        self, everything: NDArray[np.float64], kicks: NDArray[np.float64], dt_s: float
    ) -> NDArray[np.float32]:
        """Rigid motion (velocity, angular velocity, centre) that damping spares in each substep, [S, 9]."""
        motion = np.zeros((len(everything), 9))
        if not (self.settings.damping_relative_to_rigid and self.settings.damping_per_s > 0):
            return motion.astype(np.float32)
        columns = self._particles.columns
        mass = columns[MASS].astype(np.float64)
        velocity, spin, centre = diagnostics.rigid_motion(
            mass,
            columns[POSITION : POSITION + 3].T.astype(np.float64),
            columns[VELOCITY : VELOCITY + 3].T.astype(np.float64),
            columns[AFFINE : AFFINE + 9].T.reshape(-1, 3, 3),
            self.settings.dx_m,
        )
        # what a substep gains is damped in that substep
        kicked = np.zeros((1, 3))
        if kicks.shape[1] > 0:
            row = columns[LOAD].astype(np.int64)
            row_mass = np.bincount(row, mass, kicks.shape[1])
            kicked = np.einsum("r,sri->si", row_mass, kicks[..., :3])
            if self._kicks.has_fields:
                kicked -= (mass * kicks[0, row, 3]) @ columns[VELOCITY : VELOCITY + 3].T
        motion[:, :3] = velocity + np.cumsum(everything + kicked / mass.sum(), 0)
        motion[:, 3:6] = spin
        motion[:, 6:] = centre + np.cumsum(motion[:, :3] * dt_s, 0) - motion[:, :3] * dt_s
        return motion.astype(np.float32)

    def _inspect(self, *, frame: int, time_s: float) -> float:
        """Check all particles, find their cells; returns the largest speed in m/s."""
        columns = self._particles.columns
        previous = self._cells
        cells = np.full_like(previous, NEVER_SEEN)
        bad, fastest = inspect_particles(columns, previous, 1 / self._dx, cells, self._extent)
        if bad >= 0:
            name = self._part_name_at(bad)
            sound = bool(np.isfinite(columns[:, bad]).all())
            what = "moved by more than one cell between two sorts" if sound else "has no finite position or velocity"
            cause = "forces or impacts too strong for the material"
            if self.settings.cfl > _SAFE_CFL:
                cause = f"cfl {self.settings.cfl:g} above {_SAFE_CFL:g}, or {cause}"
            raise SimulationError(
                f"The simulation became unstable in frame {frame} at {time_s:.4g} s: a particle of part '{name}' "
                f"{what}; likely causes: {cause}."
            )
        self._cells = cells
        self._fields.assign(cells, self._particles.ranges)
        return float(fastest)

    def _lay_grid(self, *, frame: int, time_s: float) -> Grid:
        settings = self.settings
        padding = settings.padding_cells + (0 if frame == 0 else _GROWTH_CELLS)
        nodes = math.prod(Grid.nodes_for(self._extent, padding)) * self._fields.count
        if nodes > settings.max_grid_nodes:
            farthest = int(np.linalg.norm(self._particles.columns[POSITION : POSITION + 3], axis=0).argmax())
            name = self._part_name_at(farthest)
            raise SimulationError(
                f"The body spreads too far in frame {frame} at {time_s:.4g} s: the grid would need {nodes} nodes, "
                f"{settings.max_grid_nodes} are allowed, and part '{name}' is farthest from where the body was; use a "
                f"larger dx_m, weaker forces, or raise max_grid_nodes."
            )
        ground, number = settings.ground, self._solids.ground_number
        return Grid(
            self._extent,
            chunks=settings.chunks,
            padding=padding,
            held=self._held,
            ground=ground and (self._ground_node, CONTACT_KINDS[ground.contact], ground.friction, number),
            with_rigid=self._rigid is not None,
            fields=self._fields.count,
        )

    def _make_frame(self, *, substeps: int, dt_s: float) -> Frame:
        body, particles, dx_m = self._simulated, self._particles, self.settings.dx_m
        particles.limit_stretch()
        moving = particles.moving
        mass = body.mass_kg[moving]
        x, v = particles.positions_m(), particles.velocities_ms()
        if self._rigid is not None:
            is_rigid = body.is_rigid[moving]
            v[is_rigid] = self._rigid.velocities_ms(moving[is_rigid])
        f, c = particles.deformation_gradients(), particles.affine_per_s()
        positions = body.positions_m.copy()
        positions[moving] = x
        gradients = np.tile(np.eye(3, dtype=np.float32), (len(body), 1, 1))
        gradients[moving] = f
        stored_j = diagnostics.elastic_energy_j(body, particles, gradients)
        velocities = np.zeros((len(body), 3), np.float32)
        velocities[moving] = v
        skin = self.body.held  # simulated beside the moving body, but held for everyone else
        positions[skin], gradients[skin], velocities[skin] = body.positions_m[skin], np.eye(3), 0
        return Frame(
            time_s=self._frames_done * self.settings.frame_time_s,
            positions_m=positions,
            deformation_gradients=gradients,
            velocities_ms=velocities,
            substeps=substeps,
            dt_s=dt_s,
            max_speed_ms=float(np.linalg.norm(v, axis=1).max()),
            kinetic_energy_j=diagnostics.kinetic_energy_j(mass, v, c, dx_m),
            elastic_energy_j=stored_j,
            momentum_kgms=diagnostics.momentum_kgms(mass, v),
            angular_momentum_kgm2s=diagnostics.angular_momentum_kgm2s(mass, x, v, c, dx_m=dx_m, about_m=np.zeros(3)),
            reactions_n=-self._solids.given_kgms / self.settings.frame_time_s,
            obstacle_shifts_m=self._solids.shifts_m.copy(),
        )


def _alike(first: NDArray[Any], second: NDArray[Any]) -> bool:
    return first.dtype == second.dtype and first.shape == second.shape
