"""Pictures and masks as SAM2 wants them, without torchvision.

Hugging Face's own processor needs torchvision, whose builds often do not fit the torch of a machine. What it does is
short: antialiased bilinear resizing to a square, in steps of grey levels, and ImageNet's mean and deviation. The test
compares with its output, made once (``scripts/sam2_reference.py``).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import torch  # pyright: ignore[reportMissingImports]

__all__ = ["network_mask", "network_picture", "picture_logits"]

_MEAN = (0.485, 0.456, 0.406)
_DEVIATION = (0.229, 0.224, 0.225)


def network_picture(rgb: NDArray[np.uint8], size: int) -> torch.Tensor:
    """A picture [H, W, 3] as the network's input, shape [1, 3, size, size], float32."""
    import torch  # pyright: ignore[reportMissingImports]
    from torch.nn.functional import interpolate  # pyright: ignore[reportMissingImports]

    grey_levels = torch.from_numpy(np.ascontiguousarray(rgb)).permute(2, 0, 1)[None].float()
    resized = interpolate(grey_levels, (size, size), mode="bilinear", align_corners=False, antialias=True)
    unit = resized.round().clamp(0, 255) / 255
    return (unit - torch.tensor(_MEAN).view(3, 1, 1)) / torch.tensor(_DEVIATION).view(3, 1, 1)


def network_mask(mask: NDArray[np.bool_], size: int) -> torch.Tensor:
    """A mask [H, W] as a prompt of the tracker: zeros and ones, shape [1, 1, size, size], float32."""
    import torch  # pyright: ignore[reportMissingImports]
    from torch.nn.functional import interpolate  # pyright: ignore[reportMissingImports]

    whole = torch.from_numpy(np.ascontiguousarray(mask))[None, None].float()
    return (interpolate(whole, (size, size), mode="bilinear", align_corners=False, antialias=True) >= 0.5).float()


def picture_logits(logits: torch.Tensor, height: int, width: int) -> torch.Tensor:
    """Logits [O, h, w] of the network at the size of the picture, [O, height, width], float32."""
    from torch.nn.functional import interpolate  # pyright: ignore[reportMissingImports]

    return interpolate(logits[:, None].float(), (height, width), mode="bilinear", align_corners=False)[:, 0]
