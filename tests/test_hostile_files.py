"""Damaged and hostile splats and trajectories: one clear sentence, and no memory for what a header merely promises."""

from __future__ import annotations

import struct
import time
import tracemalloc
import zipfile

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hostile_bytes import GOOD, RAW, VERTEX, npy, pickled, trajectory_zip, with_values, without
from phys4dgen.errors import FormatError
from phys4dgen.export.trajectory import read_trajectory
from phys4dgen.formats import load_gaussians
from ply_bytes import inria_columns, ply_bytes

FACE_BOMB = "element face 4000000000\nproperty list uchar int vertex_indices"

# name of the file, its bytes, what the sentence must say
HOSTILE = {
    "empty ply": ("a.ply", b"", "empty"),
    "empty splat": ("a.splat", b"", "empty"),
    "one byte": ("a.ply", b"p", "starts with the line 'ply'"),
    "wrong magic": ("a.ply", b"glTF" + GOOD[4:], "starts with the line 'ply'"),
    "only magic": ("a.ply", b"ply\n", "cut off"),
    "never ends": ("a.ply", b"ply\nfoo", "cut off"),
    "no end_header": ("a.ply", GOOD[: GOOD.index(b"end_header")], "cut off"),
    "10 MB of header": ("a.ply", b"ply\nformat ascii 1.0\n" + b"comment x\n" * 1_000_000, "no 'end_header' line"),
    "10 MB in one line": ("a.ply", b"ply\ncomment " + b"x" * 10_000_000, "no 'end_header' line"),
    "many properties": ("a.ply", b"ply\nelement vertex 1\n" + b"property int a\n" * 15_000 + b"end_header\n", "format"),
    "no format line": ("a.ply", GOOD.replace(b"format binary_little_endian 1.0\n", b""), "no 'format' line"),
    "unknown format": ("a.ply", GOOD.replace(b"binary_little_endian", b"binary_middle_endian"), "no valid format"),
    "garbage line": ("a.ply", GOOD.replace(b"property float x", b"prperty float x"), "'prperty float x'"),
    "property of nothing": ("a.ply", b"ply\nformat ascii 1.0\nproperty float x\nend_header\n", "no valid"),
    "unknown type": ("a.ply", GOOD.replace(b"float opacity", b"flaot opacity"), "Did you mean 'float'"),
    "list in vertex": ("a.ply", GOOD.replace(b"property float x", b"property list uchar float x"), "list property"),
    "list counted in floats": (
        "a.ply",
        GOOD.replace(b"property float x", b"property list float int x"),
        "integer type",
    ),
    "property twice": ("a.ply", GOOD.replace(b"float f_rest_8", b"float f_rest_7"), "twice"),
    "vertex twice": ("a.ply", GOOD.replace(VERTEX, VERTEX + b"\n" + VERTEX), "'vertex' twice"),
    "no vertex": ("a.ply", GOOD.replace(b"element vertex", b"element vortex"), "no 'vertex' element"),
    "huge count": ("a.ply", GOOD.replace(VERTEX, b"element vertex 2000000000"), "promises 2000000000 Gaussians"),
    "count beyond 64 bit": ("a.ply", GOOD.replace(VERTEX, b"element vertex " + b"9" * 30), "number of rows"),
    "endless count": ("a.ply", GOOD.replace(VERTEX, b"element vertex " + b"9" * 5000), "number of rows"),
    "negative count": ("a.ply", GOOD.replace(VERTEX, b"element vertex -5"), "got '-5'"),
    "count in words": ("a.ply", GOOD.replace(VERTEX, b"element vertex many"), "got 'many'"),
    "count in another script": ("a.ply", GOOD.replace(VERTEX, b"element vertex \xb2"), "number of rows"),
    "count of one too many": ("a.ply", GOOD.replace(VERTEX, b"element vertex 9"), "enough for 8"),
    "no Gaussians": ("a.ply", GOOD.replace(VERTEX, b"element vertex 0"), "0 Gaussians"),
    "huge ascii count": ("a.ply", ply_bytes(RAW, encoding="ascii", count=10**12), "promises 1000000000000"),
    "ascii with a word": ("a.ply", ply_bytes(RAW, encoding="ascii")[:-9] + b" what\n" + b"0 " * 40, "ASCII"),
    "ascii with an empty line": ("a.ply", ply_bytes(RAW, encoding="ascii").replace(b"er\n", b"er\n\n"), "empty line"),
    "truncated body": ("a.ply", GOOD[:-1], "cut off"),
    "huge element before": ("a.ply", ply_bytes(RAW, before=("element e 900000000000\nproperty int i", b"")), "'e'"),
    "huge list element before": ("a.ply", ply_bytes(RAW, before=(FACE_BOMB, b"")), "'face'"),
    "long list before": (
        "a.ply",
        ply_bytes(RAW, before=("element e 1\nproperty list uint double v", struct.pack("<I", 2**32 - 1))),
        "'e'",
    ),
    "negative list before": (
        "a.ply",
        ply_bytes(RAW, before=("element e 1\nproperty list int double v", struct.pack("<i", -7))),
        "'e'",
    ),
    "a point cloud": ("a.ply", ply_bytes({"x": [0.0], "y": [0.0], "z": [0.0]}), "lacks 11 of its properties"),
    "no opacity": ("a.ply", without("opacity"), r"lacks 1 of its properties \(opacity\)"),
    "half an SH degree": ("a.ply", without("f_rest_8"), "0, 9, 24 or 45"),
    "a gap in f_rest": ("a.ply", GOOD.replace(b"float f_rest_3", b"float f_rest_9"), "0, 9, 24 or 45"),
    "NaN everywhere": (
        "a.ply",
        ply_bytes({name: np.full(8, np.nan) for name in RAW}),
        "8 of 8 Gaussians .* x = nan of Gaussian 0",
    ),
    "one NaN": ("a.ply", with_values(scale_1=[0, 0, np.nan]), "1 of 8 Gaussians .* scale_1 = nan of Gaussian 2"),
    "NaN in f_rest": ("a.ply", with_values(f_rest_5=[0, np.nan]), "f_rest_5 = nan of Gaussian 1"),
    "NaN quaternion": ("a.ply", with_values(rot_3=[np.nan]), "rot_3 = nan"),
    "NaN opacity": ("a.ply", with_values(opacity=[np.nan]), "opacity = nan"),
    "infinite position": ("a.ply", with_values(y=[np.inf]), "y = inf"),
    "double beyond float": ("a.ply", with_values(z=[1e300]), "z = inf"),
    "position too large to square": ("a.ply", with_values(z=[1e30]), r"z = 1e\+30"),
    "scale beyond float": ("a.ply", with_values(scale_0=[500.0]), "scale_0 = 500"),
    "splat of odd size": ("a.splat", b"\0" * 33, "33 bytes, 1 too many"),
    "splat of one byte": ("a.splat", b"\0", "1 bytes"),
    "splat of NaN": ("a.splat", b"\xff" * 320, "10 of 10 Gaussians .* x = nan"),
    "splat with negative scale": ("a.splat", struct.pack("<6f8B", 0, 0, 0, 1, -1, 1, *[9] * 8), "scale y = -1"),
    "unknown suffix": ("a.xyz", b"1 2 3\n", "expected .ply and .splat"),
    "spz": ("a.spz", b"NGSP", "later version"),
    "ksplat": ("a.ksplat", b"\0\1", "later version"),
    "sog": ("a.sog", b"PK", "later version"),
    "an image": ("a.PNG", b"\x89PNG\r\n", "later version"),
    "no suffix": ("a", b"\0" * 32, "no suffix"),
}


