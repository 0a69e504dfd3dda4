"""The simulator: a body and settings in, one frame after the other out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import SimulationError
from phys4dgen.mpm.at_contacts import mean_at_contacts, wet_contacts
from phys4dgen.mpm.body import Body
from phys4dgen.mpm.changes import carry_over, changed_body, check_changes
from phys4dgen.mpm.contacts import CONTACT_KINDS
from phys4dgen.mpm.damping import undamped_motion
from phys4dgen.mpm.drives import DrivenNodes
from phys4dgen.mpm.forces import Kicks
from phys4dgen.mpm.frame import Frame, frame_of
from phys4dgen.mpm.grid import Grid
from phys4dgen.mpm.ground import origin_and_ground_node
from phys4dgen.mpm.held import HeldNodes, with_simulated_skin
from phys4dgen.mpm.kernels.law_step import address_of_law
from phys4dgen.mpm.kernels.layout import LOAD, POSITION, VELOCITY
from phys4dgen.mpm.kernels.rigid_pass import place_rigid
from phys4dgen.mpm.kernels.sorting import NEVER_SEEN, inspect_particles, order_by_cell
from phys4dgen.mpm.laws import LawId
from phys4dgen.mpm.rigid import RigidParts
from phys4dgen.mpm.settings import Settings
from phys4dgen.mpm.solids import Solids
from phys4dgen.mpm.state import Particles
from phys4dgen.mpm.step import advance, kernels_for
from phys4dgen.mpm.timestep import Estimate, expected_speed_ms, sort_interval, stiff_parts, substeps_for
from phys4dgen.mpm.velocity_fields import VelocityFields, no_pairs
from phys4dgen.mpm.watchdog import too_fast, too_wide, unstable

__all__ = ["Frame", "Simulator"]

_STIFFENED = 1.05  # waves faster by more than this shorten the rest of the frame's substeps
_GROWTH_CELLS = 4  # beyond the padding, so that a moving body does not lay a new grid at every sort


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
        self._origin_m, self._ground_node = origin_and_ground_node(body, settings)
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
        self._laws = np.array([address_of_law(law) for law in particles.laws])
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
                    where, allowed = f"Frame {number} at {start_s:.4g} s", settings.max_substeps_per_frame
                    raise too_fast(where, speed_ms=speed, needed=taken + substeps, allowed=allowed)
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
        self._cells = np.take(self._cells, self._order, axis=1)
        spans, bounds = grid.chunk_limits(self._cells, particles.ranges, self._extent, self._fields.of_range)
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
        soft_share = self._rub()
        damping = -math.expm1(-settings.damping_per_s * dt_s)
        undamped = undamped_motion(
            particles.columns, settings, everything, kicks, has_fields=self._kicks.has_fields, dt_s=dt_s
        )
        advance(
            kernels_for(grid.fields),
            self._laws,
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
            undamped,
            self._rigid_arguments(),
        )
        particles.columns, particles.spare = particles.spare, particles.columns
        reactions = None if self._rigid is None else self._rigid.reactions
        self._solids.end(*span_s, grid.contacts, kept=1 - damping, rigid=reactions, soft_share=soft_share)

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

    def _rub(self) -> NDArray[np.float64] | None:
        """Let fluids run over what they touch; share of soft matter at each contact, None where all is soft."""
        contacts = len(self._grid.contacts[1])
        wets = contacts > 0 and self._is_fluid.any()
        rigid = self._rigid if self._solids.count > 0 else None
        if rigid is None and not wets:
            return None
        particles, numbers = self._particles, self._particles.numbers
        at, dx_m = (self._grid, particles, self._fields.of_particles(particles.ranges)), self.settings.dx_m
        if wets:
            viscosity_m2s = self._fluid_viscosity_m2s[numbers]
            wet_contacts(*at, is_fluid=self._is_fluid[numbers], viscosity_m2s=viscosity_m2s, dx_m=dx_m)
        if rigid is None:
            return None
        if particles.soft_ranges == 0:
            return np.zeros((self._grid.fields, contacts))
        return mean_at_contacts(*at, (rigid.group_of[numbers] < 0).astype(np.float32), dx_m=dx_m)

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

    def _inspect(self, *, frame: int, time_s: float) -> float:
        """Check all particles, find their cells; returns the largest speed in m/s."""
        columns = self._particles.columns
        previous = self._cells
        cells = np.full_like(previous, NEVER_SEEN)
        bad, fastest = inspect_particles(columns, previous, 1 / self._dx, cells, self._extent)
        if bad >= 0:
            where = f"frame {frame} at {time_s:.4g} s"
            sound = bool(np.isfinite(columns[:, bad]).all())
            raise unstable(where, self._part_name_at(bad), is_finite=sound, cfl=self.settings.cfl)
        self._cells = cells
        self._fields.assign(cells, self._particles.ranges)
        return float(fastest)

    def _lay_grid(self, *, frame: int, time_s: float) -> Grid:
        settings = self.settings
        padding = settings.padding_cells + (0 if frame == 0 else _GROWTH_CELLS)
        nodes = math.prod(Grid.nodes_for(self._extent, padding)) * self._fields.count
        if nodes > settings.max_grid_nodes:
            farthest = int(np.linalg.norm(self._particles.columns[POSITION : POSITION + 3], axis=0).argmax())
            where = f"frame {frame} at {time_s:.4g} s"
            raise too_wide(where, self._part_name_at(farthest), nodes=nodes, allowed=settings.max_grid_nodes)
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
        return frame_of(
            self._simulated,
            self._particles,
            rest=self.body,
            rigid=self._rigid,
            solids=self._solids,
            dx_m=self.settings.dx_m,
            time_s=self._frames_done * self.settings.frame_time_s,
            substeps=substeps,
            dt_s=dt_s,
            since_s=self.settings.frame_time_s,
        )


def _alike(first: NDArray[Any], second: NDArray[Any]) -> bool:
    return first.dtype == second.dtype and first.shape == second.shape
