"""CLIP: pictures and sentences as vectors of one space (Radford et al. 2021), through Transformers."""

from phys4dgen.clip.encoder import DEFAULT_CLIP, ClipEncoder
from phys4dgen.clip.sub_image import masked_sub_image

__all__ = ["DEFAULT_CLIP", "ClipEncoder", "masked_sub_image"]
