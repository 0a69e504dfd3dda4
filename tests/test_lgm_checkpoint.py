"""LGM's checkpoint: loaded to the last key, or refused in one sentence before memory is taken."""

import pickle

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="LGM needs torch (extra 'models')")

from lgm_tiny import TINY, safetensors_bytes, tiny_weights  # noqa: E402
from phys4dgen.errors import FormatError  # noqa: E402
from phys4dgen.reconstruct.lgm import checkpoint as checkpoint_module  # noqa: E402
from phys4dgen.reconstruct.lgm.checkpoint import load_network  # noqa: E402
from phys4dgen.reconstruct.lgm.configuration import BIG  # noqa: E402


@pytest.fixture(scope="module")
def weights():
    return tiny_weights()


def test_every_parameter_arrives(weights, tmp_path):
    path = tmp_path / "tiny.safetensors"
    path.write_bytes(safetensors_bytes(weights))
    state = load_network(path, TINY).state_dict()
    assert set(state) == set(weights)
    for key, value in weights.items():
        np.testing.assert_array_equal(state[key].numpy(), value.astype(np.float32))
    assert not any(value.is_meta or value.requires_grad for value in state.values())


def test_files_of_the_safetensors_library_are_read(weights, tmp_path):
    library = pytest.importorskip("safetensors.numpy", reason="safetensors is not installed (extra 'models')")
    path = tmp_path / "tiny.safetensors"
    library.save_file(weights, path, metadata={"format": "pt"})
    state = load_network(path, TINY).state_dict()
    np.testing.assert_array_equal(state["conv.bias"].numpy(), weights["conv.bias"].astype(np.float32))


def without(weights, key):
    return {name: value for name, value in weights.items() if name != key}


def shifted(header):
    header["conv.weight"]["data_offsets"] = [2 + place for place in header["conv.weight"]["data_offsets"]]


def shared(header):
    header["unet.norm_out.bias"]["data_offsets"] = header["unet.norm_out.weight"]["data_offsets"]


def negative(header):
    header["conv.bias"]["data_offsets"] = [-28, 0]


def listed(header):
    header["conv.bias"]["dtype"] = ["F32"]


def endless(header):
    header["conv.bias"]["shape"] = [2**47]


CASES = {
    "cut off": (lambda w: safetensors_bytes(w)[:-10], "should be .* bytes long"),
    "too long": (lambda w: safetensors_bytes(w) + b"\0", "should be .* bytes long"),
    "cut off in the header": (lambda w: safetensors_bytes(w)[:200], "cut off in its header"),
    "empty": (lambda w: b"", "cut off in its header"),
    "a torch.save file": (lambda w: b"PK\x03\x04" + bytes(200), "is a pickle"),
    "a pickle": (lambda w: pickle.dumps(w), "is a pickle"),
    "garbage": (lambda w: bytes(range(256)) * 4, "not a safetensors file"),
    "no JSON": (lambda w: (40).to_bytes(8, "little") + b"x" * 80, "header of the checkpoint is damaged"),
    "deep JSON": (lambda w: (200_000).to_bytes(8, "little") + b"[" * 200_000, "damaged"),
    "a list": (lambda w: (2).to_bytes(8, "little") + b"[]", "no JSON object"),
    "a missing key": (lambda w: safetensors_bytes(without(w, "conv.bias")), "1 of its .* missing and 0 are unknown"),
    "another key": (lambda w: safetensors_bytes({**w, "lpips.x": np.zeros(3, np.float32)}), "0 of .* 1 are unknown"),
    "another shape": (
        lambda w: safetensors_bytes({**w, "conv.weight": np.zeros((14, 15, 1, 1), np.float16)}),
        r"'conv.weight' has shape \(14, 15, 1, 1\), expected \(14, 14, 1, 1\)",
    ),
    "whole numbers": (
        lambda w: safetensors_bytes({**w, "conv.bias": np.zeros(14, np.int64)}),
        "numbers of type I64, expected F16 or F32",
    ),
    "a gap": (lambda w: safetensors_bytes(w, edit=shifted), "overlap or leave gaps"),
    "shared bytes": (lambda w: safetensors_bytes(w, edit=shared), "overlap or leave gaps"),
    "a negative place": (lambda w: safetensors_bytes(w, edit=negative), "entry of 'conv.bias' .* damaged"),
    "a list of types": (lambda w: safetensors_bytes(w, edit=listed), "numbers of type .* expected F16 or F32"),
    "an endless shape": (lambda w: safetensors_bytes(w, edit=endless), "entry of 'conv.bias' .* damaged"),
    "not a number": (
        lambda w: safetensors_bytes({**w, "conv.bias": np.full(14, np.nan, np.float16)}),
        "not finite",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_what_is_no_checkpoint_is_refused_in_one_sentence(case, weights, tmp_path):
    spoil, message = CASES[case]
    path = tmp_path / "spoilt.safetensors"
    path.write_bytes(spoil(weights))
    with pytest.raises(FormatError, match=message) as raised:
        load_network(path, TINY)
    assert "\n" not in str(raised.value)


def test_a_missing_file(tmp_path):
    with pytest.raises(FormatError, match="no such checkpoint"):
        load_network(tmp_path / "none.safetensors", TINY)


def test_the_checkpoint_of_another_network_is_refused_before_anything_is_read(weights, tmp_path, monkeypatch):
    path = tmp_path / "tiny.safetensors"
    path.write_bytes(safetensors_bytes(weights))

    def never(*_):
        raise AssertionError("a tensor was read")

    monkeypatch.setattr(checkpoint_module, "read_tensor", never)
    with pytest.raises(FormatError, match="tensors are missing"):
        load_network(path, BIG)
