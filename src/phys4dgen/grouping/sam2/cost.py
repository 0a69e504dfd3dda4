"""How long SAM2 will take, from what a checkpoint says of its own size: the weights are not loaded for it.

Floating point operations of the parts that matter are counted and divided by a speed that was measured once
(``benchmarks/sam2.py``, docs/sam2-and-clip.md). What ``auto`` decides thus depends on the machine, but not on how busy
it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from phys4dgen.weights import read_config

__all__ = ["MODEL_TYPE", "Cost", "predicted_cost"]

MODEL_TYPE = "sam2_video"
_CPU_FLOPS_PER_THREAD = 12.5e9
_CUDA_FLOPS = 5e12
"""Of an ordinary card; never measured here."""
_EXPECTED_OBJECTS = 6
_EXPECTED_PROMPTS = 0.6
"""Of the grid's points fall on the foreground in all key views together."""
_TINY_DIMS, _TINY_BLOCKS = (96, 192, 384, 768), (1, 2, 7, 2)
_PROMPT_FLOPS, _STEP_FLOPS = 7e9, 200e9
"""Of the mask decoder for one prompt and of one object in one view, which are the same for all sizes of SAM2."""


@dataclass(frozen=True)
class Cost:
    """Predicted seconds.

    Attributes:
        view_s: to encode one view.
        prompt_s: to decode the masks of one point.
        step_s: to follow one object into one view.
    """

    view_s: float
    prompt_s: float
    step_s: float

    def total_s(self, views: int, points_per_side: int) -> float:
        """Of a whole object with some six parts."""
        prompts = _EXPECTED_PROMPTS * points_per_side**2
        return views * (self.view_s + _EXPECTED_OBJECTS * self.step_s) + prompts * self.prompt_s


def predicted_cost(folder: Path, device: str) -> Cost:
    """What a checkpoint will cost on this machine.

    Args:
        folder: with its config.json.
        device: cpu or cuda.

    Raises:
        StageError: config.json is no SAM2 video model's.
    """
    import torch  # pyright: ignore[reportMissingImports]

    config = read_config(folder, model="SAM2", model_type=MODEL_TYPE)
    size = config.get("image_size", 1024)
    scale = ((size if isinstance(size, int) else size[0]) / 1024) ** 2
    backbone = config.get("vision_config", {}).get("backbone_config", {})
    dims = backbone.get("embed_dim_per_stage") or _TINY_DIMS
    blocks = backbone.get("blocks_per_stage") or _TINY_BLOCKS
    flops_per_s = _CUDA_FLOPS if device == "cuda" else _CPU_FLOPS_PER_THREAD * torch.get_num_threads()
    return Cost(
        view_s=scale * _encoder_flops(dims, blocks) / flops_per_s,
        prompt_s=scale * _PROMPT_FLOPS / flops_per_s,
        step_s=scale * _STEP_FLOPS / flops_per_s,
    )


def _encoder_flops(dims: Any, blocks: Any) -> float:
    """Of the Hiera backbone at 1024 px: 24 d^2 per token and block, with a quarter of the tokens in each next stage."""
    return sum(
        24.0 * d * d * (256 >> stage) ** 2 * count for stage, (d, count) in enumerate(zip(dims, blocks, strict=True))
    )
