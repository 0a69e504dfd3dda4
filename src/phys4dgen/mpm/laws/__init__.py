"""Constitutive laws, one per file: equation, symbols, units and source in its docstring.

To add a law: give it a name in ``LawId``, write ``laws/<name>.py`` with a vector function ``response`` and a NumPy
``energy_density_pa``, register it there and import it here. Kernels are compiled for the laws that a scene contains.
"""

from phys4dgen.mpm.laws.fixed_corotated import FIXED_COROTATED
from phys4dgen.mpm.laws.law import LAWS, Law, LawId, respond
from phys4dgen.mpm.laws.neo_hookean import NEO_HOOKEAN

__all__ = ["FIXED_COROTATED", "LAWS", "NEO_HOOKEAN", "Law", "LawId", "respond"]
