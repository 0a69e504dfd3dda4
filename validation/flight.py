"""Bodies in free flight: what falls, spins and is half rigid keeps what mechanics says it keeps (B1, B2, B19)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from phys4dgen.mpm import Frame, LawId, Settings, Simulator
from validation.bodies import body, lattice
from validation.case import Check, Outcome, benchmark
from validation.chart import Chart, Curve

__all__ = ["free_fall", "rigid_half", "spinning_cube"]

G_MS2 = 9.81


def _frames(simulator: Simulator, substeps: int) -> list[Frame]:
    """Frames until so many substeps are taken, with the first at t = 0."""
    frames = [simulator.frame]
    while sum(frame.substeps for frame in frames) < substeps:
        frames.append(simulator.advance())
    return frames


@benchmark("B1", "Free fall", source="Kinematics; symplectic Euler: z = -g (t^2 + sum dt^2) / 2", in_tests=("",))
def free_fall() -> Outcome:
    """A soft cube (E 2e5 Pa) falls for 1000 substeps: it must not deform."""
    x = lattice((6, 6, 6), 0.01)
    frames = _frames(Simulator(body(x, 1e-6, E=2e5), Settings(0.02, 0.05, gravity_ms2=(0, 0, -G_MS2))), 1000)
    last = frames[-1]
    squares = sum(frame.substeps * frame.dt_s**2 for frame in frames)
    fallen = -G_MS2 * (last.time_s**2 + squares) / 2
    off = np.abs(last.positions_m - x - [0, 0, fallen]).max()
    strain = np.abs(last.deformation_gradients - np.eye(3)).max()
    return Outcome(
        (
            Check.share("mean fall, m", (last.positions_m - x)[:, 2].mean(), expected=fallen, tolerance=1e-4),
            Check.between("worst particle from its place, share of the fall", off / abs(fallen), high=1e-4),
            Check.between("largest |F - I|", strain, high=1e-4),
        )
    )


@benchmark(
    "B2",
    "Spinning elastic cube",
    source="Conservation of momentum; APIC angular momentum with m dx^2/4 axial(C), C. Jiang et al. 2015",
    in_tests=("",),
)
def spinning_cube() -> Outcome:
    """An elastic cube (E 4e5 Pa) of 6 cells is thrown, spins about no axis of the grid and rings for 2500 substeps."""
    x = lattice((12, 12, 12), 0.01, (-0.06, -0.06, -0.06))
    spin = np.array([6.0, -3.0, 20.0])
    b = body(x, 1e-6, E=4e5, v=np.cross(spin, x) + np.array([0.3, 0.1, 0.0]))
    frames = _frames(Simulator(b, Settings(0.02, 0.0375)), 2500)
    first, last = frames[1], frames[-1]
    momentum = b.mass_kg @ np.asarray(b.velocities_ms)
    turning = first.angular_momentum_kgm2s
    scale = np.linalg.norm(turning)
    energy = np.array([frame.kinetic_energy_j + frame.elastic_energy_j for frame in frames[1:]])
    turns = (last.time_s - first.time_s) * np.linalg.norm(spin) / (2 * np.pi)
    lost = np.abs(last.momentum_kgms - momentum).max() / np.linalg.norm(momentum)
    spun_down = max(
        np.abs(last.angular_momentum_kgm2s - start).max() for start in (turning, frames[0].angular_momentum_kgm2s)
    )
    return Outcome(
        (
            Check.between("change of momentum, share", lost, high=1e-4),
            Check.between("change of angular momentum, share", spun_down / scale, high=1e-4),
            Check.between("largest rise of energy between frames, share", np.diff(energy).max() / energy[0], high=1e-4),
            Check.between("energy lost per turn, share", (1 - energy[-1] / energy[0]) / turns, high=0.01),
        ),
        (
            Chart(
                "Energy of the spinning cube",
                "time, s",
                "energy / energy at first",
                (Curve("engine", [frame.time_s for frame in frames[1:]], energy / energy[0]),),
            ),
        ),
    )


@benchmark("B19", "Half rigid bar", source="Conservation of momentum; a rigid body keeps its shape", in_tests=("",))
def rigid_half() -> Outcome:
    """A bar of 12 x 3 x 3 cells, half of it one rigid group, half soft (E 2e5 Pa), is thrown for 1000 substeps."""
    dx = 0.02
    x = lattice((24, 6, 6), dx / 2)
    v = np.cross([2.0, -3.0, 8.0], x - x.mean(0)) + np.array([0.5, 0.2, 0.1])
    is_rigid = x[:, 0] < 12 * dx / 2
    b = body(x, (dx / 2) ** 3, E=2e5, law=LawId.FIXED_COROTATED, v=v)
    b = replace(b, rigid_group=np.where(is_rigid, 0, -1).astype(np.int32))
    frames = _frames(Simulator(b, Settings(dx, 0.02)), 1000)
    first, last = frames[0], frames[-1]
    scale = np.linalg.norm(first.angular_momentum_kgm2s)
    energy = np.array([frame.kinetic_energy_j + frame.elastic_energy_j for frame in frames])
    rotation = last.deformation_gradients[is_rigid][0].astype(float)
    moved = last.positions_m[is_rigid] - last.positions_m[is_rigid].mean(0)
    rest = x[is_rigid] - x[is_rigid].mean(0)
    # the nearest rotation of the rest shape (Kabsch): what differs from it is a change of shape
    u, _, vt = np.linalg.svd(moved.T @ rest)
    bent = np.abs(moved - rest @ (u @ vt).T).max() / np.ptp(rest)
    return Outcome(
        (
            Check.between(
                "change of momentum, share",
                np.abs(last.momentum_kgms - first.momentum_kgms).max() / np.linalg.norm(first.momentum_kgms),
                high=1e-5,
            ),
            Check.between(
                "change of angular momentum, share",
                np.abs(last.angular_momentum_kgm2s - first.angular_momentum_kgm2s).max() / scale,
                high=1e-5,
            ),
            Check.between("change of the rigid half's shape, share of its size", bent, high=1e-10),
            Check.between(
                "largest |F F^T - I| of the rigid half", np.abs(rotation @ rotation.T - np.eye(3)).max(), high=1e-6
            ),
            Check.between("largest rise of energy between frames, share", np.diff(energy).max() / energy[0], high=1e-4),
        )
    )
