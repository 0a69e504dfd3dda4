"""A checkpoint on disk -> the network, key by key and shape by shape."""

from __future__ import annotations

from pathlib import Path

import torch  # pyright: ignore[reportMissingImports]

from phys4dgen.reconstruct.lgm.configuration import LgmConfiguration
from phys4dgen.reconstruct.lgm.network import LgmNetwork, parameter_shapes
from phys4dgen.reconstruct.lgm.safetensors_file import read_tensor, stored_tensors

__all__ = ["NETWORK_NAME", "load_network"]

NETWORK_NAME = "LGM (model_fp16_fixrot.safetensors)"


def load_network(path: Path, config: LgmConfiguration, *, device: str = "cpu") -> LgmNetwork:
    """Load a checkpoint; every key and shape is compared before memory is taken.

    Args:
        path: a safetensors file of half or single precision; single precision is computed with.
        config: sizes of the network.
        device: of torch.

    Raises:
        FormatError: not a checkpoint of this network, cut off, damaged, or a pickle.
    """
    tensors = stored_tensors(path, parameter_shapes(config), network=NETWORK_NAME)
    with torch.device("meta"):
        network = LgmNetwork(config)
    weights = {key: torch.from_numpy(read_tensor(path, tensor)).to(device) for key, tensor in tensors.items()}
    network.load_state_dict(weights, strict=True, assign=True)
    return network.eval().requires_grad_(False)
