"""A narrow LGM with random weights, and its checkpoint written by hand."""

import json

import numpy as np

from phys4dgen.reconstruct.lgm.configuration import LgmConfiguration

TINY = LgmConfiguration(
    input_px=32,
    down_channels=(32, 32, 64),
    down_attention=(False, True, True),
    up_channels=(64, 32),
    up_attention=(True, False),
    heads=4,
)


def tiny_weights(*, seed=0):
    """Random parameters in half precision, large enough that no layer is lost in rounding."""
    from phys4dgen.reconstruct.lgm.network import parameter_shapes

    rng = np.random.default_rng(seed)
    weights = {}
    for key, shape in parameter_shapes(TINY).items():
        if "norm" in key and key.endswith("weight"):
            values = rng.uniform(0.5, 1.5, shape)
        elif len(shape) > 1:
            values = rng.normal(0, 1.5 / np.sqrt(np.prod(shape[1:])), shape)
        else:
            values = rng.normal(0, 0.2, shape)
        weights[key] = values.astype(np.float16)
    return weights


def safetensors_bytes(tensors, *, edit=lambda header: None):
    """The file's bytes; ``edit`` may spoil the header."""
    header, body = {"__metadata__": {"format": "pt"}}, b""
    for key, value in tensors.items():
        kind = {"float16": "F16", "float32": "F32", "int64": "I64"}[str(value.dtype)]
        header[key] = {
            "dtype": kind,
            "shape": list(value.shape),
            "data_offsets": [len(body), len(body) + value.nbytes],
        }
        body += value.tobytes()
    edit(header)
    text = json.dumps(header).encode()
    return len(text).to_bytes(8, "little") + text + body
