"""The sizes of an LGM network; every key and shape of its checkpoint follows from them."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["BIG", "GAUSSIAN_CHANNELS", "INPUT_CHANNELS", "VIEWS", "LgmConfiguration"]

VIEWS = 4
INPUT_CHANNELS = 9
"""Normalised RGB and the six Pluecker coordinates of the pixel's ray."""
GAUSSIAN_CHANNELS = 14
"""Position 3, opacity 1, scale 3, rotation 4, colour 3."""


@dataclass(frozen=True)
class LgmConfiguration:
    """An asymmetric U-Net: the picture is halved between ``down`` levels, doubled between the fewer ``up`` levels.

    Attributes:
        input_px: side of the four pictures.
        down_channels: width of each level on the way down; multiples of ``norm_groups``.
        down_attention: whether the level attends over the pixels of all views.
        up_channels: width of each level on the way up.
        up_attention: as ``down_attention``.
        mid_attention: whether the coarsest level attends between its two residual blocks.
        down_layers: residual blocks per level on the way down; one more on the way up.
        heads: of attention; divide the width of every level that attends.
        norm_groups: of group normalisation.
    """

    input_px: int
    down_channels: tuple[int, ...]
    down_attention: tuple[bool, ...]
    up_channels: tuple[int, ...]
    up_attention: tuple[bool, ...]
    mid_attention: bool = True
    down_layers: int = 2
    heads: int = 16
    norm_groups: int = 32

    @property
    def output_px(self) -> int:
        """Side of the output; each of its pixels is a Gaussian."""
        return self.input_px // 2 ** (len(self.down_channels) - 1) * 2 ** (len(self.up_channels) - 1)

    @property
    def gaussian_count(self) -> int:
        """Gaussians that come out, before any is dropped."""
        return VIEWS * self.output_px**2

    @property
    def skip_channels(self) -> tuple[int, ...]:
        """Width of the way down that each level on the way up meets with its last residual block."""
        last = len(self.down_channels)
        return tuple(self.down_channels[max(-2 - level, -last)] for level in range(len(self.up_channels)))


BIG = LgmConfiguration(
    input_px=256,
    down_channels=(64, 128, 256, 512, 1024, 1024),
    down_attention=(False, False, False, True, True, True),
    up_channels=(1024, 1024, 512, 256, 128),
    up_attention=(True, True, True, False, False),
)
"""The public checkpoint: 415,042,848 parameters, 65,536 Gaussians."""
