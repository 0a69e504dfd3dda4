"""The strain with which a body is in equilibrium with its weight in the shape that it has.

A captured shape hangs already: its stress balances its weight. Weight on an unstrained body of that shape would make it
sag a second time. Here the stress is found first, and with it the deformation gradient F0 that has it; the film starts
from F0 and stays still.

1. Displacements u of the grid with K u = weight, K the stiffness in the shape given (``stiffness``). The problem is
   linear, for the shape does not change: conjugate gradients, preconditioned by passing forces through the particles,
   which leaves the displacements that they can have. Their strains give a stress that balances the weight.
2. F0 of each particle, symmetric, with just that stress under the particle's own law (``Law.stretches``). So the
   balance holds for large strains as well; plastic flow is left out.

Forces balance to the tolerance; whether the equilibrium is stable is not asked: a plant too soft to carry itself falls.

Sources: M. R. Hestenes, E. Stiefel, *Methods of conjugate gradients for solving linear systems*, J. Res. NBS 49
(1952); J. Hsu et al., *A general two-stage initialization for sag-free deformable simulations*, SIGGRAPH 2022 (forces
first, then the rest shape of each element).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm.body import Body
from phys4dgen.mpm.laws import LAWS, LawId
from phys4dgen.mpm.settings import Settings
from phys4dgen.mpm.stiffness import Stiffness

__all__ = ["Prestress", "prestress", "since_start", "stiffened"]

_FIRST_LOOK = 50
_NEXT_LOOK = 1.25  # times the iterations so far
_SEEN_PERCENTILE = 99.0


@dataclass(frozen=True, eq=False)
class Prestress:
    """The strain at t = 0.

    Attributes:
        deformation_gradients: F0, symmetric, of all particles, for ``Body.initial_gradients``; I where there is none,
            shape [P, 3, 3].
        carried: particles that have one, and are not held, shape [P], bool.
        strains: of the linear problem, [P, 3, 3].
        largest_strain: of a principal stretch less 1.
        sag_m: how far the body would sag without it, by the linear problem (99th percentile).
        change_m: by how much the last fifth of the iterations changed that: what is left to move.
        iterations: of conjugate gradients: two passes over the particles and a coarse solution each.
        converged: whether ``change_m`` is within the tolerance.
        hanging_share: of the mass, which hangs on nothing.
        simulated: the body that has it, the skin of held parts moving.
    """

    deformation_gradients: NDArray[np.float64]
    carried: NDArray[np.bool_]
    strains: NDArray[np.float64]
    largest_strain: float
    sag_m: float
    change_m: float
    iterations: int
    converged: bool
    hanging_share: float
    simulated: Body


def prestress(
    body: Body,
    settings: Settings,
    *,
    gravity_ms2: tuple[float, float, float],
    tolerance_m: float,
    standing_sag_m: float = math.inf,
    largest_sag_m: float = math.inf,
    most_iterations: int = 3000,
    on_progress: Callable[[int, int], None] | None = None,
) -> Prestress | None:
    """Find the strain with which a body carries its weight; None where nothing both bends and hangs on something.

    What carries: held particles, what is driven at t = 0 (pins), a ground that lets nothing go.

    Args:
        body: unstrained.
        settings: of the film.
        gravity_ms2: that the shape is in equilibrium with.
        tolerance_m: of ``Prestress.change_m``.
        standing_sag_m: what sags by more may be balanced worse in proportion: it will be made stiffer (``stiffened``).
        largest_sag_m: iterations end where the body would sag by more, and the result is of no use but to say so.
        most_iterations: after which the result stands as it is.
        on_progress: called with (iterations, most).
    """
    stiffness = Stiffness(body, settings)
    if not stiffness.carried.any():
        return None
    solution = np.zeros_like(stiffness.weight(gravity_ms2))
    residual = stiffness.weight(gravity_ms2)
    direction = stiffness.through_particles(residual)
    energy = _dot(residual, direction)
    moved, strains = np.zeros((len(body), 3)), np.zeros((len(body), 3, 3))
    iteration, look, change_m, converged = 0, _FIRST_LOOK, np.inf, False
    while iteration < most_iterations and not converged and energy > 0:
        forces = stiffness.forces(direction)
        step = energy / _dot(direction, forces)
        solution += step * direction
        residual -= step * forces
        smoothed = stiffness.through_particles(residual)
        before, energy = energy, _dot(residual, smoothed)
        direction = smoothed + energy / before * direction
        iteration += 1
        if iteration in (look, most_iterations):
            last = moved
            moved, strains = stiffness.particles_at(solution)
            change_m, sag_m = _seen_m(moved - last, stiffness.carried), _seen_m(moved, stiffness.carried)
            converged = change_m <= tolerance_m * max(1.0, sag_m / standing_sag_m)
            if sag_m > largest_sag_m:
                break
            look = int(_NEXT_LOOK * iteration)
            if on_progress is not None:
                on_progress(iteration, most_iterations)
    gradients = _with_the_stress_of(strains, stiffness.body, stiffness.carried)
    return Prestress(
        gradients,
        stiffness.carried & ~body.held,
        strains,
        _largest_strain(gradients[stiffness.carried]),
        _seen_m(moved, stiffness.carried),
        float(change_m),
        iteration,
        converged,
        stiffness.hanging_share,
        stiffness.body,
    )


def stiffened(found: Prestress, factor: float) -> Prestress:
    """The prestress of the same body with ``factor`` times its Young's moduli: the same stress, smaller strains."""
    body = replace(found.simulated, youngs_modulus_pa=factor * found.simulated.youngs_modulus_pa)
    strains = found.strains / factor
    strained = (strains != 0).any((1, 2))
    gradients = _with_the_stress_of(strains, body, strained)
    return replace(
        found,
        deformation_gradients=gradients,
        strains=strains,
        largest_strain=_largest_strain(gradients[strained]),
        sag_m=found.sag_m / factor,
        change_m=found.change_m / factor,
        simulated=body,
    )


