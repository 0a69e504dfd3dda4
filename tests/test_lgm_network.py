"""LGM's network: the keys and shapes of the public checkpoint, and every operation against NumPy."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="LGM needs torch (extra 'models')")

from lgm_tiny import TINY, tiny_weights  # noqa: E402
from phys4dgen.reconstruct.lgm.blocks import Attention, ResidualBlock, ViewAttention  # noqa: E402
from phys4dgen.reconstruct.lgm.configuration import BIG  # noqa: E402
from phys4dgen.reconstruct.lgm.network import LgmNetwork, parameter_shapes  # noqa: E402
from reference import lgm_numpy  # noqa: E402

KEYS = Path(__file__).parents[1] / "../shared/prototypes/models/lgm_big_keys.txt"


def randomised(module, seed=0):
    """The module with random parameters, and those by name in float64."""
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for parameter in module.parameters():
            parameter.copy_(torch.randn(parameter.shape, generator=generator) * 0.3)
    return module, {key: value.numpy().astype(np.float64) for key, value in module.state_dict().items()}


def test_the_big_network_has_the_size_of_the_public_checkpoint():
    shapes = parameter_shapes(BIG)
    parameters = sum(math.prod(shape) for shape in shapes.values())
    assert (len(shapes), parameters, BIG.gaussian_count) == (376, 415_042_848, 65_536)
    assert shapes["unet.conv_in.weight"] == (64, 9, 3, 3)
    assert shapes["unet.down_blocks.3.attns.1.attn.qkv.weight"] == (1536, 512)
    assert "unet.down_blocks.2.attns.0.norm.weight" not in shapes
    assert "unet.down_blocks.5.downsample.weight" not in shapes
    assert shapes["unet.up_blocks.1.nets.2.conv1.weight"] == (1024, 1536, 3, 3)
    assert shapes["conv.weight"] == (14, 14, 1, 1)


def test_the_public_checkpoint_in_half_precision_is_830_126_160_bytes():
    """The published length leaves 40,464 bytes for the header: what a compact one of these keys and shapes takes."""
    shapes = parameter_shapes(BIG)
    header, place = {}, 0
    for key in sorted(shapes):
        end = place + 2 * math.prod(shapes[key])
        header[key] = {"dtype": "F16", "shape": list(shapes[key]), "data_offsets": [place, end]}
        place = end
    text = json.dumps(header, separators=(",", ":"))
    assert 8 + 8 * math.ceil(len(text) / 8) + place == 830_126_160


def test_keys_and_shapes_are_those_of_the_list():
    if not KEYS.is_file():
        pytest.skip("the list of the public checkpoint's keys (../shared/prototypes/models) is not here")
    lines = (line.split("\t") for line in KEYS.read_text().splitlines() if line)
    listed = {key: tuple(int(side) for side in shape.strip("()").split(",") if side) for key, shape in lines}
    assert parameter_shapes(BIG) == listed


def test_group_normalisation_and_skip_scale_of_a_residual_block():
    block, state = randomised(ResidualBlock(32, 64, norm_groups=32))
    x = np.random.default_rng(0).normal(size=(4, 32, 5, 5))
    reference = lgm_numpy.NumpyLgm({f"b.{key}": value for key, value in state.items()}, TINY)
    got = block(torch.from_numpy(x).float()).detach().numpy()
    np.testing.assert_allclose(got, reference.residual("b", x), atol=2e-5)
    norm = block.norm1(torch.from_numpy(x).float()).detach().numpy()
    expected = lgm_numpy.group_norm(x, state["norm1.weight"], state["norm1.bias"], 32)
    np.testing.assert_allclose(norm, expected, atol=1e-5)


def test_a_residual_block_without_effect_scales_by_the_root_of_a_half():
    block, _ = randomised(ResidualBlock(32, 32, norm_groups=32))
    with torch.no_grad():
        block.conv2.weight.zero_()
        block.conv2.bias.zero_()
    x = torch.randn(1, 32, 4, 4, generator=torch.Generator().manual_seed(1))
    torch.testing.assert_close(block(x), x * math.sqrt(0.5))


def test_attention():
    module, state = randomised(Attention(64, heads=4))
    tokens = np.random.default_rng(1).normal(size=(30, 64))
    got = module(torch.from_numpy(tokens).float()[None])[0].detach().numpy()
    expected = lgm_numpy.attention(tokens, state["qkv.weight"], state["proj.weight"], state["proj.bias"], 4)
    np.testing.assert_allclose(got, expected, atol=1e-4)


def test_views_of_one_object_see_each_other_and_no_other_object():
    module, state = randomised(ViewAttention(32, heads=4, norm_groups=32))
    x = np.random.default_rng(2).normal(size=(8, 32, 3, 3))
    reference = lgm_numpy.NumpyLgm({f"a.{key}": value for key, value in state.items()}, TINY)
    got = module(torch.from_numpy(x).float()).detach().numpy()
    np.testing.assert_allclose(
        got, np.concatenate([reference.attend("a", x[:4]), reference.attend("a", x[4:])]), atol=1e-4
    )
    changed = x.copy()
    changed[3, :, 1, 1] += 3
    moved = np.abs(module(torch.from_numpy(changed).float()).detach().numpy() - got).max(axis=(1, 2, 3))
    assert (moved[:4] > 1e-3).all()
    assert moved[4:].max() < 1e-6


def test_the_whole_network_agrees_with_numpy():
    weights = tiny_weights()
    network = LgmNetwork(TINY)
    network.load_state_dict({key: torch.from_numpy(value).float() for key, value in weights.items()}, strict=True)
    x = np.random.default_rng(3).normal(size=(4, 9, 32, 32)).astype(np.float32)
    with torch.inference_mode():
        got = network(torch.from_numpy(x)).numpy()
    expected = lgm_numpy.NumpyLgm(weights, TINY)(x)
    assert got.shape == (TINY.gaussian_count, 14) == (1024, 14)
    assert expected.std() > 0.1
    np.testing.assert_allclose(got, expected, atol=1e-4 * np.abs(expected).max())


def test_gaussians_come_view_by_view_and_row_by_row():
    network = LgmNetwork(TINY)
    size = TINY.output_px
    marked = torch.arange(4 * 14 * size * size, dtype=torch.float32).view(4, 14, size, size)
    network.unet = torch.nn.Identity()
    network.conv = torch.nn.Identity()
    rows = network(marked)
    torch.testing.assert_close(rows[2 * size * size + 3 * size + 5], marked[2, :, 3, 5])
