"""What is simulated: particles with their materials, in metres with z up, as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm.laws import LAWS, LawId
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

    def __post_init__(self) -> None:
        positions = checked_array(self.positions_m, "positions_m", (None, 3), np.float64)
        p = len(positions)
        velocities = np.zeros((p, 3)) if self.velocities_ms is None else self.velocities_ms
        rigid = np.full(p, -1, np.int32) if self.rigid_group is None else self.rigid_group
        bonded = np.ones(p, np.bool_) if self.bonded_to_held is None else self.bonded_to_held
        checked = {
            "positions_m": positions,
            "velocities_ms": checked_array(velocities, "velocities_ms", (p, 3), np.float64),
            "law": checked_array(self.law, "law", (p,), np.int32),
            "part": checked_array(self.part, "part", (p,), np.int32),
            "held": checked_array(self.held, "held", (p,), np.bool_),
            "rigid_group": checked_array(rigid, "rigid_group", (p,), np.int32),
            "bonded_to_held": checked_array(bonded, "bonded_to_held", (p,), np.bool_),
        }
        for name in ("volume_m3", "density_kgm3", "youngs_modulus_pa", "poisson_ratio"):
            checked[name] = checked_array(getattr(self, name), name, (p,), np.float64)
        for name in ("volume_m3", "density_kgm3", "youngs_modulus_pa"):
            if not (checked[name] > 0).all():
                raise ValueError(f"{name}: expected positive values, got {checked[name].min():g}.")
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
        """Speed of pressure waves c_p = sqrt((lam + 2 mu) / rho), shape [P]."""
        return np.sqrt((self.lame_lambda_pa + 2 * self.lame_mu_pa) / self.density_kgm3)

    def with_law(self, law: LawId) -> Body:
        """The same body with one law for all particles."""
        values = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return Body(**{**values, "law": np.full(len(self), int(law), np.int32)})
