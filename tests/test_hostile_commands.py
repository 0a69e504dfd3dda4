"""Forty hostile files through the command line: one pinned sentence each, at once, and little memory."""

from __future__ import annotations

import io
import json
import os
import struct
import sys
import time
import tracemalloc
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from hostile_bytes import GOOD, RAW, VERTEX, npy
from phys4dgen.cli import main
from phys4dgen.errors import Phys4DGenError
from phys4dgen.grouping.from_file import parts_from_file
from phys4dgen.materials import read_materials
from phys4dgen.types import Gaussians
from ply_bytes import ply_bytes
from test_formats_compressed import compressed

ERROR_TEXTS = Path(__file__).with_name("error_texts.json")


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
