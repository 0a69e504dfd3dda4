"""Rigid groups of particles: their inertia, their motion, and the points with which they touch ground and obstacles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from phys4dgen.mpm.body import Body
from phys4dgen.mpm.kernels.rigid_motion import (
    CENTRE,
    FITTED_SPIN,
    FITTED_VELOCITY,
    LAST_ROTATION,
    MOTION_COUNT,
    ROTATION,
    SPIN,
    SUM_COUNT,
    VELOCITY_OF_CENTRE,
)

__all__ = ["RigidParts"]


@dataclass(frozen=True, eq=False)
class RigidParts:
    """G rigid groups; lengths in metres from the origin of the kernels, masses in mean particle masses.

    Attributes:
        group_of: group 0 .. G-1 of each particle of the body, -1 if soft or held, int32 [P].
        offsets: rest positions from the centre of mass of the group, float64 [P, 3].
        motion: centre, velocity, spin and rotation of each group, float64 [G, MOTION_COUNT]; kernels advance it.
        mass: float64 [G].
        inverse_inertia: I^-1 at rest with the term of the affine velocities, float64 [G, 3, 3].
        inverse_point_inertia: the same without that term; its pseudoinverse for particles on one line.
        constraint: velocities that keep the grid rigid, in the frame of the group at rest, float32 [P, 3].
        points: vertices of the convex hulls, from the centres at rest, float64 [K, 3].
        radii: half the side of the cube that each vertex stands for, float64 [K].
        starts: first vertex of each group, int64 [G + 1].
        impulses: of each obstacle on each vertex in the last substep, float64 [O, K, 3].
        reactions: impulses of each obstacle on all groups since they were last taken, float64 [O, 3].
    """

    STATE: ClassVar[tuple[str, ...]] = ("motion", "constraint", "impulses")
    """The arrays that change from frame to frame."""

    group_of: NDArray[np.int32]
    offsets: NDArray[np.float64]
    motion: NDArray[np.float64]
    mass: NDArray[np.float64]
    inverse_inertia: NDArray[np.float64]
    inverse_point_inertia: NDArray[np.float64]
    constraint: NDArray[np.float32]
    points: NDArray[np.float64]
    radii: NDArray[np.float64]
    starts: NDArray[np.int64]
    impulses: NDArray[np.float64]
    reactions: NDArray[np.float64]

    @classmethod
    def from_body(
        cls, body: Body, *, origin_m: NDArray[np.float64], mass_unit_kg: float, dx_m: float, obstacle_count: int
    ) -> RigidParts | None:
        """The groups of a body at rest with the momenta that its velocities have; None where nothing is rigid."""
        members = np.flatnonzero(body.is_rigid)
        if len(members) == 0:
            return None
        assert body.velocities_ms is not None and body.rigid_group is not None
        names, numbers = np.unique(body.rigid_group[members], return_inverse=True)
        count = len(names)
        group_of = np.full(len(body), -1, np.int32)
        group_of[members] = numbers
        # as the kernels see it: rounded to float32 once
        particle_mass = (body.mass_kg / mass_unit_kg).astype(np.float32).astype(np.float64)
        positions = body.positions_m - origin_m
        offsets = np.zeros((len(body), 3))
        motion, mass = np.zeros((count, MOTION_COUNT)), np.zeros(count)
        inverse_inertia, inverse_point_inertia = np.zeros((2, count, 3, 3))
        points, radii = [], []
        for g in range(count):
            mine = members[numbers == g]
            m = particle_mass[mine]
            mass[g] = m.sum()
            centre = m @ positions[mine] / mass[g]
            r = positions[mine] - centre
            offsets[mine] = r
            v = body.velocities_ms[mine]
            velocity = m @ v / mass[g]
            inertia = np.eye(3) * (m @ (r**2).sum(1)) - (m[:, None] * r).T @ r
            inverse_point_inertia[g] = np.linalg.pinv(inertia, rcond=1e-9, hermitian=True)
            spin = inverse_point_inertia[g] @ (m @ np.cross(r, v - velocity))
            inverse_inertia[g] = np.linalg.inv(inertia + np.eye(3) * mass[g] * dx_m**2 / 2)
            motion[g, CENTRE : CENTRE + 3] = centre
            for linear, angular in ((VELOCITY_OF_CENTRE, SPIN), (FITTED_VELOCITY, FITTED_SPIN)):
                motion[g, linear : linear + 3] = velocity
                motion[g, angular : angular + 3] = spin
            for rotation in (ROTATION, LAST_ROTATION):
                motion[g, rotation : rotation + 9] = np.eye(3).ravel()
            outer = mine[_hull(r)]
            points.append(offsets[outer])
            radii.append(body.volume_m3[outer] ** (1 / 3) / 2)
        return cls(
            group_of=group_of,
            offsets=offsets,
            motion=motion,
            mass=mass,
            inverse_inertia=inverse_inertia,
            inverse_point_inertia=inverse_point_inertia,
            constraint=np.zeros((len(body), 3), np.float32),
            points=np.concatenate(points),
            radii=np.concatenate(radii),
            starts=np.concatenate([[0], np.cumsum([len(p) for p in points])]),
            impulses=np.zeros((obstacle_count, sum(len(p) for p in points), 3)),
            reactions=np.zeros((obstacle_count, 3)),
        )

    def velocities_ms(self, particles: NDArray[np.int64]) -> NDArray[np.float32]:
        """Velocities of rigid particles of the body without the constraint's, m/s, [n, 3]."""
        motion = self.motion[self.group_of[particles]]
        rotation = motion[:, ROTATION : ROTATION + 9].reshape(-1, 3, 3)
        r = np.einsum("pij,pj->pi", rotation, self.offsets[particles])
        velocities = motion[:, VELOCITY_OF_CENTRE : VELOCITY_OF_CENTRE + 3] + np.cross(motion[:, SPIN : SPIN + 3], r)
        return velocities.astype(np.float32)

    def kernel_arguments(
        self,
        *,
        soft_ranges: int,
        unblocked: NDArray[np.float32],
        chunks: int,
        obstacles: NDArray[np.float64],
    ) -> tuple[Any, ...]:
        """What ``step.advance`` takes as ``rigid``.

        Args:
            soft_ranges: how many of the laws' ranges are soft; rigid ones follow.
            unblocked: grid velocity but for what rigid groups meet by themselves, float32 [4 nodes + spare].
            chunks: particle ranges with sums of their own.
            obstacles: ``obstacles.obstacle_table`` at the start of the segment; advanced.
        """
        sums = np.zeros((chunks, len(self.mass), SUM_COUNT))
        members = (self.group_of, self.offsets, self.constraint, self.motion, sums)
        shapes = (
            self.mass,
            self.inverse_inertia,
            self.inverse_point_inertia,
            self.points,
            self.radii,
            self.starts,
            self.impulses,
            self.reactions,
        )
        return soft_ranges, unblocked, *members, *shapes, obstacles


def _hull(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Numbers of the vertices of the convex hull; all points where they are too few or lie in a plane."""
    try:
        return np.sort(ConvexHull(points).vertices).astype(np.int64)
    except (QhullError, ValueError):
        return np.arange(len(points))