def check_refusal(path, says, *, read=load_gaussians):
    tracemalloc.start()
    start = time.process_time()  # a busy machine is not the reader's doing
    try:
        with pytest.raises(FormatError, match=says) as caught:
            read(path)
        seconds, (_, peak) = time.process_time() - start, tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    text = str(caught.value)
    assert str(path) in text
    assert "\n" not in text and text.isprintable() and len(text) < 400 + len(str(path)), text
    assert text.endswith((".", "?")), text
    assert seconds < 2, f"took {seconds:.1f} s"
    assert peak < 8e6, f"took {peak / 1e6:.0f} MB"


@pytest.mark.parametrize("case", HOSTILE)
def test_hostile_splat_gets_one_sentence(tmp_path, case):
    name, content, says = HOSTILE[case]
    (tmp_path / name).write_bytes(content)
    check_refusal(tmp_path / name, says)


def test_missing_file_folder_and_device(tmp_path):
    check_refusal(tmp_path / "nothing.ply", "no such file")
    check_refusal(tmp_path, "folder")
    check_refusal("/dev/null", "device")
    check_refusal(tmp_path / ("x" * 300), "no such file|cannot be reached")
    with pytest.raises(FormatError, match=r"cannot be reached|no such file"):
        load_gaussians("a\0b.ply")


