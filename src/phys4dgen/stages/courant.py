"""Where the paper's fixed time step is longer than a pressure wave takes through a grid cell.

Paper: Sec. C.3 fixes 5e-5 s for every material. An explicit step is unstable where the CFL number
C = c_p dt / dx, c_p = sqrt((lambda + 2 mu) / rho), is above about 1.
"""

from __future__ import annotations

import math

from phys4dgen.progress import Progress
from phys4dgen.scene.paper_scale import SUBSTEP_S
from phys4dgen.stages.asset import Asset
from phys4dgen.types import Material, MaterialBook

__all__ = ["tell_courant_numbers"]


def tell_courant_numbers(asset: Asset, book: MaterialBook, progress: Progress) -> None:
    """Warn of every part whose CFL number at the paper's substep is above 1."""
    for name, entry in book.parts.items():
        number = max(_wave_speed_ms(entry.surface), _wave_speed_ms(entry.interior)) * SUBSTEP_S / asset.cell_m
        if number > 1:
            progress.warn(
                f"Paper's scale: at {SUBSTEP_S:g} s and cells of {asset.cell_m:.3g} the CFL number of part '{name}' is "
                f"{number:.2g}, above 1 and so unstable; this run takes more substeps, or the part is rigid."
            )


def _wave_speed_ms(material: Material) -> float:
    """Speed of pressure waves."""
    nu = material.poisson_ratio
    modulus_pa = material.youngs_modulus_pa * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    return math.sqrt(modulus_pa / material.density_kgm3)
