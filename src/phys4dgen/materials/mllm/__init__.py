"""Materials named by a multimodal language model, and its answers checked (Paper: Sec. 3.4 and appendix B.5)."""

from phys4dgen.materials.mllm.budget import Limits
from phys4dgen.materials.mllm.cache import AnswerCache
from phys4dgen.materials.mllm.endpoint import DEFAULT_BASE_URL, DEFAULT_MODEL, Endpoint, endpoint
from phys4dgen.materials.mllm.identify import Asking, Identification, ask_names, identify_by_model, kept_answers
from phys4dgen.materials.mllm.kept_pictures import kept_pictures, pictures_digest
from phys4dgen.materials.mllm.reading import Reading
from phys4dgen.materials.mllm.reliability import comparison_table, reliability_table
from phys4dgen.materials.mllm.sampling import Asked, ask
from phys4dgen.materials.mllm.subimages import PartView, SubImages, front_views, make_sub_images, picture_view

__all__ = [
    "DEFAULT_BASE_URL",
    "DEFAULT_MODEL",
    "AnswerCache",
    "Asked",
    "Asking",
    "Endpoint",
    "Identification",
    "Limits",
    "PartView",
    "Reading",
    "SubImages",
    "ask",
    "ask_names",
    "comparison_table",
    "endpoint",
    "front_views",
    "identify_by_model",
    "kept_answers",
    "kept_pictures",
    "make_sub_images",
    "picture_view",
    "pictures_digest",
    "reliability_table",
]
