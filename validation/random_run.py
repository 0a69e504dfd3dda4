"""Simulates random scenes and judges them: no NaN, no crash, no escape without a cause, no energy from nowhere.

    python -m validation random --count 200 [--first 0]

Scenes run in batches, each in a process of its own, so that a crash is seen and costs one scene.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass

import numpy as np

from phys4dgen.errors import SimulationError
from phys4dgen.mpm import Frame, HalfSpace, HollowBall, Simulator
from validation.accounting import Account
from validation.random_scenes import FRAMES, Scene, random_scene

__all__ = ["Verdict", "in_batches", "judge"]

MOST_EXCESS = 0.01
_BATCH = 25
_TIME_LIMIT_S = 3600


@dataclass(frozen=True)
class Verdict:
    """How a scene ended.

    Attributes:
        seed, title: which scene.
        fault: what is wrong; empty if nothing is.
        ended: the engine's own cause where it stopped the run, else empty.
        excess: largest energy beyond the start and the work done, over the highest energy.
        particles, substeps: work.
    """

    seed: int
    title: str
    fault: str = ""
    ended: str = ""
    excess: float = 0.0
    particles: int = 0
    substeps: int = 0


def judge(seed: int) -> Verdict:
    """Simulate the scene of a seed."""
    scene = random_scene(seed)
    p = len(scene.body)
    try:
        simulator = Simulator(scene.body, scene.settings)
    except SimulationError as error:
        return Verdict(seed, scene.title, ended=str(error), particles=p)
    start = simulator.frame
    account = Account(scene.body, scene.settings, start)
    energy, allowed = [_energy_j(start)], [_energy_j(start)]
    substeps, fault, ended, fastest = 0, "", "", start.max_speed_ms
    for _ in range(FRAMES):
        try:
            frame = simulator.advance()
        except SimulationError as error:
            ended = str(error)
            break
        substeps += frame.substeps
        fastest = max(fastest, frame.max_speed_ms)
        fault = _state_fault(scene, frame, fastest)
        if fault:
            break
        account.add(frame)
        energy.append(_energy_j(frame))
        allowed.append(energy[0] + account.work_j)
    beyond = np.array(energy) - np.array(allowed)
    excess = float(beyond.max() / max(max(energy), 1e-300))
    if not fault and excess > MOST_EXCESS:
        fault = f"energy exceeds start and work by {excess:.1%} of its peak in frame {int(beyond.argmax())}"
    return Verdict(seed, scene.title, fault, ended, excess, p, substeps)


def _energy_j(frame: Frame) -> float:
    return frame.kinetic_energy_j + frame.elastic_energy_j


def _state_fault(scene: Scene, frame: Frame, fastest_ms: float) -> str:
    """What is wrong with a frame, or nothing."""
    values = (frame.positions_m, frame.velocities_ms, frame.deformation_gradients)
    if not all(np.isfinite(value).all() for value in values) or not np.isfinite(_energy_j(frame)):
        return f"not finite at {frame.time_s:.4g} s"
    dx_m = scene.settings.dx_m
    moved = np.linalg.norm(frame.positions_m - scene.body.positions_m, axis=1).max()
    # speeds between frames may be twice what frames show
    if moved > 2 * fastest_ms * frame.time_s + 2 * dx_m:
        return f"a particle has escaped: {moved:.3g} m at speeds up to {fastest_ms:.3g} m/s by {frame.time_s:.4g} s"
    free = ~scene.body.held
    ground = scene.settings.ground
    if ground is not None:
        depth = ground.height_m - float(frame.positions_m[free, 2].min())
        if depth > dx_m:
            return f"a particle is {depth / dx_m:.2f} cells below the ground at {frame.time_s:.4g} s"
    for obstacle in scene.settings.obstacles:
        if isinstance(obstacle.shape, HollowBall | HalfSpace):
            depth = float((-obstacle.shape.distances(frame.positions_m[free])[0]).max())
            if depth > dx_m:
                return f"a particle is {depth / dx_m:.2f} cells behind a wall at {frame.time_s:.4g} s"
    return ""


def in_batches(first: int, count: int) -> Iterator[Verdict]:
    """Judge the scenes of seeds ``first`` to ``first + count`` in processes of their own."""
    seed, last = first, first + count
    while seed < last:
        batch = min(_BATCH, last - seed)
        command = [sys.executable, "-m", "validation.random_run", str(seed), str(batch)]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=_TIME_LIMIT_S)
        verdicts = [Verdict(**json.loads(line)) for line in done.stdout.splitlines() if line.startswith("{")]
        yield from verdicts
        seed += len(verdicts)
        if len(verdicts) < batch:
            words = done.stderr.strip().splitlines()[-1:] or [""]
            yield Verdict(seed, "", fault=f"the process ended with code {done.returncode}: {words[0]}")
            seed += 1


def _batch(first: int, count: int) -> None:
    for seed in range(first, first + count):
        print(json.dumps(asdict(judge(seed))), flush=True)


if __name__ == "__main__":
    _batch(int(sys.argv[1]), int(sys.argv[2]))
