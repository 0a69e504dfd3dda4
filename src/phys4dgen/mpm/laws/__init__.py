"""Constitutive laws, one per file: equation, symbols, units and source in its docstring.

To add a law: name it in ``LawId`` and in ``types.laws`` with its numbers, write ``laws/<name>.py`` with a vector
function ``response`` and a NumPy ``energy_density_pa``, register it there and import it here. Kernels are compiled for
the laws that a scene contains.
"""

from phys4dgen.mpm.laws.drucker_prager import DRUCKER_PRAGER
from phys4dgen.mpm.laws.fixed_corotated import FIXED_COROTATED
from phys4dgen.mpm.laws.fluid import FLUID
from phys4dgen.mpm.laws.herschel_bulkley import HERSCHEL_BULKLEY
from phys4dgen.mpm.laws.kelvin_voigt import damped
from phys4dgen.mpm.laws.law import LAWS, Gradient, Law, LawId
from phys4dgen.mpm.laws.neo_hookean import NEO_HOOKEAN
from phys4dgen.mpm.laws.snow import SNOW
from phys4dgen.mpm.laws.stvk_hencky import STVK_HENCKY
from phys4dgen.mpm.laws.viscoplastic import VISCOPLASTIC
from phys4dgen.mpm.laws.von_mises import VON_MISES

__all__ = [
    "DRUCKER_PRAGER",
    "FIXED_COROTATED",
    "FLUID",
    "HERSCHEL_BULKLEY",
    "LAWS",
    "NEO_HOOKEAN",
    "SNOW",
    "STVK_HENCKY",
    "VISCOPLASTIC",
    "VON_MISES",
    "Gradient",
    "Law",
    "LawId",
    "damped",
]
