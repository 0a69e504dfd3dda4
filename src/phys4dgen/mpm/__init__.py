"""Material Point Method on a CPU, in metres and pascals with z up.

Start reading at ``step.py`` (what happens in a substep) and ``simulator.py`` (frames, checks, the grid's extent).
"""

from phys4dgen.mpm.body import Body
from phys4dgen.mpm.laws import LawId
from phys4dgen.mpm.settings import Acceleration, Ground, Settings
from phys4dgen.mpm.simulator import Frame, Simulator
from phys4dgen.mpm.timestep import Estimate, StiffPart, affordable_modulus_pa, stiff_parts

__all__ = [
    "Acceleration",
    "Body",
    "Estimate",
    "Frame",
    "Ground",
    "LawId",
    "Settings",
    "Simulator",
    "StiffPart",
    "affordable_modulus_pa",
    "stiff_parts",
]
