"""A law at 32 material points, driven by given velocity gradients through the engine's own functions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

import phys4dgen
from phys4dgen.mpm import Body, LawId
from phys4dgen.mpm.kernels.law_step import STRESS, law_step
from phys4dgen.mpm.kernels.layout import DISPLACEMENT_GRADIENT, LANES, LAW_COLUMNS, PADDED_TO

__all__ = ["COUNT", "Points", "deviator"]

COUNT = PADDED_TO
"""Points at once: a few batches of the kernels."""

_ROWS = STRESS // LANES + 6  # of a batch: velocity gradient and stress


def _forget_stale_kernels() -> None:
    """Numba sees when this file changes, but not when the laws do."""
    package = Path(phys4dgen.__file__).parent
    sources = [path for folder in ("mpm/laws", "mpm/kernels", "vector") for path in (package / folder).glob("*.py")]
    newest = max(path.stat().st_mtime for path in sources)
    for cached in (Path(__file__).parent / "__pycache__").glob("points.*.nb[ic]"):
        if cached.stat().st_mtime < newest:
            cached.unlink(missing_ok=True)


_forget_stale_kernels()


@njit(cache=True, fastmath=True, error_model="numpy")
def _step(law: Any, particles: Any, rows: Any, dt: Any) -> None:
    for batch in range(0, COUNT, LANES):
        law_step(law, particles, batch, COUNT, rows[batch * _ROWS : (batch + LANES) * _ROWS], dt)


class Points:
    """32 material points of one law.

    Attributes:
        body: them as a body.
        law: as the engine has it.
        mu, lam: Lame parameters, Pa, [32].
        parameters: the law's columns.
    """

    def __init__(self, law_id: LawId, *, E: ArrayLike = 1e5, nu: ArrayLike = 0.3, **numbers: ArrayLike) -> None:
        """Points at rest; numbers of the law (``types.LAW_NUMBERS``) may be scalars or [32]."""

        def full(value: ArrayLike) -> NDArray[np.float64]:
            return np.broadcast_to(np.asarray(value, float), (COUNT,)).copy()

        one = np.ones(COUNT)
        self.body = Body(
            np.zeros((COUNT, 3)), one, 1e3 * one, full(E), full(nu), np.full(COUNT, law_id), 0 * one, 0 * one,
            ("points",), law_numbers={name: full(value) for name, value in numbers.items()},
        )  # fmt: skip
        ((self.law, _),) = self.body.by_law(np.arange(COUNT))
        self.mu, self.lam = self.body.lame_mu_pa, self.body.lame_lambda_pa
        self._columns = np.zeros((LAW_COLUMNS + self.law.column_count, COUNT), np.float32)
        self.parameters = self.body.law_columns(self.law, np.arange(COUNT))
        self._columns[LAW_COLUMNS : LAW_COLUMNS + len(self.parameters)] = self.parameters

    def step(self, C: ArrayLike, dt: float = 1.0) -> NDArray[np.float64]:
        """Kirchhoff stress [32, 3, 3] after dt with velocity gradients C [32, 3, 3] (or [3, 3] for all)."""
        rows = np.full((COUNT // LANES, _ROWS, LANES), np.inf, np.float32)
        rows[:, :9] = np.broadcast_to(C, (COUNT, 3, 3)).reshape(-1, LANES, 9).transpose(0, 2, 1)
        _step(self.law, self._columns.ravel(), rows.ravel(), np.float32(dt))
        tau = rows[:, STRESS // LANES :].transpose(0, 2, 1).reshape(COUNT, 6)
        return tau[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(COUNT, 3, 3).astype(float)

    def deform(self, F: ArrayLike) -> NDArray[np.float64]:
        """Kirchhoff stress after one step that takes the points from rest to F."""
        return self.step(np.asarray(F, float) - np.eye(3))

    @property
    def F(self) -> NDArray[np.float64]:  # noqa: N802
        """As the engine carries it, [32, 3, 3]."""
        h = self._columns[DISPLACEMENT_GRADIENT : DISPLACEMENT_GRADIENT + 9].T.reshape(COUNT, 3, 3)
        return h.astype(float) + np.eye(3)

    @property
    def state(self) -> dict[str, NDArray[np.float64]]:
        """State columns by name, [32] each."""
        first = LAW_COLUMNS + len(self.law.parameters)
        return dict(zip(self.law.state, self._columns[first:].astype(float), strict=False))

    @property
    def elastic_b(self) -> NDArray[np.float64]:
        """Elastic left Cauchy-Green tensor of plastic laws, [32, 3, 3]."""
        state = self.state
        six = [state[f"strain_{ij}"] + state[f"rest_{ij}"] for ij in ("xx", "xy", "xz", "yy", "yz", "zz")]
        return np.stack(six)[[0, 1, 2, 1, 3, 4, 2, 4, 5]].T.reshape(COUNT, 3, 3) + np.eye(3)

    def energy_pa(self) -> NDArray[np.float64]:
        """The engine's energy density [32]."""
        first = LAW_COLUMNS + len(self.law.parameters)
        state = self._columns[first : first + len(self.law.state)].astype(float)
        return self.law.energy_density_pa(self.F, self.parameters, state)


def deviator(tau: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Deviatoric part of tensors [P, 3, 3] and its Frobenius norm [P]."""
    dev = tau - np.eye(3) * np.trace(tau, axis1=1, axis2=2)[:, None, None] / 3
    return dev, np.linalg.norm(dev, axis=(1, 2))
