"""What the U-Net is made of: a residual block, and attention over the pixels of all views.

Both add to what comes in and scale the sum by sqrt(1/2), so that its variance stays the same. Attribute names are the
keys of the public checkpoint.
"""

from __future__ import annotations

import math

import torch  # pyright: ignore[reportMissingImports]
from torch import nn  # pyright: ignore[reportMissingImports]
from torch.nn import functional  # pyright: ignore[reportMissingImports]

from phys4dgen.reconstruct.lgm.configuration import VIEWS

__all__ = ["Attention", "ResidualBlock", "ViewAttention"]

SKIP_SCALE = math.sqrt(0.5)
NORM_EPS = 1e-5


class ResidualBlock(nn.Module):
    """Two 3x3 convolutions, each after group normalisation and SiLU; He et al. 2016, "Identity Mappings".

    Args:
        channels_in: width of the input.
        channels_out: width of the output; where it differs, a 1x1 convolution carries the input across.
        norm_groups: of group normalisation.
    """

    def __init__(self, channels_in: int, channels_out: int, *, norm_groups: int) -> None:
        super().__init__()
        self.norm1 = nn.GroupNorm(norm_groups, channels_in, eps=NORM_EPS)
        self.conv1 = nn.Conv2d(channels_in, channels_out, kernel_size=3, padding=1)
        self.norm2 = nn.GroupNorm(norm_groups, channels_out, eps=NORM_EPS)
        self.conv2 = nn.Conv2d(channels_out, channels_out, kernel_size=3, padding=1)
        self.shortcut = (
            nn.Identity() if channels_in == channels_out else nn.Conv2d(channels_in, channels_out, kernel_size=1)
        )

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """[B, channels_in, H, W] -> [B, channels_out, H, W]."""
        y = self.conv1(functional.silu(self.norm1(x)))
        y = self.conv2(functional.silu(self.norm2(y)))
        return (y + self.shortcut(x)) * SKIP_SCALE


class Attention(nn.Module):
    """Multi-head self-attention, Vaswani et al. 2017; no bias on queries, keys and values.

    Args:
        channels: width, a multiple of ``heads``.
        heads: attended independently.
    """

    def __init__(self, channels: int, *, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.qkv = nn.Linear(channels, 3 * channels, bias=False)
        self.proj = nn.Linear(channels, channels)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Tokens [B, T, C] -> [B, T, C]."""
        b, t, c = x.shape
        # (B, T, 3 C) -> three of (B, heads, T, C / heads)
        q, k, v = self.qkv(x).view(b, t, 3, self.heads, c // self.heads).permute(2, 0, 3, 1, 4)
        y = functional.scaled_dot_product_attention(q, k, v)
        return self.proj(y.transpose(1, 2).reshape(b, t, c))


class ViewAttention(nn.Module):
    """Every pixel of the four views of an object attends to every other.

    Args:
        channels: width.
        heads: of attention.
        norm_groups: of the group normalisation before it.
    """

    def __init__(self, channels: int, *, heads: int, norm_groups: int) -> None:
        super().__init__()
        self.norm = nn.GroupNorm(norm_groups, channels, eps=NORM_EPS)
        self.attn = Attention(channels, heads=heads)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """[B * VIEWS, C, H, W] -> the same shape; the views of one object follow each other."""
        n, c, h, w = x.shape
        tokens = self.norm(x).view(n // VIEWS, VIEWS, c, h * w).transpose(2, 3).reshape(n // VIEWS, VIEWS * h * w, c)
        y = self.attn(tokens).view(n, h * w, c).transpose(1, 2).reshape(n, c, h, w)
        return (y + x) * SKIP_SCALE
