"""Motion presets: what is held, what pushes, how it is damped.

``drop``: nothing is held, and weight pulls the object down on a ground below it.

``sway``: what stands on the ground is held, a gust moves the rest. The same 3-5 m/s2 gave 15 mm on one object and
255 mm on another (MOTION.md, technique 10), so the gust is scaled by a probe: the first half second under a weak gust
gives the motion per m/s2 and the frequency, which also sets the damping. The probe runs on the grid of the film: on
one twice as coarse leaves weld into clumps, and the plant that it was tried on moved 2.3 times too far afterwards.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import SceneError, SimulationError, did_you_mean
from phys4dgen.mpm import Acceleration, Body, Settings, Simulator
from phys4dgen.types import Continuum, Frame, Parts

__all__ = [
    "LOWEST_SHARE",
    "Held",
    "ProbeResult",
    "choose_held",
    "damped_drop_per_s",
    "damped_frequency",
    "damping_per_s",
    "gust",
    "gust_response_frequency",
    "probe_gust",
]

_ON_GROUND = 0.06
_LOW_TOP = 0.6
_LOW_SHARE = 0.9
"""Of a part that must be low: a pot of which a petal's bright rim has been taken for a piece still is a pot."""
_LEAST_FOOT = 0.5
"""Share of what lies on the ground that must belong to the parts that are held."""
_RIM = 0.03
LOWEST_SHARE = 0.1
_PROBE_MS2 = 1.0
_PROBE_FPS = 24.0
_LONGEST_PROBE_S = 0.5  # what swings more slowly goes a little farther than it was aimed at
_PAST_PEAK = 0.97
_ASSUMED_FREQUENCY_HZ = 1.0
_DROP_FREQUENCY_HZ = 2.0


@dataclass(frozen=True, eq=False)
class Held:
    """What does not move.

    Attributes:
        particles: held particles, [P], bool.
        parts: names of the parts that are held as a whole.
        reason: one sentence for the report.
    """

    particles: NDArray[np.bool_]
    parts: tuple[str, ...]
    reason: str


@dataclass(frozen=True, eq=False)
class ProbeResult:
    """What the probe found.

    Attributes:
        acceleration_ms2: gust that reaches the amplitude aimed at.
        frequency_hz: of the swing that the gust excites.
        displacement_per_ms2_m: 99th percentile of the largest displacement per m/s2 of gust.
        strain_per_ms2: largest strain of each particle (of the Green tensor, Frobenius norm) per m/s2 of gust, as
            simulated, [P].
    """

    acceleration_ms2: float
    frequency_hz: float
    displacement_per_ms2_m: float
    strain_per_ms2: NDArray[np.float64]


def choose_held(
    continuum: Continuum,
    parts: Parts,
    *,
    frame: Frame,
    holds: Mapping[str, str],
    automatic: bool,
    lowest_share: float = LOWEST_SHARE,
) -> Held:
    """Decide which particles are held.

    Args:
        continuum: particles.
        parts: names and number of parts.
        frame: input coordinates -> metres.
        holds: "fixed", "rigid" or "free" by part name, as the user wants it; other parts are decided here.
        automatic: hold what stands on the ground; otherwise only what the user names.
        lowest_share: of the height, held where no part stands on the ground by itself.

    Raises:
        SceneError: a part that the user names does not exist.
    """
    for name in holds:
        if name not in parts.names:
            raise SceneError(
                f"parts: there is no part '{name}' to hold; the parts are {', '.join(parts.names)}."
                f"{did_you_mean(name, parts.names)}"
            )
    named = {n for n, hold in holds.items() if hold == "fixed"}
    free = {n for n, hold in holds.items() if hold in ("free", "rigid")}
    if not automatic or named:
        return _held_parts(continuum, parts, named, "held as asked for" if named else "nothing is held")
    z = frame.to_metres(continuum.positions)
    low, high = np.percentile(z[:, 2], [0.5, 99.5])
    standing = _standing_parts(z, continuum.part, parts, low, high)
    standing = {parts.names[p] for p in standing} - free
    if standing and len(standing) < parts.count:
        return _held_parts(
            continuum, parts, standing, "stands on the ground below 60 % of the height, with what it encloses"
        )
    lowest = z[:, 2] < low + lowest_share * (high - low)
    may = np.isin(continuum.part, [i for i, name in enumerate(parts.names) if name not in free])
    share = f"the lowest {100 * lowest_share:.0f} % is held"
    return Held(lowest & may, (), f"no part stands on the ground with another above it: {share}")


