"""Materials that change in time: particles that melt, harden or burn down while they are simulated.

At the end of a frame particles whose time has come get the law and the numbers of their new material. Mass, place,
velocity and the deformation that moves Gaussians stay. Stress goes on from the elastic strain where the new law has
one; a fluid takes over the compression. What has flowed cannot take a law whose stress comes from
the deformation gradient itself, since its shape is not at rest any more: it hardens to a plastic law.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import SimulationError
from phys4dgen.mpm.body import Body
from phys4dgen.mpm.kernels.layout import AFFINE, DISPLACEMENT_GRADIENT, LAW_COLUMNS, POSITION, POSITION_REST, VELOCITY
from phys4dgen.mpm.laws import LAWS, Gradient, Law, LawId
from phys4dgen.mpm.loads import Selection
from phys4dgen.mpm.state import ELASTIC_STRAIN, STRAIN_INDICES, Particles
from phys4dgen.types import LAW_NUMBERS

__all__ = ["MaterialChange", "carry_over", "changed_body", "check_changes"]

_CARRIED = ((POSITION, 3), (POSITION_REST, 3), (VELOCITY, 3), (AFFINE, 9), (DISPLACEMENT_GRADIENT, 9))


@dataclass(frozen=True, eq=False)
class MaterialChange(Selection):
    """New material for some particles.

    Attributes:
        law: of the new material.
        youngs_modulus_pa, poisson_ratio: of the new material.
        at_s: when, shape [P] or one time for all.
        numbers: further numbers of the law (``types.LAW_NUMBERS``).
    """

    law: LawId
    youngs_modulus_pa: float
    poisson_ratio: float
    at_s: NDArray[np.float64] | float = 0.0
    numbers: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "numbers", MappingProxyType(dict(self.numbers)))

    def has_come(self, body: Body, time_s: float) -> NDArray[np.bool_]:
        """Particles of ``body`` that have changed by then, [P]; rigid ones never do."""
        return self.selects(body) & ~body.is_rigid & (np.asarray(self.at_s) <= time_s)


def changed_body(body: Body, changes: Sequence[MaterialChange], time_s: float) -> Body:
    """The body with the materials that it has at a time: of each particle the last change that has come."""
    law, modulus, poisson = body.law.copy(), body.youngs_modulus_pa.copy(), body.poisson_ratio.copy()
    assert body.law_numbers is not None
    names = {name for change in changes for name in change.numbers} | set(body.law_numbers)
    numbers = {name: body.law_numbers.get(name, np.full(len(body), np.nan)).copy() for name in names}
    since_s = np.full(len(body), -np.inf)
    for change in changes:
        mine = change.has_come(body, time_s) & (np.asarray(change.at_s) >= since_s)
        since_s[mine] = np.broadcast_to(change.at_s, len(body))[mine]
        law[mine], modulus[mine], poisson[mine] = int(change.law), change.youngs_modulus_pa, change.poisson_ratio
        for name, values in numbers.items():
            values[mine] = change.numbers.get(name, np.nan)
    if np.isneginf(since_s).all():
        return body
    return replace(body, law=law, youngs_modulus_pa=modulus, poisson_ratio=poisson, law_numbers=_complete(numbers, law))


def _complete(numbers: dict[str, NDArray[np.float64]], law: NDArray[np.int32]) -> dict[str, NDArray[np.float64]]:
    """Numbers with their defaults where a law has one and the change does not say it."""
    for law_id in np.unique(law):
        mine = law == law_id
        for number in LAW_NUMBERS[LawId(law_id).name.lower()]:
            if number.default is not None and number.name in numbers:
                values = numbers[number.name]
                values[mine & np.isnan(values)] = number.default
    return numbers


def check_changes(body: Body, changes: Sequence[MaterialChange]) -> None:
    """Refuse changes from what flows to a law whose stress comes from the deformation gradient.

    Raises:
        SimulationError: names part and laws.
    """
    latest = [float(np.max(change.at_s)) for change in changes]
    law = body.law.copy()
    for number in np.argsort(latest, kind="stable"):
        change = changes[number]
        mine = change.has_come(body, np.inf)
        for before in np.unique(law[mine]):
            flows = LAWS[LawId(before)].gradient is not Gradient.ELASTIC
            if flows and LAWS[change.law].gradient is Gradient.ELASTIC:
                part = body.part_names[int(body.part[mine & (law == before)][0])]
                raise SimulationError(
                    f"Part '{part}' cannot change from {LawId(before).name.lower()}, in which it may have flowed, to "
                    f"{change.law.name.lower()}; let it harden to von_mises with a high yield stress."
                )
        law[mine] = int(change.law)


def carry_over(old: Particles, new: Particles) -> None:
    """Give particles of changed materials the state that they had; ``new`` is of the same body as ``old``."""
    index = old.body_index
    places = np.flatnonzero(index >= 0)
    place_of = np.zeros(int(index.max()) + 1, np.int64)
    place_of[index[places]] = places
    source = place_of[new.numbers]
    for first, count in _CARRIED:
        new.columns[first : first + count] = old.columns[first : first + count, source]
    law_of_place = np.zeros(old.columns.shape[1], np.int64)
    for number, of_law in enumerate(old.ranges):
        law_of_place[of_law[0, 0] : of_law[-1, 1]] = number
    for law, of_law in zip(new.laws, new.ranges, strict=True):
        here = np.arange(of_law[0, 0], of_law[-1, 1])
        before = law_of_place[source[here]]
        for number in np.unique(before):
            mine = here[before == number]
            _take_state(old, old.laws[number], source[mine], new, law, mine)


def _take_state(
    old: Particles,
    old_law: Law,
    sources: NDArray[np.int64],
    new: Particles,
    law: Law,
    places: NDArray[np.int64],
) -> None:
    """State columns of particles that had one law and have another now."""
    old_first, first = LAW_COLUMNS + len(old_law.parameters), LAW_COLUMNS + len(law.parameters)
    if old_law.law_id == law.law_id:
        count = law.column_count - len(law.parameters)
        new.columns[first : first + count, places] = old.columns[old_first : old_first + count, sources]
        return
    F = old.columns[DISPLACEMENT_GRADIENT : DISPLACEMENT_GRADIENT + 9, sources].T.reshape(-1, 3, 3).astype(np.float64)
    F += np.eye(3)
    state = dict(zip(old_law.state, old.columns[old_first : old_first + len(old_law.state), sources], strict=True))
    b = _elastic_left_cauchy_green(old_law, F, {name: values.astype(np.float64) for name, values in state.items()})
    if ELASTIC_STRAIN[0] in law.state:
        for name, (i, j) in zip(ELASTIC_STRAIN, STRAIN_INDICES, strict=True):
            new.columns[first + law.state.index(name), places] = b[:, i, j] - (i == j)
    if "growth" in law.state:
        growth = np.sqrt(np.maximum(np.linalg.det(b), 1e-6)) - 1
        new.columns[first + law.state.index("growth"), places] = np.minimum(growth, 0)


def _elastic_left_cauchy_green(
    law: Law, F: NDArray[np.float64], state: Mapping[str, NDArray[np.float64]]
) -> NDArray[np.float64]:
    """B of the elastic deformation of particles, [n, 3, 3]."""
    if law.gradient is Gradient.ELASTIC:
        return F @ np.swapaxes(F, 1, 2)
    b = np.tile(np.eye(3), (len(F), 1, 1))
    if ELASTIC_STRAIN[0] in state:
        for name, (i, j) in zip(ELASTIC_STRAIN, STRAIN_INDICES, strict=True):
            b[:, i, j] = b[:, j, i] = state[name] + (i == j)
    elif "growth" in state:
        b *= ((1 + state["growth"]) ** (2 / 3))[:, None, None]
    return b