def since_start(deformation_gradients: NDArray[np.float32], body: Body) -> NDArray[np.float32]:
    """F F0^-1, the deformation of the shape given, of total gradients [P, 3, 3] of a ``Frame`` of ``body``."""
    if body.initial_gradients is None:
        return deformation_gradients
    initial = np.where(body.held[:, None, None], np.eye(3), body.initial_gradients)
    return (deformation_gradients.astype(np.float64) @ np.linalg.inv(initial)).astype(np.float32)


def _dot(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    return float((first * second).sum())  # in an order that does not depend on threads, as that of BLAS may


def _seen_m(displacements: NDArray[np.float64], carried: NDArray[np.bool_]) -> float:
    return float(np.percentile(np.linalg.norm(displacements[carried], axis=1), _SEEN_PERCENTILE))


def _largest_strain(gradients: NDArray[np.float64]) -> float:
    return float(np.abs(np.linalg.eigvalsh(gradients) - 1).max(initial=0.0))


def _with_the_stress_of(strains: NDArray[np.float64], body: Body, carried: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Symmetric gradients [P, 3, 3] that have under each particle's law the stress of linear elasticity."""
    gradients = np.tile(np.eye(3), (len(body), 1, 1))
    mu, lam = body.lame_mu_pa, body.lame_lambda_pa
    for law_id in np.unique(body.law[carried]):
        stretches: Any = LAWS[LawId(law_id)].stretches
        mine = np.flatnonzero(carried & (body.law == law_id))
        principal, axes = np.linalg.eigh(strains[mine])
        tau = 2 * mu[mine, None] * principal + (lam[mine] * principal.sum(1))[:, None]
        stretch = stretches(tau, mu[mine], lam[mine])
        gradients[mine] = (axes * stretch[:, None, :]) @ np.swapaxes(axes, 1, 2)
    return gradients
