"""The core types that flow between stages: NumPy only, frozen, validated where they are made."""

from phys4dgen.types.camera import Camera
from phys4dgen.types.continuum import ROD, SHEET, SOLID, Continuum
from phys4dgen.types.frame import Frame, rotation_to_z_up
from phys4dgen.types.gaussians import SH_C0, Gaussians, covariance_from_quats_scales, rotation_from_quats
from phys4dgen.types.laws import KNOWN_NUMBERS, LAW_NUMBERS, LawNumber, complete_numbers, wrong_number
from phys4dgen.types.material import Material, MaterialBook, PartMaterials
from phys4dgen.types.parts import Parts
from phys4dgen.types.trajectory import Trajectory
from phys4dgen.types.views import Masks, Views

__all__ = [
    "KNOWN_NUMBERS",
    "LAW_NUMBERS",
    "ROD",
    "SHEET",
    "SH_C0",
    "SOLID",
    "Camera",
    "Continuum",
    "Frame",
    "Gaussians",
    "LawNumber",
    "Masks",
    "Material",
    "MaterialBook",
    "PartMaterials",
    "Parts",
    "Trajectory",
    "Views",
    "complete_numbers",
    "covariance_from_quats_scales",
    "rotation_from_quats",
    "rotation_to_z_up",
    "wrong_number",
]