def _held_parts(continuum: Continuum, parts: Parts, names: set[str], reason: str) -> Held:
    numbers = [i for i, name in enumerate(parts.names) if name in names]
    ordered = tuple(parts.names[i] for i in numbers)
    return Held(np.isin(continuum.part, numbers), ordered, f"{', '.join(ordered)}: {reason}" if ordered else reason)


def _standing_parts(
    z_m: NDArray[np.float64], part: NDArray[np.int32], parts: Parts, low: float, high: float
) -> set[int]:
    """Parts on the ground whose top is low, and the parts that these enclose (soil, rim)."""
    height = high - low
    standing = set()
    for number in range(parts.count):
        own = z_m[part == number, 2]
        if len(own):
            bottom, top = np.percentile(own, [1, 100 * _LOW_SHARE])
            if bottom < low + _ON_GROUND * height and top < low + _LOW_TOP * height:
                standing.add(number)
    foot = part[z_m[:, 2] < low + _ON_GROUND * height]
    if np.isin(foot, list(standing)).mean() < _LEAST_FOOT:  # a ball at the breast of a duck does not carry the duck
        return set()
    ground = z_m[np.isin(part, list(standing))]
    box_low, box_high = np.percentile(ground[:, :2], [0.5, 99.5], axis=0)
    top = np.percentile(ground[:, 2], 99.5)
    margin = 0.02 * height
    for number in range(parts.count):
        own = z_m[part == number]
        if number in standing or len(own) == 0:
            continue
        inside = ((own[:, :2] > box_low - margin) & (own[:, :2] < box_high + margin)).all(1)
        if (inside & (own[:, 2] < top + _RIM * height)).mean() > 0.95:
            standing.add(number)
    return standing


def gust(direction_up: NDArray[np.float64], acceleration_ms2: float, duration_s: float) -> Acceleration:
    """The gust of ``sway``: a constant acceleration of everything that is not held, from t = 0.

    Args:
        direction_up: unit vector, axes with z up.
        acceleration_ms2: its strength.
        duration_s: its length.
    """
    x, y, z = (float(v) for v in acceleration_ms2 * direction_up)
    return Acceleration((x, y, z), to_s=duration_s)


def damping_per_s(damping_ratio: float, frequency_hz: float) -> float:
    """Mass-proportional damping alpha = 4 pi zeta f1 (ARCHITECTURE.md 5.5)."""
    return 4 * math.pi * damping_ratio * frequency_hz


def damped_drop_per_s(damping_ratio: float) -> float:
    """Damping of what falls: as of a swing at 2 Hz, since no gust says how fast it swings."""
    return damping_per_s(damping_ratio, _DROP_FREQUENCY_HZ)


def probe_gust(
    body: Body,
    settings: Settings,
    *,
    direction_up: NDArray[np.float64],
    duration_s: float,
    aim_m: float,
    damping_ratio: float,
    on_frame: Callable[[int, int], None] | None = None,
) -> ProbeResult:
    """Run the body under 1 m/s2 until it swings back, and scale the gust to the displacement aimed at.

    Args:
        body: as it will be simulated.
        settings: of the film; loads, damping and frame time are the probe's own.
        direction_up: unit vector of the gust, z up.
        duration_s: of the gust.
        aim_m: 99th percentile of the free particles' largest displacement to reach, m.
        damping_ratio: zeta.
        on_frame: called with (frame, most frames).

    Raises:
        SimulationError: nothing is free to move.
    """
    free = ~body.held
    if not free.any():
        raise SimulationError("sway: every part is held, so that nothing can move; free one with 'hold: free'.")
    simulator = Simulator(
        body,
        replace(
            settings,
            frame_time_s=1 / _PROBE_FPS,
            gravity_ms2=(0.0, 0.0, 0.0),
            loads=(gust(direction_up, _PROBE_MS2, duration_s),),
            damping_per_s=damping_per_s(damping_ratio, _ASSUMED_FREQUENCY_HZ),
        ),
    )
    rest = body.positions_m[free]
    most = math.ceil((_LONGEST_PROBE_S + duration_s) * _PROBE_FPS)
    reached, strain = np.zeros(len(rest)), np.zeros(len(body))
    history: list[NDArray[np.float64]] = []
    largest = 0.0
    for k in range(most):
        state = simulator.advance()
        displacement = state.positions_m[free] - rest
        gradients = state.deformation_gradients.astype(np.float64)
        green = 0.5 * (np.einsum("pai,paj->pij", gradients, gradients) - np.eye(3))
        strain = np.maximum(strain, np.linalg.norm(green, axis=(1, 2)))
        size = np.linalg.norm(displacement, axis=1)
        reached = np.maximum(reached, size)
        history.append(displacement @ direction_up)
        now = float(np.percentile(size, 99))
        largest = max(largest, now)
        if on_frame is not None:
            on_frame(k + 1, most)
        if (k + 1) / _PROBE_FPS > duration_s and now < _PAST_PEAK * largest:
            break
    per_ms2 = float(np.percentile(reached, 99)) / _PROBE_MS2
    if per_ms2 <= 0:
        raise SimulationError("sway: the gust of the probe moved nothing; check what is held.")
    # What swings far is what is seen after the gust, so it sets the damping; a plain mean is led by stiff stalks.
    signal = np.array(history) @ reached**2
    frequency = gust_response_frequency(signal, 1 / _PROBE_FPS, duration_s)
    return ProbeResult(aim_m / per_ms2, frequency, per_ms2, strain / _PROBE_MS2)


