"""Skinning, Sigma(t) = F Sigma(0) F^T, scales and quaternions, spherical harmonics turned by the polar rotation."""

from phys4dgen.animate.animator import AnimatedFrame, Animator, Deformer
from phys4dgen.animate.axes import AxisTracker
from phys4dgen.animate.skinning import Skin, skin
from phys4dgen.animate.stretch import STRETCH_LIMITS

__all__ = [
    "STRETCH_LIMITS",
    "AnimatedFrame",
    "Animator",
    "AxisTracker",
    "Deformer",
    "Skin",
    "skin",
]
