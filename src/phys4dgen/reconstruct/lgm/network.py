"""The asymmetric U-Net of LGM and its last convolution.

Attribute names are the keys of the public checkpoint: ``unet.down_blocks.I.nets.J.conv1.weight`` and so on.
"""

from __future__ import annotations

import torch  # pyright: ignore[reportMissingImports]
from torch import nn  # pyright: ignore[reportMissingImports]
from torch.nn import functional  # pyright: ignore[reportMissingImports]

from phys4dgen.reconstruct.lgm.blocks import NORM_EPS, ResidualBlock, ViewAttention
from phys4dgen.reconstruct.lgm.configuration import GAUSSIAN_CHANNELS, INPUT_CHANNELS, LgmConfiguration

__all__ = ["LgmNetwork", "UNet", "parameter_shapes"]


class DownBlock(nn.Module):
    """One level on the way down; keeps what comes out of each residual block for the way up."""

    def __init__(
        self, channels_in: int, channels_out: int, *, config: LgmConfiguration, attention: bool, downsample: bool
    ) -> None:
        super().__init__()
        widths = [channels_in, *[channels_out] * config.down_layers]
        self.nets = _residual_blocks(widths[:-1], channels_out, config)
        self.attns = _attention_blocks(config.down_layers if attention else 0, channels_out, config)
        self.downsample = (
            nn.Conv2d(channels_out, channels_out, kernel_size=3, stride=2, padding=1) if downsample else None
        )

    def forward(self, x: torch.Tensor) -> tuple[torch.Tensor, list[torch.Tensor]]:
        """The output, and what the way up will meet, in order."""
        kept = []
        for index, net in enumerate(self.nets):
            x = net(x)
            x = self.attns[index](x) if len(self.attns) else x
            kept.append(x)
        if self.downsample is not None:
            x = self.downsample(x)
            kept.append(x)
        return x, kept


class MidBlock(nn.Module):
    """The coarsest level: residual block, attention, residual block."""

    def __init__(self, channels: int, *, config: LgmConfiguration) -> None:
        super().__init__()
        self.nets = _residual_blocks([channels, channels], channels, config)
        self.attns = _attention_blocks(int(config.mid_attention), channels, config)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """[B, C, H, W] -> the same shape."""
        x = self.nets[0](x)
        x = self.attns[0](x) if len(self.attns) else x
        return self.nets[1](x)


class UpBlock(nn.Module):
    """One level on the way up; each residual block takes the last of what the way down kept."""

    def __init__(
        self,
        channels_in: int,
        channels_out: int,
        *,
        skip_channels: int,
        config: LgmConfiguration,
        attention: bool,
        upsample: bool,
    ) -> None:
        super().__init__()
        layers = config.down_layers + 1
        incoming = [channels_in, *[channels_out] * (layers - 1)]
        met = [*[channels_out] * (layers - 1), skip_channels]
        self.nets = _residual_blocks([a + b for a, b in zip(incoming, met, strict=True)], channels_out, config)
        self.attns = _attention_blocks(layers if attention else 0, channels_out, config)
        self.upsample = nn.Conv2d(channels_out, channels_out, kernel_size=3, padding=1) if upsample else None

    def forward(self, x: torch.Tensor, kept: list[torch.Tensor]) -> torch.Tensor:
        """[B, channels_in, H, W] -> [B, channels_out, H or 2 H, W or 2 W]; takes its share from the end of ``kept``."""
        for index, net in enumerate(self.nets):
            x = net(torch.cat([x, kept.pop()], dim=1))
            x = self.attns[index](x) if len(self.attns) else x
        if self.upsample is not None:
            x = self.upsample(functional.interpolate(x, scale_factor=2.0, mode="nearest"))
        return x


class UNet(nn.Module):
    """Pictures with rays [B * 4, 9, P, P] -> raw Gaussians [B * 4, 14, Q, Q]."""

    def __init__(self, config: LgmConfiguration) -> None:
        super().__init__()
        down, up = config.down_channels, config.up_channels
        self.conv_in = nn.Conv2d(INPUT_CHANNELS, down[0], kernel_size=3, padding=1)
        self.down_blocks = nn.ModuleList(
            DownBlock(
                down[max(level - 1, 0)],
                width,
                config=config,
                attention=config.down_attention[level],
                downsample=level < len(down) - 1,
            )
            for level, width in enumerate(down)
        )
        self.mid_block = MidBlock(down[-1], config=config)
        self.up_blocks = nn.ModuleList(
            UpBlock(
                down[-1] if level == 0 else up[level - 1],
                width,
                skip_channels=config.skip_channels[level],
                config=config,
                attention=config.up_attention[level],
                upsample=level < len(up) - 1,
            )
            for level, width in enumerate(up)
        )
        self.norm_out = nn.GroupNorm(config.norm_groups, up[-1], eps=NORM_EPS)
        self.conv_out = nn.Conv2d(up[-1], GAUSSIAN_CHANNELS, kernel_size=3, padding=1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """See the class."""
        x = self.conv_in(x)
        kept = [x]
        for block in self.down_blocks:
            x, more = block(x)
            kept += more
        x = self.mid_block(x)
        for block in self.up_blocks:
            x = block(x, kept)
        return self.conv_out(functional.silu(self.norm_out(x)))


class LgmNetwork(nn.Module):
    """The U-Net and the 1x1 convolution after it."""

    def __init__(self, config: LgmConfiguration) -> None:
        super().__init__()
        self.unet = UNet(config)
        self.conv = nn.Conv2d(GAUSSIAN_CHANNELS, GAUSSIAN_CHANNELS, kernel_size=1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Pictures with rays of one object, [4, 9, P, P] -> raw Gaussians view by view, row by row, [N, 14]."""
        return self.conv(self.unet(x)).permute(0, 2, 3, 1).reshape(-1, GAUSSIAN_CHANNELS)


def parameter_shapes(config: LgmConfiguration) -> dict[str, tuple[int, ...]]:
    """Shape of every parameter by its key; takes no memory for them."""
    with torch.device("meta"):
        network = LgmNetwork(config)
    return {key: tuple(value.shape) for key, value in network.state_dict().items()}


def _residual_blocks(widths_in: list[int], channels_out: int, config: LgmConfiguration) -> nn.ModuleList:
    return nn.ModuleList(ResidualBlock(width, channels_out, norm_groups=config.norm_groups) for width in widths_in)


def _attention_blocks(count: int, channels: int, config: LgmConfiguration) -> nn.ModuleList:
    blocks = (ViewAttention(channels, heads=config.heads, norm_groups=config.norm_groups) for _ in range(count))
    return nn.ModuleList(blocks)
