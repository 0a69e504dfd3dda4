"""Float64 NumPy twin of the MPM engine, written from the equations and apart from the kernels.

MLS-MPM (Hu et al. 2018) with APIC (Jiang et al. 2015), quadratic B-splines, symplectic Euler; singular values by
LAPACK. Slow, dense and simple: every quantity of a substep is computed where the textbook has it.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.linalg import expm

NEO_HOOKEAN, FIXED_COROTATED = 0, 1


def kirchhoff_stress(F, mu, lam, law):
    """tau = P F^T from the first Piola-Kirchhoff stress of each law; F [P, 3, 3], mu, lam, law [P]."""
    U, _, Vt = np.linalg.svd(F)
    J = np.linalg.det(F)
    inverse_transposed = np.linalg.inv(F).transpose(0, 2, 1)
    m, ell, j = mu[:, None, None], lam[:, None, None], J[:, None, None]
    neo_hookean = m * (F - inverse_transposed) + ell * np.log(j) * inverse_transposed
    corotated = 2 * m * (F - U @ Vt) + ell * (j - 1) * j * inverse_transposed
    P = np.where((law == FIXED_COROTATED)[:, None, None], corotated, neo_hookean)
    return P @ F.transpose(0, 2, 1)


def stored_energy(F, mu, lam, law):
    """Energy per rest volume [P]."""
    s = np.linalg.svd(F, compute_uv=False)
    J = s.prod(1)
    neo_hookean = mu / 2 * ((s**2).sum(1) - 3) - mu * np.log(J) + lam / 2 * np.log(J) ** 2
    corotated = mu * ((s - 1) ** 2).sum(1) + lam / 2 * (J - 1) ** 2
    return np.where(law == FIXED_COROTATED, corotated, neo_hookean)


def _cross_matrix(w):
    """[w]x, so that [w]x r = w x r."""
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


class Reference:
    """State of P particles on a dense grid of ``nodes`` [nx, ny, nz] whose node 0 lies at ``origin``."""

    def __init__(self, x, v, mass, volume, mu, lam, law, *, dx, origin, nodes, held_nodes=None):
        self.x, self.v = np.array(x, float), np.array(v, float)
        self.mass, self.volume, self.mu, self.lam, self.law = mass, volume, mu, lam, law
        self.F = np.tile(np.eye(3), (len(x), 1, 1))
        self.C = np.zeros((len(x), 3, 3))
        self.dx, self.origin, self.nodes = dx, np.asarray(origin, float), tuple(nodes)
        self.held_nodes = held_nodes
        self.rigid = None
        self.ground = None

    def make_rigid(self, members):
        """Let the particles of a mask [P] move as one rigid body from now on."""
        m, r = self.mass[members], self.x[members] - self._centre(members)
        inertia = np.eye(3) * (m @ (r**2).sum(1) + m.sum() * self.dx**2 / 2) - (m[:, None] * r).T @ r
        self.rigid, self._inertia_at_rest, self._rotation, self._offsets = members, inertia, np.eye(3), r
        v = self.v[members]
        spin = np.linalg.solve(inertia - np.eye(3) * m.sum() * self.dx**2 / 2, m @ np.cross(r, v - m @ v / m.sum()))
        self.C[members] = _cross_matrix(spin)
        self._constraint = np.zeros_like(r)

    def _centre(self, members):
        return self.mass[members] @ self.x[members] / self.mass[members].sum()

    def _move_rigid(self, x_before, dt):
        """Velocities, gradients and places of the rigid body with the same momenta (midpoint rule for the rotation)."""
        g = self.rigid
        m, r, C = self.mass[g], self._offsets @ self._rotation.T, self.C[g]
        centre = m @ x_before[g] / m.sum()
        velocity = m @ self.v[g] / m.sum()
        of_points = self._inertia_at_rest - np.eye(3) * m.sum() * self.dx**2 / 2
        of_points = self._rotation @ of_points @ self._rotation.T
        closest = velocity + np.cross(np.linalg.solve(of_points, m @ np.cross(r, self.v[g])), r)
        self._constraint += (closest - self.v[g]) @ self._rotation  # of the group at rest: R^T u
        axial = np.stack([C[:, 2, 1] - C[:, 1, 2], C[:, 0, 2] - C[:, 2, 0], C[:, 1, 0] - C[:, 0, 1]], 1)
        momentum = m @ (np.cross(r, self.v[g]) + self.dx**2 / 4 * axial)

        def spin_at(rotation):
            return np.linalg.solve(rotation @ self._inertia_at_rest @ rotation.T, momentum)

        half = expm(_cross_matrix(dt / 2 * spin_at(self._rotation))) @ self._rotation
        self._rotation = expm(_cross_matrix(dt * spin_at(half))) @ self._rotation
        spin = spin_at(self._rotation)
        r = self._offsets @ self._rotation.T
        self.x[g] = centre + dt * velocity + r
        self.v[g] = velocity + np.cross(spin, r)
        self.C[g] = _cross_matrix(spin)
        self.F[g] = self._rotation

    def _stencil(self):
        place = (self.x - self.origin) / self.dx
        lowest = np.floor(place - 0.5).astype(int)
        for i, j, k in product(range(3), repeat=3):
            node = lowest + np.array([i, j, k])
            distance = np.abs(place - node)
            w = np.where(distance < 0.5, 0.75 - distance**2, 0.5 * (1.5 - distance) ** 2).prod(1)
            yield np.ravel_multi_index(tuple(node.T), self.nodes), w, (node - place) * self.dx

    def substep(self, dt, gravity=(0, 0, 0), kick=None, keep=1.0):
        """One substep; ``kick`` [P, 3] is velocity that particles gain, ``keep`` the share damping leaves."""
        count = int(np.prod(self.nodes))
        momentum, node_mass = np.zeros((count, 3)), np.zeros(count)
        tau = kirchhoff_stress(self.F, self.mu, self.lam, self.law)
        v = self.v if kick is None else self.v + kick
        if self.rigid is not None:
            v = v.copy()
            v[self.rigid] += self._constraint @ self._rotation.T
        for node, w, r in self._stencil():
            np.add.at(node_mass, node, w * self.mass)
            force = -4 / self.dx**2 * self.volume[:, None] * w[:, None] * np.einsum("pij,pj->pi", tau, r)
            carried = (w * self.mass)[:, None] * (v + np.einsum("pij,pj->pi", self.C, r))
            np.add.at(momentum, node, carried + dt * force)
        velocity = momentum / np.maximum(node_mass, 1e-300)[:, None]
        velocity = np.where(node_mass[:, None] > 0, (velocity + dt * np.asarray(gravity, float)) * keep, 0)
        if self.held_nodes is not None:
            velocity[self.held_nodes.ravel()] = 0
        if self.ground is not None:
            self._meet_ground(velocity)
        self.v = np.zeros_like(self.v)
        B = np.zeros_like(self.C)
        for node, w, r in self._stencil():
            self.v += w[:, None] * velocity[node]
            B += w[:, None, None] * velocity[node][:, :, None] * r[:, None, :]
        self.C = 4 / self.dx**2 * B
        x_before = self.x
        self.x = self.x + dt * self.v
        self.F = self.F + dt * self.C @ self.F
        if self.rigid is not None:
            self._move_rigid(x_before, dt)

    def _meet_ground(self, velocity):
        """Coulomb friction without tension at the nodes up to a height; ``ground`` is (z, friction)."""
        height, friction = self.ground
        z = self.origin[2] + np.arange(self.nodes[2]) * self.dx
        below = np.broadcast_to(z <= height + 1e-9, self.nodes).ravel()
        into = below & (velocity[:, 2] < 0)
        pressed = -velocity[into, 2]
        along = velocity[into] * [1, 1, 0]
        sliding = np.linalg.norm(along, axis=1)
        keep = np.maximum(0, 1 - friction * pressed / np.maximum(sliding, 1e-300))
        velocity[into] = along * keep[:, None]