def gust_response_frequency(signal: Sequence[float] | NDArray[np.float64], step_s: float, gust_s: float) -> float:
    """Frequency in Hz of the single oscillator whose answer to a gust fits best.

    Args:
        signal: displacement at step_s, 2 step_s ... from the start of the gust.
        step_s: time between two values.
        gust_s: length of the gust.

    The answer of x'' + 2 zeta w x' + w^2 x = a to a load from 0 to gust_s is s(t) - s(t - gust_s), with the step
    response s(t) = 1 - exp(-zeta w t) (cos w' t + zeta / sqrt(1 - zeta^2) sin w' t).
    """
    y = np.asarray(signal, np.float64)
    t = step_s * np.arange(1, len(y) + 1, dtype=np.float64)
    best = (math.inf, _ASSUMED_FREQUENCY_HZ)
    for frequency in np.geomspace(0.15, 0.4 / step_s, 240):
        for zeta in (0.02, 0.06, 0.12, 0.2):
            model = _step_response(t, frequency, zeta) - _step_response(t - gust_s, frequency, zeta)
            scale = float(model @ y) / max(float(model @ model), 1e-300)
            error = float(((y - scale * model) ** 2).sum())
            if error < best[0]:
                best = (error, float(frequency))
    return best[1]


def _step_response(t: NDArray[np.float64], frequency: float, zeta: float) -> NDArray[np.float64]:
    t = np.maximum(t, 0)
    w = 2 * math.pi * frequency
    root = math.sqrt(1 - zeta**2)
    swing = np.cos(w * root * t) + zeta / root * np.sin(w * root * t)
    return 1 - np.exp(-zeta * w * t) * swing


def damped_frequency(signal: Sequence[float] | NDArray[np.float64], step_s: float) -> tuple[float, float]:
    """Frequency in Hz and damping ratio of the damped oscillation that fits a free decay best.

    Least squares of exp(-s t) (a cos wt + b sin wt) + c over a grid of w and s, refined once.
    """
    y = np.asarray(signal, np.float64)
    t = np.arange(len(y)) * step_s
    span = max(t[-1], step_s)
    low, high = 0.25 / span, min(0.4 / step_s, 15.0)
    best = (math.inf, low, 0.0)
    frequencies = np.geomspace(low, max(high, 2 * low), 120)
    ratios = np.array([0.0, 0.02, 0.05, 0.08, 0.12, 0.18, 0.26])
    for _ in range(2):
        for f in frequencies:
            for zeta in ratios:
                envelope = np.exp(-2 * math.pi * f * zeta * t)
                phase = 2 * math.pi * f * math.sqrt(1 - zeta**2) * t
                basis = np.stack([envelope * np.cos(phase), envelope * np.sin(phase), np.ones_like(t)], 1)
                _, residual, *_ = np.linalg.lstsq(basis, y, rcond=None)
                error = float(residual[0]) if len(residual) else math.inf
                if error < best[0]:
                    best = (error, float(f), float(zeta))
        frequencies = best[1] * np.linspace(0.93, 1.07, 21)
        ratios = np.clip(best[2] + np.linspace(-0.04, 0.04, 17), 0, 0.6)
    return best[1], best[2]
