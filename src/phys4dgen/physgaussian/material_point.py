"""PhysGaussian's stress and plastic flow at single material points, as they are and as they were meant.

Every substep it takes F_trial = (I + dt grad v) F, maps it back to an elastic F, and computes that one's Kirchhoff
stress tau. In the principal axes, with the stretches s_i, eps_i = ln max(s_i, 0.01), their trace tr, their deviator e_i
and its norm n, the return maps are

    metal        2 mu n > Y:  dg = n - Y/(2 mu),  eps -= dg e/n;  with hardening Y += 2 mu xi dg
    plasticine   as metal, but Y -= softening dg;  Y <= 0 breaks it: mu = lam = 0;  elastic if Y <= 0 at first
    foam         y = 2 mu n - sqrt(2/3) Y > 0:  2 mu n -= y / (1 + eta/(2 m dt)),  m = mu (s_1^2 + s_2^2 + s_3^2)/3
    sand         dg = n + a tr (3 lam + 2 mu)/(2 mu),  a = sqrt(2/3) 2 sin phi / (3 - sin phi);
                 dg > 0:  eps = 0 if tr > 0, else eps -= dg e/n

and none for jelly and snow. The stress is

    jelly, plasticine    tau_i = 2 mu (s_i - 1) s_i + lam J (J - 1)
    metal, foam, sand    tau_i = 2 mu eps_i + lam tr
    snow                 0

As they are (``compat``), metal and foam have tau_i s_i in its place: it is assembled as U tau V^T F^T. That is not the
derivative of any energy; ``corrected`` leaves the factor out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.physgaussian.configuration import Configuration, Mode

__all__ = ["Points", "respond", "stress_excess"]

_LEAST_STRETCH = 0.01
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Points:
    """N material points of one material.

    Attributes:
        material: one of PhysGaussian's six.
        mu_pa, lam_pa: Lame parameters, [N].
        yield_stress_pa: Y, [N].
        damaged: whether softening is on, which is decided by Y > 0 at first, [N].
        hardening_xi: xi where hardening is on, else 0.
        softening_pa: loss of Y per plastic strain.
        viscosity_pas: eta of foam.
        friction_angle_deg: phi of sand.
    """

    material: str
    mu_pa: Array
    lam_pa: Array
    yield_stress_pa: Array
    damaged: NDArray[np.bool_]
    hardening_xi: float = 0.0
    softening_pa: float = 0.0
    viscosity_pas: float = 0.0
    friction_angle_deg: float = 25.0

    @classmethod
    def of(cls, config: Configuration, count: int) -> Points:
        """``count`` points of a configuration's base material, at rest."""
        mu = config.E / (2 * (1 + config.nu))
        lam = config.E * config.nu / ((1 + config.nu) * (1 - 2 * config.nu))
        return cls(
            material=config.material,
            mu_pa=np.full(count, mu),
            lam_pa=np.full(count, lam),
            yield_stress_pa=np.full(count, config.yield_stress),
            damaged=np.full(count, config.material == "plasticine" and config.yield_stress > 0),
            hardening_xi=config.xi if config.hardening == 1 else 0.0,
            softening_pa=config.softening,
            viscosity_pas=config.plastic_viscosity,
            friction_angle_deg=config.friction_angle,
        )


def respond(points: Points, trial: NDArray[Any], *, dt_s: float, mode: Mode) -> tuple[Array, Array, Points]:
    """One substep of material points.

    Args:
        points: their numbers before it.
        trial: F_trial, [N, 3, 3], determinant positive.
        dt_s: the substep.
        mode: ``compat`` as PhysGaussian computes it, ``corrected`` without the extra factor.

    Returns:
        Elastic F [N, 3, 3], Kirchhoff stress [N, 3, 3] in Pa, and the points' numbers after it.
    """
    u, s, vt = np.linalg.svd(np.asarray(trial, np.float64))
    stretches, points = _returned(points, s, dt_s)
    elastic = (u * stretches[:, None, :]) @ vt
    principal = _principal_stress(points, stretches, mode)
    return elastic, (u * principal[:, None, :]) @ np.swapaxes(u, 1, 2), points


