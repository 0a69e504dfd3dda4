"""The embedded stand-in for image-to-3D networks: a picture inflated to closed Gaussians, without weights.

The outline says how thick the object is (``thickness``), colour parts add a relief, the back is painted with the front
without its marks (``back_colors``), and the surface is sampled by flat Gaussians (``surface``) which the picture's own
camera sees as the picture (``perspective``, ``refine``). What comes out is a guess that looks right: flat, tilted or
hollow things, several objects at once, and pictures taken from above come out wrong.
"""

from phys4dgen.reconstruct.inflate.inflate import InflateOptions, inflate
from phys4dgen.reconstruct.inflate.perspective import InflatedSolid

__all__ = ["InflateOptions", "InflatedSolid", "inflate"]
