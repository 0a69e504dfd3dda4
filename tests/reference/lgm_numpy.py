"""LGM's U-Net in float64 NumPy, driven by a state dict: slow, and written apart from the torch modules."""

import numpy as np


def group_norm(x, weight, bias, groups, eps=1e-5):
    n, c, h, w = x.shape
    grouped = x.reshape(n, groups, -1)
    normal = (grouped - grouped.mean(-1, keepdims=True)) / np.sqrt(grouped.var(-1, keepdims=True) + eps)
    return normal.reshape(n, c, h, w) * weight[:, None, None] + bias[:, None, None]


def silu(x):
    return x / (1 + np.exp(-x))


def conv(x, weight, bias, *, stride=1):
    """Padding keeps the size at stride 1."""
    k = weight.shape[-1]
    padded = np.pad(x, ((0, 0), (0, 0), (k // 2, k // 2), (k // 2, k // 2)))
    h, w = x.shape[2:]
    out = sum(
        np.einsum("oc,nchw->nohw", weight[:, :, i, j], padded[:, :, i : i + h, j : j + w])
        for i in range(k)
        for j in range(k)
    )
    return out[:, :, ::stride, ::stride] + bias[:, None, None]


def attention(tokens, qkv, proj, bias, heads):
    """Tokens [T, C]."""
    t, c = tokens.shape
    q, k, v = (tokens @ qkv.T).reshape(t, 3, heads, c // heads).transpose(1, 2, 0, 3)
    out = []
    for head in range(heads):
        scores = q[head] @ k[head].T / np.sqrt(c // heads)
        weights = np.exp(scores - scores.max(1, keepdims=True))
        out.append(weights / weights.sum(1, keepdims=True) @ v[head])
    return np.concatenate(out, 1) @ proj.T + bias


class NumpyLgm:
    def __init__(self, state, config):
        self.state = {key: np.asarray(value, np.float64) for key, value in state.items()}
        self.config = config

    def at(self, key, *names):
        return [self.state[f"{key}.{name}"] for name in names]

    def norm(self, key, x):
        return group_norm(x, *self.at(key, "weight", "bias"), self.config.norm_groups)

    def conv(self, key, x, *, stride=1):
        return conv(x, *self.at(key, "weight", "bias"), stride=stride)

    def residual(self, key, x):
        y = self.conv(f"{key}.conv1", silu(self.norm(f"{key}.norm1", x)))
        y = self.conv(f"{key}.conv2", silu(self.norm(f"{key}.norm2", y)))
        across = self.conv(f"{key}.shortcut", x) if f"{key}.shortcut.weight" in self.state else x
        return (y + across) / np.sqrt(2)

    def attend(self, key, x):
        if f"{key}.norm.weight" not in self.state:
            return x
        views, c, h, w = x.shape
        tokens = self.norm(f"{key}.norm", x).transpose(0, 2, 3, 1).reshape(-1, c)
        y = attention(tokens, *self.at(f"{key}.attn", "qkv.weight", "proj.weight", "proj.bias"), self.config.heads)
        return (y.reshape(views, h, w, c).transpose(0, 3, 1, 2) + x) / np.sqrt(2)

    def __call__(self, x):
        config = self.config
        x = self.conv("unet.conv_in", np.asarray(x, np.float64))
        kept = [x]
        for level in range(len(config.down_channels)):
            block = f"unet.down_blocks.{level}"
            for layer in range(config.down_layers):
                x = self.attend(f"{block}.attns.{layer}", self.residual(f"{block}.nets.{layer}", x))
                kept.append(x)
            if level < len(config.down_channels) - 1:
                x = self.conv(f"{block}.downsample", x, stride=2)
                kept.append(x)
        x = self.residual("unet.mid_block.nets.0", x)
        x = self.residual("unet.mid_block.nets.1", self.attend("unet.mid_block.attns.0", x))
        for level in range(len(config.up_channels)):
            block = f"unet.up_blocks.{level}"
            for layer in range(config.down_layers + 1):
                x = self.residual(f"{block}.nets.{layer}", np.concatenate([x, kept.pop()], 1))
                x = self.attend(f"{block}.attns.{layer}", x)
            if level < len(config.up_channels) - 1:
                x = self.conv(f"{block}.upsample", x.repeat(2, 2).repeat(2, 3))
        x = self.conv("conv", self.conv("unet.conv_out", silu(self.norm("unet.norm_out", x))))
        return x.transpose(0, 2, 3, 1).reshape(-1, 14)