def stress_excess(config: Configuration, strain: float) -> float:
    """How far PhysGaussian's stress is off, relative to the one meant, at a shear of so much Hencky strain."""
    trial = np.diag(np.exp([strain, -strain, 0.0]))[None]
    free = replace(Points.of(config, 1), yield_stress_pa=np.full(1, np.inf))
    as_it_is = respond(free, trial, dt_s=config.substep_dt, mode="compat")[1]
    as_meant = respond(free, trial, dt_s=config.substep_dt, mode="corrected")[1]
    return float(np.linalg.norm(as_it_is - as_meant) / np.linalg.norm(as_meant))


def _returned(points: Points, stretches: Array, dt_s: float) -> tuple[Array, Points]:
    """Elastic stretches [N, 3] after the return map, and the numbers that it changes."""
    if points.material in ("jelly", "snow"):
        return stretches, points
    eps = np.log(np.maximum(stretches, _LEAST_STRETCH))
    trace = eps.sum(1, keepdims=True)
    hat = eps - trace / 3
    norm = np.maximum(np.linalg.norm(hat, axis=1, keepdims=True), 1e-300)
    mu = points.mu_pa[:, None]
    if points.material == "sand":
        return _of_sand(points, stretches, trace, hat, norm), points
    yield_pa = points.yield_stress_pa[:, None]
    if points.material == "foam":
        excess = 2 * mu * norm - np.sqrt(2 / 3) * yield_pa
        viscous = mu * (stretches**2).mean(1, keepdims=True)
        slowed = 2 * mu * norm - excess / (1 + points.viscosity_pas / (2 * viscous * dt_s))
        flowed = np.exp(trace / 3 + hat / norm * slowed / (2 * mu))
        return np.where(excess > 0, flowed, stretches), points
    softens = points.material == "plasticine"
    alive = mu > 0
    flow = np.where(alive, norm - yield_pa / (2 * np.where(alive, mu, 1)), 0.0)
    flows = (flow > 0) & alive & (points.damaged[:, None] | (not softens))
    flow = np.where(flows, flow, 0.0)
    change = -points.softening_pa * flow if softens else 2 * mu * points.hardening_xi * flow
    left = points.yield_stress_pa + change[:, 0]
    broken = softens & points.damaged & (left <= 0)
    after = replace(
        points,
        yield_stress_pa=left,
        mu_pa=np.where(broken, 0.0, points.mu_pa),
        lam_pa=np.where(broken, 0.0, points.lam_pa),
    )
    return np.where(flows, np.exp(eps - flow * hat / norm), stretches), after


def _of_sand(points: Points, stretches: Array, trace: Array, hat: Array, norm: Array) -> Array:
    """Drucker and Prager without volume correction."""
    mu, lam = points.mu_pa[:, None], points.lam_pa[:, None]
    sine = np.sin(np.radians(points.friction_angle_deg))
    alpha = np.sqrt(2 / 3) * 2 * sine / (3 - sine)
    flow = norm + (3 * lam + 2 * mu) / (2 * mu) * trace * alpha
    slid = np.exp(trace / 3 + hat - flow * hat / norm)
    return np.where(flow <= 0, stretches, np.where(trace > 0, 1.0, slid))


def _principal_stress(points: Points, stretches: Array, mode: Mode) -> Array:
    """Principal Kirchhoff stresses [N, 3]."""
    mu, lam = points.mu_pa[:, None], points.lam_pa[:, None]
    if points.material == "snow":
        return np.zeros_like(stretches)
    if points.material in ("jelly", "plasticine"):
        volume = stretches.prod(1, keepdims=True)
        return 2 * mu * (stretches - 1) * stretches + lam * volume * (volume - 1)
    eps = np.log(np.maximum(stretches, _LEAST_STRETCH))
    tau = 2 * mu * eps + lam * eps.sum(1, keepdims=True)
    return tau * stretches if mode == "compat" and points.material in ("metal", "foam") else tau
