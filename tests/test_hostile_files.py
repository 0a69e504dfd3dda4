"""Damaged and hostile files: one clear sentence, at once, and no memory for what the header merely promises."""

from __future__ import annotations

import io
import json
import os
import struct
import sys
import time
import tracemalloc
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from phys4dgen.cli import main
from phys4dgen.errors import FormatError, Phys4DGenError
from phys4dgen.export.trajectory import read_trajectory
from phys4dgen.formats import load_gaussians
from phys4dgen.grouping.from_file import parts_from_file
from phys4dgen.materials import read_materials
from phys4dgen.types import Gaussians
from ply_bytes import inria_columns, ply_bytes
from test_formats_compressed import compressed

RAW = inria_columns(8, degree=1)
GOOD = ply_bytes(RAW)
VERTEX = b"element vertex 8"
ERROR_TEXTS = Path(__file__).with_name("error_texts.json")


def with_values(**values):
    """A PLY in which the first rows of some columns are replaced."""
    columns = {name: column.copy() for name, column in RAW.items()}
    for name, replacement in values.items():
        columns[name][: len(np.atleast_1d(replacement))] = replacement
    return ply_bytes(columns, types=dict.fromkeys(values, "double"))


def without(*names):
    return ply_bytes({name: column for name, column in RAW.items() if name not in names})


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
    start = time.perf_counter()
    try:
        with pytest.raises(FormatError, match=says) as caught:
            read(path)
        seconds, (_, peak) = time.perf_counter() - start, tracemalloc.get_traced_memory()
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


def npy(array, *, shape=None):
    """Bytes of a .npy whose header may lie about the shape."""
    stream = io.BytesIO()
    header = {"descr": array.dtype.str, "fortran_order": False, "shape": array.shape if shape is None else shape}
    np.lib.format.write_array_header_1_0(stream, header)
    return stream.getvalue() + array.tobytes()


def trajectory_zip(*, compression=zipfile.ZIP_STORED, **members):
    good = {
        "times_s": npy(np.zeros(2)),
        "positions": npy(np.zeros((2, 5, 3), np.float32)),
        "deformation_gradients": npy(np.zeros((2, 5, 3, 3), np.float32)),
    }
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", compression) as archive:
        for name, content in (good | members).items():
            if content is not None:
                archive.writestr(f"{name}.npy", content)
    return stream.getvalue()


def pickled():
    stream = io.BytesIO()
    np.save(stream, np.array([{"a": 1}, None], object), allow_pickle=True)
    return stream.getvalue()


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


# ------------------------------------------------------------------------------------------ through the command line


def saved(save, *arrays, **named):
    """Bytes of a .npy or .npz."""
    stream = io.BytesIO()
    save(stream, *arrays, **named)
    return stream.getvalue()


def picture(kind="PNG", size=(64, 64), **options):
    stream = io.BytesIO()
    Image.linear_gradient("L").resize(size).convert("RGB").save(stream, kind, **options)
    return stream.getvalue()


def png_of(width, height):
    """A PNG whose header promises a size that its few bytes do not hold."""
    chunk = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + chunk + struct.pack(">I", zlib.crc32(chunk)) + b"\0" * 40


def packed_ply(**changes):
    """A compressed PLY of 300 Gaussians, with words of its header replaced."""
    rng = np.random.default_rng(0)
    gaussians = Gaussians(
        means=rng.normal(size=(300, 3)),
        quats_wxyz=np.tile([1, 0, 0, 0], (300, 1)),
        scales=np.full((300, 3), 0.01),
        opacities=np.full(300, 0.5),
        sh=np.zeros((300, 1, 3)),
    )
    content = compressed(gaussians)
    for old, new in changes.values():
        assert old in content
        content = content.replace(old, new, 1)
    return content


def scene(text):
    return {"scene.yaml": text if isinstance(text, bytes) else text.encode()}, ["generate", "--scene", "scene.yaml"]


def labels(name, content):
    return {name: content}, lambda: parts_from_file(Path(name), 8)


