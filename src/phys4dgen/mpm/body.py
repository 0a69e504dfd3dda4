"""What is simulated: particles with their materials, in metres with z up, as plain arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm.laws import LAWS, Gradient, Law, LawId, damped
from phys4dgen.types import LAW_NUMBERS
from phys4dgen.types.checks import checked_array

__all__ = ["Body"]


@dataclass(frozen=True, eq=False)
class Body:
    """P material points at rest.

    Attributes:
        positions_m: rest positions, metres, z up, shape [P, 3].
        volume_m3: rest volume that each particle stands for, shape [P].
        density_kgm3: shape [P].
        youngs_modulus_pa: Young's modulus E, shape [P].
        poisson_ratio: nu in [0, 0.5), shape [P].
        law: values of ``LawId``, shape [P].
        part: part number 0 .. G-1, shape [P].
        held: particles that never move, shape [P], bool.
        part_names: G names, for messages.
        velocities_ms: velocities at t = 0, shape [P, 3]; zero if not given, and for held particles.
        rigid_group: particles with the same number 0, 1, .. move as one rigid body; -1 for soft ones, as by default;
            shape [P]. A part in several pieces needs one number for each. Held particles ignore it.
        bonded_to_held: where held material is near at rest: True for particles that have grown together with it, as
            by default, and are clamped; False for those that only touch or hang beside it, shape [P], bool.
        body_id: particles with different numbers are different bodies, which touch and slide on one another but do not
            grow together where they come close; all 0 by default, shape [P].
        law_numbers: further numbers of the laws by name (``types.LAW_NUMBERS``), [P] each, of any value where the
            particle's law does not use them; a number that has a default may be left out.
        initial_gradients: deformation gradient at t = 0, shape [P, 3, 3] (``prestress``); None: unstrained. Volumes
            and densities are those of the shape at t = 0 all the same.
    """

    positions_m: NDArray[np.float64]
    volume_m3: NDArray[np.float64]
    density_kgm3: NDArray[np.float64]
    youngs_modulus_pa: NDArray[np.float64]
    poisson_ratio: NDArray[np.float64]
    law: NDArray[np.int32]
    part: NDArray[np.int32]
    held: NDArray[np.bool_]
    part_names: tuple[str, ...]
    velocities_ms: NDArray[np.float64] | None = None
    rigid_group: NDArray[np.int32] | None = None
    bonded_to_held: NDArray[np.bool_] | None = None
    body_id: NDArray[np.int32] | None = None
    law_numbers: Mapping[str, NDArray[np.float64]] | None = None
    initial_gradients: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        positions = checked_array(self.positions_m, "positions_m", (None, 3), np.float64)
        p = len(positions)
        velocities = np.zeros((p, 3)) if self.velocities_ms is None else self.velocities_ms
        rigid = np.full(p, -1, np.int32) if self.rigid_group is None else self.rigid_group
        bonded = np.ones(p, np.bool_) if self.bonded_to_held is None else self.bonded_to_held
        body_id = np.zeros(p, np.int32) if self.body_id is None else self.body_id
        checked = {
            "positions_m": positions,
            "velocities_ms": checked_array(velocities, "velocities_ms", (p, 3), np.float64),
            "law": checked_array(self.law, "law", (p,), np.int32),
            "part": checked_array(self.part, "part", (p,), np.int32),
            "held": checked_array(self.held, "held", (p,), np.bool_),
            "rigid_group": checked_array(rigid, "rigid_group", (p,), np.int32),
            "body_id": checked_array(body_id, "body_id", (p,), np.int32),
            "bonded_to_held": checked_array(bonded, "bonded_to_held", (p,), np.bool_),
        }
        for name in ("volume_m3", "density_kgm3", "youngs_modulus_pa", "poisson_ratio"):
            checked[name] = checked_array(getattr(self, name), name, (p,), np.float64)
        for name in ("volume_m3", "density_kgm3", "youngs_modulus_pa"):
            if not (checked[name] > 0).all():
                raise ValueError(f"{name}: expected positive values, got {checked[name].min():g}.")
        if self.initial_gradients is not None:
            gradients = checked_array(self.initial_gradients, "initial_gradients", (p, 3, 3), np.float64)
            if not (np.linalg.det(gradients) > 0).all():
                raise ValueError("initial_gradients: expected positive determinants.")
            checked["initial_gradients"] = gradients
        nu = checked["poisson_ratio"]
        if not ((nu > -1) & (nu < 0.5)).all():
            raise ValueError(f"poisson_ratio: expected values in (-1, 0.5), got {nu.min():g} to {nu.max():g}.")
        if p and not 0 <= checked["part"].min() <= checked["part"].max() < len(self.part_names):
            raise ValueError(f"part: expected 0 .. {len(self.part_names) - 1}, got up to {checked['part'].max()}.")
        unknown = sorted(set(np.unique(checked["law"]).tolist()) - {int(law) for law in LAWS})
        if unknown:
            known = ", ".join(f"{law.name} = {law.value}" for law in sorted(LAWS))
            raise ValueError(f"law: expected {known}; got {unknown}.")
        for name, value in checked.items():
            object.__setattr__(self, name, value)
        object.__setattr__(self, "law_numbers", self._checked_numbers())

    def _checked_numbers(self) -> Mapping[str, NDArray[np.float64]]:
        """All numbers of the laws present, within their limits; NaN where a particle's law has none of that name."""
        given = self.law_numbers or {}
        numbers: dict[str, NDArray[np.float64]] = {}
        for law_id in np.unique(self.law):
            mine = self.law == law_id
            for number in LAW_NUMBERS[LawId(law_id).name.lower()]:
                where = f"law_numbers['{number.name}']"
                if number.name not in given and number.default is None:
                    raise ValueError(f"{where}: the law {LawId(law_id).name.lower()} needs it, shape [{len(self)}].")
                values = np.full(len(self), number.default if number.name not in given else np.nan)
                if number.name in given:
                    values = checked_array(given[number.name], where, (len(self),), np.float64, finite=False)
                if not ((values[mine] >= number.low) & (values[mine] <= number.high)).all():
                    worst = values[mine][~((values[mine] >= number.low) & (values[mine] <= number.high))][0]
                    raise ValueError(f"{where}: expected values in [{number.low:g}, {number.high:g}], got {worst:g}.")
                numbers.setdefault(number.name, np.full(len(self), np.nan))[mine] = values[mine]
        return MappingProxyType(numbers)

    def __len__(self) -> int:
        return len(self.positions_m)

    @property
    def is_rigid(self) -> NDArray[np.bool_]:
        """Particles that move as part of a rigid body, shape [P]."""
        assert self.rigid_group is not None
        return (self.rigid_group >= 0) & ~self.held

    @property
    def is_soft(self) -> NDArray[np.bool_]:
        """Particles that deform, shape [P]; the rest is rigid or held."""
        return ~self.held & ~self.is_rigid

    @property
    def flows(self) -> NDArray[np.bool_]:
        """Particles whose law can flow, so that neighbours may part, shape [P]."""
        flowing = [int(law_id) for law_id, law in LAWS.items() if law.gradient is not Gradient.ELASTIC]
        return np.isin(self.law, flowing) & self.is_soft

    @property
    def mass_kg(self) -> NDArray[np.float64]:
        """Mass of each particle, shape [P]."""
        return self.density_kgm3 * self.volume_m3

    @property
    def lame_mu_pa(self) -> NDArray[np.float64]:
        """Shear modulus mu = E / 2(1 + nu), shape [P]."""
        return self.youngs_modulus_pa / (2 * (1 + self.poisson_ratio))

    @property
    def lame_lambda_pa(self) -> NDArray[np.float64]:
        """First Lame parameter lam = E nu / ((1 + nu)(1 - 2 nu)), shape [P]."""
        nu = self.poisson_ratio
        return self.youngs_modulus_pa * nu / ((1 + nu) * (1 - 2 * nu))

    @property
    def wave_speed_ms(self) -> NDArray[np.float64]:
        """Speed of pressure waves at rest, c_p = sqrt((lam + 2 mu) / rho), shape [P]; a fluid's is no higher."""
        return np.sqrt((self.lame_lambda_pa + 2 * self.lame_mu_pa) / self.density_kgm3)

    @property
    def kinematic_viscosity_m2s(self) -> NDArray[np.float64]:
        """Explicit viscosity eta / rho, which limits the time step, shape [P]."""
        viscosity = np.zeros(len(self))
        for law, members in self.by_law(np.arange(len(self))):
            if "viscosity_pas" in law.parameters:
                viscosity[members] = self.law_columns(law, members)[law.parameters.index("viscosity_pas")]
        return viscosity / self.density_kgm3

    def by_law(self, chosen: NDArray[np.int64]) -> list[tuple[Law, NDArray[np.int64]]]:
        """The particles ``chosen`` of each law present, damped ones apart, in the order of the laws."""
        assert self.law_numbers is not None
        time_s = self.law_numbers.get("damping_time_s", np.zeros(len(self)))
        is_damped = np.nan_to_num(time_s) > 0
        found = []
        for law_id in np.unique(self.law[chosen]):
            law = LAWS[LawId(law_id)]
            for kind in (False, True):
                members = chosen[(self.law[chosen] == law_id) & (is_damped[chosen] == kind)]
                if len(members):
                    found.append((damped(law) if kind else law, members))
        return found

    def law_columns(self, law: Law, members: NDArray[np.int64]) -> NDArray[np.float64]:
        """Parameter columns of ``law`` for the particles ``members``, [parameters, M]."""
        assert self.law_numbers is not None
        material = {name: values[members] for name, values in self.law_numbers.items()}
        for name in ("youngs_modulus_pa", "lame_mu_pa", "lame_lambda_pa"):
            material[name] = getattr(self, name)[members]
        return np.stack(law.prepare(material))

    def has_materials_of(self, other: Body) -> bool:
        """Whether all particles have the laws and numbers of another body of the same particles."""
        assert self.law_numbers is not None and other.law_numbers is not None
        names = ("law", "youngs_modulus_pa", "poisson_ratio", "density_kgm3")
        if self is other or not all(np.array_equal(getattr(self, name), getattr(other, name)) for name in names):
            return self is other
        return self.law_numbers.keys() == other.law_numbers.keys() and all(
            np.array_equal(values, other.law_numbers[name], equal_nan=True) for name, values in self.law_numbers.items()
        )

    def with_law(self, law: LawId) -> Body:
        """The same body with one law for all particles."""
        return replace(self, law=np.full(len(self), int(law), np.int32))