@given(data=st.data())
@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_random_damage_is_refused_or_harmless(tmp_path, data):
    """Any damage leads to Gaussians (whose type validates them) or to FormatError, never to another exception."""
    encoding = data.draw(st.sampled_from(["binary_little_endian", "ascii"]))
    content = bytearray(ply_bytes(inria_columns(3), encoding=encoding))
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(content)))
        stop = data.draw(st.integers(start, min(len(content), start + 12)))
        content[start:stop] = data.draw(st.binary(max_size=12))
    (tmp_path / "a.ply").write_bytes(content)
    try:
        load_gaussians(tmp_path / "a.ply")
    except FormatError as error:
        assert str(error).isprintable()


@given(content=st.binary(min_size=32, max_size=32 * 3))
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_random_splat_is_refused_or_harmless(tmp_path, content):
    (tmp_path / "a.splat").write_bytes(content)
    try:
        load_gaussians(tmp_path / "a.splat")
    except FormatError as error:
        assert str(error).isprintable()


F32 = np.float32
HOSTILE_TRAJECTORIES = {
    "empty": (b"", "not a readable trajectory"),
    "no zip": (b"what is this" * 40, "not a readable trajectory"),
    "truncated": (trajectory_zip()[:-30], "not a readable trajectory"),
    "member missing": (trajectory_zip(positions=None), "'positions' is missing"),
    "pickle": (trajectory_zip(positions=pickled()), "expected 'positions' as float32"),
    "wrong type": (trajectory_zip(positions=npy(np.zeros((2, 5, 3)))), "expected 'positions' as float32"),
    "wrong rank": (trajectory_zip(positions=npy(np.zeros((2, 5), F32))), "3 dimensions"),
    "huge shape": (trajectory_zip(positions=npy(np.zeros((2, 5, 3), F32), shape=(2, 10**12, 3))), "promises shape"),
    "shape beyond 64 bit": (
        trajectory_zip(positions=npy(np.zeros((2, 5, 3), F32), shape=(2**40, 2**40, 3))),
        "promises shape",
    ),
    "negative shape": (trajectory_zip(positions=npy(np.zeros((2, 5, 3), F32), shape=(-2, -5, 3))), "promises shape"),
    "counts differ": (trajectory_zip(positions=npy(np.zeros((2, 4, 3), F32))), "not a readable trajectory"),
    "NaN": (trajectory_zip(positions=npy(np.full((2, 5, 3), np.nan, F32))), "finite"),
    "no npy": (trajectory_zip(positions=b"hello"), "not a readable trajectory"),
    "zip bomb": (
        trajectory_zip(positions=npy(np.zeros((2, 500_000, 3), F32)), compression=zipfile.ZIP_DEFLATED),
        "uncompressed",
    ),
}


@pytest.mark.parametrize("case", HOSTILE_TRAJECTORIES)
def test_hostile_trajectory_gets_one_sentence(tmp_path, case):
    content, says = HOSTILE_TRAJECTORIES[case]
    (tmp_path / "trajectory.npz").write_bytes(content)
    check_refusal(tmp_path / "trajectory.npz", says, read=read_trajectory)


def test_missing_trajectory(tmp_path):
    check_refusal(tmp_path / "trajectory.npz", "no such file", read=read_trajectory)
    check_refusal(tmp_path, "not a readable trajectory", read=read_trajectory)
