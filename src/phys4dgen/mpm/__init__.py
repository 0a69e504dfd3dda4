"""Material Point Method on a CPU, in metres and pascals with z up.

Start reading at ``step.py`` (what happens in a substep) and ``simulator.py`` (frames, checks, the grid's extent).
"""

from phys4dgen.mpm.body import Body
from phys4dgen.mpm.changes import MaterialChange, changed_body
from phys4dgen.mpm.drives import Drive
from phys4dgen.mpm.fields import Attractor, Noise, PerParticleForce, Vortex, Wind
from phys4dgen.mpm.laws import LawId
from phys4dgen.mpm.loads import Acceleration, Impulse, TotalForce
from phys4dgen.mpm.obstacles import HalfSpace, HollowBall, Motion, Obstacle, Push, RoundedBox
from phys4dgen.mpm.prestress import Prestress, prestress, since_start, stiffened
from phys4dgen.mpm.settings import Ground, Settings
from phys4dgen.mpm.simulator import Frame, Simulator
from phys4dgen.mpm.timestep import Estimate, StiffPart, affordable_modulus_pa, stiff_parts

__all__ = [
    "Acceleration",
    "Attractor",
    "Body",
    "Drive",
    "Estimate",
    "Frame",
    "Ground",
    "HalfSpace",
    "HollowBall",
    "Impulse",
    "LawId",
    "MaterialChange",
    "Motion",
    "Noise",
    "Obstacle",
    "PerParticleForce",
    "Prestress",
    "Push",
    "RoundedBox",
    "Settings",
    "Simulator",
    "StiffPart",
    "TotalForce",
    "Vortex",
    "Wind",
    "affordable_modulus_pa",
    "changed_body",
    "prestress",
    "since_start",
    "stiff_parts",
    "stiffened",
]