def splat(content, name="a.ply"):
    return {name: content}, ["generate", name, *UP]


def photo(content, name="a.png"):
    return {name: content}, ["generate", name]


def materials(text):
    return {"m.yaml": text.encode()}, lambda: read_materials("m.yaml", ("part_0",))


UP = ["--up", "z", "--height-m", "0.3"]
BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{chr(98 + k)}: &{chr(98 + k)} [{', '.join(['*' + chr(97 + k)] * 9)}]\n" for k in range(9)
)
COMMANDS = {
    # splats
    "point cloud": splat(ply_bytes({"x": [0.0], "y": [0.0], "z": [0.0]})),
    "header of a count of 2 billion": splat(GOOD.replace(VERTEX, b"element vertex 2000000000")),
    "cut in the middle": splat(GOOD[: len(GOOD) // 2]),
    "all NaN": splat(ply_bytes({name: np.full(8, np.nan) for name in RAW})),
    "a mesh called splat": splat(b"v 0 0 0\nf 1 1 1\n", "a.splat"),
    "compressed: cut": splat(packed_ply()[:-100]),
    "compressed: too many promised": splat(packed_ply(a=(b"element vertex 300", b"element vertex 4000000000"))),
    "compressed: chunks missing": splat(packed_ply(a=(b"element chunk 2", b"element chunk 1"))),
    "compressed: a chunk too many": splat(packed_ply(a=(b"element chunk 2", b"element chunk 900000000"))),
    "compressed: another packing": splat(packed_ply(a=(b"packed_position", b"packed_positron"))),
    "all at one point": splat(ply_bytes({name: np.zeros(8) for name in RAW})),
    # pictures
    "png of 60000 x 60000": photo(png_of(60000, 60000)),
    "png that is cut": photo(picture()[:-60]),
    "text called png": photo(b"not a picture at all"),
    "empty png": photo(b""),
    "png of 4 x 4": photo(picture(size=(4, 4))),
    "jpeg that is cut": photo(picture("JPEG")[:200], "a.jpg"),
    "webp of nothing": photo(b"RIFF\xff\xff\xff\xffWEBPVP8L" + b"\0" * 30, "a.webp"),
    "empty picture of one colour": photo(saved(lambda s: Image.new("RGB", (64, 64), "white").save(s, "PNG"))),
    # labels
    "labels: no archive": labels("l.npz", b"PK\x03\x04 and nothing"),
    "labels: pickle": labels("l.npy", saved(np.save, np.array([{}] * 8, object), allow_pickle=True)),
    "labels: of another input": labels("l.npy", saved(np.save, np.zeros(7, np.int32))),
    "labels: promise of a terabyte": labels("l.npy", npy(np.zeros(8, np.int32), shape=(10**12,))),
    "labels: negative shape": labels("l.npy", npy(np.zeros(8, np.int32), shape=(-8,))),
    "labels: fractions": labels("l.npy", saved(np.save, np.zeros(8))),
    "labels: header of nonsense": labels("l.npy", b"\x93NUMPY\x01\x00\x20\x00{'descr': '<i4', 'fortran_or(((  \n"),
    "labels: header of 4 GB": labels("l.npy", b"\x93NUMPY\x02\x00\xf0\xff\xff\xff{'descr'"),
    "labels: bomb": labels("l.npz", saved(np.savez_compressed, labels=np.zeros((4000, 4000), np.int32))),
    "labels: not called labels": labels("l.npz", saved(np.savez, **{"la\x1bels": np.zeros(8, np.int32)})),
    # scenes
    "scene: empty": scene(""),
    "scene: a list": scene("- input\n- up\n"),
    "scene: bytes": scene(bytes(range(256)) * 8),
    "scene: not UTF-8": scene("input: pl\xe4tzchen.splat".encode("latin-1")),
    "scene: not YAML": scene("input: [a.splat\nup: -y\n"),
    "scene: laughs": scene(BOMB),
    "scene: an abyss": scene("a: " + "[" * 20_000),
    "scene: 20 MB": scene("# " + "x" * 20_000_000),
    "scene: a Python object": scene("input: !!python/object/apply:os.system ['true']\n"),
    "scene: a key twice": scene("input: a.splat\nup: z\nup: -y\n"),
    "scene: a misspelt key": scene("input: a.splat\ngruoping: {parts: 3}\n"),
    "scene: no such input": scene("input: nothing.splat\n"),
    "scene: a device": scene("input: /dev/zero\n"),
    # materials
    "materials: not YAML": materials("parts: {pot: {"),
    "materials: of no part": materials("parts: {pot: {surface: {name: steel}}}"),
    "materials: infinitely stiff": materials("parts: {part_0: {surface: {name: steel, youngs_modulus_pa: 1e999}}}"),
    "materials: text for a number": materials("parts: {part_0: {surface: {name: steel, density_kgm3: heavy}}}"),
    "materials: of no kind": materials("parts: {part_0: {surface: {name: unobtainium}}}"),
}  # fmt: skip
WORDED_BY_LIBRARIES = (
    *("png", "empty png", "text called png", "jpeg", "webp"),
    *("labels: no archive", "scene: not YAML", "materials: not YAML"),
)
"""Sentences that quote another library, whose words change with its version."""


@pytest.fixture(scope="module")
def imported(tmp_path_factory):
    """The first command of a process imports much, which is not the reader's doing."""
    path = tmp_path_factory.mktemp("first") / "a.ply"
    path.write_bytes(b"")
    main(["generate", str(path), "-o", str(path.with_name("run")), "-q"])
    path.with_name("m.yaml").write_text("parts: {part_0: {surface: {name: steel}}}", "utf-8")
    read_materials(path.with_name("m.yaml"), ("part_0",))


def refused(read):
    """What the command line makes of a reader's error, without the stages before it."""
    with pytest.raises(Phys4DGenError) as caught:
        read()
    sys.stderr.write(f"phys4dgen: {caught.value}\n")
    return 1


@pytest.mark.parametrize("case", COMMANDS)
def test_a_hostile_file_ends_a_command_with_one_sentence(tmp_path, monkeypatch, capsys, imported, case):
    files, job = COMMANDS[case]
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    monkeypatch.chdir(tmp_path)
    tracemalloc.start()
    start = time.perf_counter()
    try:
        code = refused(job) if callable(job) else main([*job, "-o", "run", "-q"])
        seconds, (_, peak) = time.perf_counter() - start, tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    said = capsys.readouterr().err.strip().splitlines()
    assert code in (1, 2), said
    assert len(said) == 1, said
    assert said[0].startswith("phys4dgen: ")
    assert said[0].isprintable()
    assert len(said[0]) < 500
    assert "internal error" not in said[0]
    assert seconds < 5, f"took {seconds:.1f} s"
    assert peak < 500e6, f"took {peak / 1e6:.0f} MB"
    if not case.startswith(WORDED_BY_LIBRARIES):
        check_wording(case, said[0].replace(str(tmp_path), "FOLDER"))


def check_wording(case, sentence):
    """Error texts are part of the product: a change of one is seen here (PHYS4DGEN_UPDATE_TEXTS=1 takes it over)."""
    texts = json.loads(ERROR_TEXTS.read_text("utf-8")) if ERROR_TEXTS.is_file() else {}
    if os.environ.get("PHYS4DGEN_UPDATE_TEXTS"):
        texts[case] = sentence
        ERROR_TEXTS.write_text(json.dumps(dict(sorted(texts.items())), indent=1, ensure_ascii=False) + "\n", "utf-8")
    assert texts.get(case) == sentence


def test_there_are_forty_hostile_files_and_no_forgotten_texts():
    assert len(COMMANDS) >= 40
    pinned = {case for case in COMMANDS if not case.startswith(WORDED_BY_LIBRARIES)}
    assert set(json.loads(ERROR_TEXTS.read_text("utf-8"))) == pinned
