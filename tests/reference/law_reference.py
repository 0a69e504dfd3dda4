"""Float64 NumPy twins of the constitutive laws, from the equations and apart from the kernels.

Elastic strain is kept as F_E (the engine keeps b) and decomposed by LAPACK; every law is one class with ``step``.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq


def energy(law, F, mu, lam):
    """Stored energy per rest volume of the elastic laws, [P]; F [P, 3, 3], mu, lam scalars or [P]."""
    s = np.linalg.svd(F, compute_uv=False)
    J = s.prod(-1)
    if law == "neo_hookean":
        return mu / 2 * ((s**2).sum(-1) - 3) - mu * np.log(J) + lam / 2 * np.log(J) ** 2
    if law == "fixed_corotated":
        return mu * ((s - 1) ** 2).sum(-1) + lam / 2 * (J - 1) ** 2
    if law == "stvk_hencky":
        return mu * (np.log(s) ** 2).sum(-1) + lam / 2 * np.log(J) ** 2
    if law == "fluid":  # K in the place of lam
        return lam / 7 * ((J**-6 - 1) / 6 + J - 1)
    raise ValueError(law)


def kirchhoff(law, F, mu, lam):
    """tau of the elastic laws from principal stresses, [P, 3, 3]."""
    U, s, _ = np.linalg.svd(F)
    J = s.prod(-1, keepdims=True)
    mu, lam = (np.broadcast_to(value, len(F))[:, None] for value in (mu, lam))
    principal = {
        "neo_hookean": mu * (s**2 - 1) + lam * np.log(J),
        "fixed_corotated": 2 * mu * (s - 1) * s + lam * J * (J - 1),
        "stvk_hencky": 2 * mu * np.log(s) + lam * np.log(J),
        "fluid": -J * lam / 7 * (J**-7 - 1) * np.ones(3),
    }[law]
    return np.einsum("pij,pj,pkj->pik", U, principal, U)


class _Plastic:
    """F_E <- (1 + dt C) F_E, then ``flow`` of the Hencky strains of each point."""

    def __init__(self, count, mu, lam):
        self.F = np.tile(np.eye(3), (count, 1, 1))
        self.mu, self.lam = (np.broadcast_to(value, count).astype(float) for value in (mu, lam))

    def step(self, C, dt):
        trial = (np.eye(3) + dt * C) @ self.F
        U, s, Vt = np.linalg.svd(trial)
        eps = np.stack([self.flow(p, np.log(s[p]), dt) for p in range(len(s))])
        self.F = np.einsum("pij,pj,pjk->pik", U, np.exp(eps), Vt)
        return np.einsum("pij,pj,pkj->pik", U, self.principal_stress(eps), U)

    def principal_stress(self, eps):
        return 2 * self.mu[:, None] * eps + self.lam[:, None] * eps.sum(-1, keepdims=True)


class VonMises(_Plastic):
    def __init__(self, count, mu, lam, *, yield_stress, hardening=0.0, residual=0.0):
        super().__init__(count, mu, lam)
        self.yield_stress, self.hardening, self.residual = yield_stress, hardening, residual
        self.a = np.zeros(count)  # equivalent plastic strain

    def strength(self, a):
        return max(self.yield_stress + self.hardening * a, self.residual)

    def flow(self, p, eps, dt):
        dev = eps - eps.mean()
        norm = np.linalg.norm(dev)

        def beyond(dg):
            return 2 * self.mu[p] * (norm - dg) - np.sqrt(2 / 3) * self.strength(self.a[p] + np.sqrt(2 / 3) * dg)

        if beyond(0.0) <= 0:
            return eps
        dg = brentq(beyond, 0, norm, xtol=1e-16)
        self.a[p] += np.sqrt(2 / 3) * dg
        return eps - dg * dev / norm


class DruckerPrager(_Plastic):
    def __init__(self, count, mu, lam, *, angle_deg, cohesion=0.0):
        super().__init__(count, mu, lam)
        sine = np.sin(np.radians(angle_deg))
        self.alpha = np.sqrt(2 / 3) * 2 * sine / (3 - sine)
        self.bulk = self.lam + 2 / 3 * self.mu
        self.tip = cohesion / np.tan(np.radians(angle_deg)) / (3 * self.bulk)
        self.gap = np.zeros(count)

    def flow(self, p, eps, dt):
        eps = eps + self.gap[p] / 3
        tip = 0.0 if self.gap[p] > 0 else self.tip[p]
        shifted = eps - tip
        if shifted.sum() > 0:
            self.gap[p] = eps.sum()
            return np.zeros(3)
        self.gap[p] = 0.0
        dev = shifted - shifted.mean()
        norm = np.linalg.norm(dev)
        # in stresses: |dev tau| <= alpha * 3 * (-mean stress of the shifted strain)
        allowed = self.alpha * -3 * self.bulk[p] * shifted.sum() / (2 * self.mu[p])
        return eps if norm <= allowed else eps - dev + dev * allowed / norm


class Snow(_Plastic):
    def __init__(self, count, mu, lam, *, compression, stretch, hardening):
        super().__init__(count, mu, lam)
        self.low, self.high, self.xi = 1 - compression, 1 + stretch, hardening
        self.jp = np.ones(count)

    def flow(self, p, eps, dt):
        s = np.exp(eps)
        kept = np.clip(s, self.low, self.high)
        self.jp[p] = np.clip(self.jp[p] * (s / kept).prod(), 0.6, 20)
        return np.log(kept)

    def principal_stress(self, eps):
        s, hardness = np.exp(eps), np.minimum(np.exp(self.xi * (1 - self.jp)), 10)[:, None]
        J = s.prod(-1, keepdims=True)
        return hardness * (2 * self.mu[:, None] * (s - 1) * s + self.lam[:, None] * J * (J - 1))


class HerschelBulkley(_Plastic):
    """With n = 1 also Bingham's law."""

    def __init__(self, count, mu, lam, *, yield_stress, consistency, exponent=1.0):
        super().__init__(count, mu, lam)
        self.radius, self.n = np.sqrt(2 / 3) * yield_stress, exponent
        self.resistance = 2 ** ((exponent + 1) / 2) * consistency

    def flow(self, p, eps, dt):
        dev = eps - eps.mean()
        norm = np.linalg.norm(dev)
        before = 2 * self.mu[p] * norm
        if before <= self.radius:
            return eps
        stiffness = 2 * self.mu[p] * np.exp(2 * eps).mean() * dt

        def residual(after):
            return before - after - stiffness * ((after - self.radius) / self.resistance) ** (1 / self.n)

        after = brentq(residual, self.radius, before, xtol=1e-13)
        return eps - dev + dev * after / before
