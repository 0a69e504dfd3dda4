"""Splat files: every layout is read to the values that the conventions promise, and written for others to read."""

from __future__ import annotations

import logging
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phys4dgen.errors import FormatError
from phys4dgen.formats import (
    PlyFrameWriter,
    atomic_path,
    load_gaussians,
    read_ply,
    read_splat,
    read_splat_file,
    save_gaussians,
)
from phys4dgen.types import SH_C0, Gaussians
from ply_bytes import inria_columns, ply_bytes


def expected_gaussians(raw):
    """What a file's raw columns mean, in float64, by the conventions of INRIA's code."""
    rest = sum(name.startswith("f_rest_") for name in raw)
    sh = np.zeros((len(raw["x"]), 1 + rest // 3, 3))
    for channel in range(3):
        sh[:, 0, channel] = raw[f"f_dc_{channel}"]
        for k in range(rest // 3):
            sh[:, 1 + k, channel] = raw[f"f_rest_{channel * (rest // 3) + k}"]
    quats = np.stack([raw[f"rot_{i}"] for i in range(4)], 1)
    return {
        "means": np.stack([raw[name] for name in "xyz"], 1),
        "quats_wxyz": quats / np.linalg.norm(quats, axis=1, keepdims=True),
        "scales": np.exp(np.stack([raw[f"scale_{i}"] for i in range(3)], 1)),
        "opacities": 1 / (1 + np.exp(-np.asarray(raw["opacity"]))),
        "sh": sh,
    }


def assert_gaussians(got: Gaussians, expected, *, rtol=2e-6, atol=1e-7):
    for name, value in expected.items():
        np.testing.assert_allclose(getattr(got, name), value, rtol=rtol, atol=atol, err_msg=name)


def assert_equal(got: Gaussians, want: Gaussians, **tolerance):
    fields = ("means", "quats_wxyz", "scales", "opacities", "sh")
    assert_gaussians(got, {name: getattr(want, name) for name in fields}, **tolerance)


@pytest.mark.parametrize("normals", [True, False])
@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_ply_of_every_degree_means_what_inria_says(tmp_path, degree, normals):
    raw = inria_columns(37, degree=degree, normals=normals)
    path = tmp_path / "a.ply"
    path.write_bytes(ply_bytes(raw))
    splat = read_ply(path)
    assert splat.gaussians.sh_degree == degree
    assert not splat.extra and not splat.notes
    assert_gaussians(splat.gaussians, expected_gaussians(raw))


def test_f_rest_is_channel_major(tmp_path):
    raw = inria_columns(2, degree=3)
    for i in range(45):
        raw[f"f_rest_{i}"] = np.full(2, float(i))
    path = tmp_path / "a.ply"
    path.write_bytes(ply_bytes(raw))
    sh = load_gaussians(path).sh
    assert sh[0, 1].tolist() == [0, 15, 30]
    assert sh[0, 15].tolist() == [14, 29, 44]


@given(data=st.data())
@settings(max_examples=40, deadline=None)
def test_order_types_and_extra_columns_do_not_matter(tmp_path_factory, data):
    raw = inria_columns(5, degree=data.draw(st.sampled_from([0, 1])), normals=False)
    columns = dict(raw)
    for i, kind in enumerate(data.draw(st.lists(st.sampled_from(["uchar", "int", "ushort", "double"]), max_size=3))):
        columns[f"group_{i}_{kind}"] = np.arange(5) + i
    names = data.draw(st.permutations(list(columns)))
    number = st.sampled_from(["float", "float32", "double", "float64"])
    types = {name: data.draw(number) if name in raw else name.split("_")[-1] for name in names}
    encoding = data.draw(st.sampled_from(["binary_little_endian", "binary_big_endian", "ascii"]))
    path = tmp_path_factory.mktemp("ply") / "a.ply"
    path.write_bytes(ply_bytes({name: columns[name] for name in names}, types=types, encoding=encoding))
    splat = read_ply(path)
    assert_gaussians(splat.gaussians, expected_gaussians(raw))
    assert set(splat.extra) == set(columns) - set(raw)
    for name, values in splat.extra.items():
        assert values.tolist() == columns[name].tolist(), name
        assert values.dtype.isnative


def test_all_float_columns_in_another_order(tmp_path):
    raw = inria_columns(5, degree=1)
    for names in (list(raw)[::-1], sorted(raw)):
        (tmp_path / "a.ply").write_bytes(ply_bytes({name: raw[name] for name in names}))
        assert_gaussians(load_gaussians(tmp_path / "a.ply"), expected_gaussians(raw))


def test_integer_columns_may_hold_gaussian_values(tmp_path):
    raw = inria_columns(4)
    raw["x"], raw["opacity"] = np.array([-3.0, 2.0, 0.0, 7.0]), np.array([1.0, 0.0, 2.0, -5.0])
    path = tmp_path / "a.ply"
    path.write_bytes(ply_bytes(raw, types={"x": "int", "opacity": "short", "nx": "char"}))
    assert_gaussians(load_gaussians(path), expected_gaussians(raw))


def test_more_rows_than_a_block(tmp_path):
    raw = inria_columns(5001)
    for encoding in ("binary_little_endian", "ascii"):
        path = tmp_path / f"{encoding}.ply"
        path.write_bytes(ply_bytes(raw, encoding=encoding))
        assert_gaussians(load_gaussians(path), expected_gaussians(raw))


FACES = ("element face 2\nproperty list uchar int vertex_indices", struct.pack("<B3iB4i", 3, 0, 1, 2, 4, 0, 1, 2, 3))
CAMERA = ("element camera 2\nproperty double t\nproperty uchar id", struct.pack("<dBdB", 1.5, 1, 2.5, 2))


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize("before", [FACES, CAMERA], ids=["lists before", "numbers before"])
@pytest.mark.parametrize("after", [FACES, CAMERA], ids=["lists after", "numbers after"])
def test_other_elements_and_comments_are_stepped_over(tmp_path, before, after, newline):
    if before is after:
        after = (after[0].replace("element ", "element more_"), after[1])
    raw = inria_columns(6, degree=1)
    lines = ["comment element vertex 99", "obj_info made by hand, grüße", "comment end_header"]
    path = tmp_path / "a.ply"
    path.write_bytes(ply_bytes(raw, header_lines=lines, before=before, after=after, newline=newline))
    assert_gaussians(load_gaussians(path), expected_gaussians(raw))


def test_ascii_elements_before_vertex_are_stepped_over(tmp_path):
    raw = inria_columns(3)
    before = ("element face 2\nproperty list uchar int vertex_indices", b"3 0 1 2\n4 0 1 2 3\n")
    path = tmp_path / "a.ply"
    path.write_bytes(ply_bytes(raw, encoding="ascii", before=before))
    assert_gaussians(load_gaussians(path), expected_gaussians(raw))


def test_repairs_are_noted(tmp_path, caplog):
    raw = inria_columns(4)
    for i in range(4):
        raw[f"rot_{i}"][1] = 0
    raw["scale_1"][2] = -np.inf  # log(0): what a flat disc becomes in some exporters
    raw["opacity"][:2] = -np.inf, np.inf
    path = tmp_path / "a.ply"
    path.write_bytes(ply_bytes(raw))
    splat = read_ply(path)
    assert splat.gaussians.quats_wxyz[1].tolist() == [1, 0, 0, 0]
    assert splat.gaussians.opacities[:2].tolist() == [0, 1]
    assert 0 < splat.gaussians.scales[2, 1] < 1e-17
    assert len(splat.notes) == 2 and "1 of 4 quaternions" in splat.notes[0] and "scale of zero" in splat.notes[1]
    with caplog.at_level(logging.WARNING):
        load_gaussians(path)
    assert "quaternions" in caplog.text


def test_huge_quaternions_are_normalised(tmp_path):
    raw = inria_columns(3)
    for i in range(4):
        raw[f"rot_{i}"] = raw[f"rot_{i}"] * 1e30
    path = tmp_path / "a.ply"
    path.write_bytes(ply_bytes(raw))
    assert_gaussians(load_gaussians(path), expected_gaussians(raw))


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_written_ply_has_inrias_layout(tmp_path, random_gaussians, degree):
    path = tmp_path / "new folder" / "a.ply"
    save_gaussians(random_gaussians(11, sh_degree=degree), path)
    header, body = path.read_bytes().split(b"end_header\n", 1)
    lines = header.decode("ascii").splitlines()
    assert lines[:3] == ["ply", "format binary_little_endian 1.0", "element vertex 11"]
    assert [line.split() for line in lines[3:]] == [["property", "float", n] for n in inria_columns(1, degree=degree)]
    assert len(body) == 11 * {0: 68, 1: 104, 2: 164, 3: 248}[degree]
    columns = np.frombuffer(body, "<f4").reshape(11, -1)
    assert (columns[:, 3:6] == 0).all()


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_ply_round_trip(tmp_path, random_gaussians, degree):
    gaussians = random_gaussians(3000, sh_degree=degree)
    path = tmp_path / "a.ply"
    save_gaussians(gaussians, path)
    again = load_gaussians(path)
    assert (again.means == gaussians.means).all()
    assert (again.sh == gaussians.sh).all()
    assert_equal(again, gaussians, rtol=2e-6, atol=1e-7)
    save_gaussians(again, tmp_path / "b.ply")
    assert_equal(load_gaussians(tmp_path / "b.ply"), again, rtol=2e-6, atol=1e-7)


def test_opacities_of_exactly_0_and_1_stay(tmp_path, random_gaussians):
    some = random_gaussians(3)
    gaussians = Gaussians(some.means, some.quats_wxyz, some.scales, np.array([0, 1, 0.5], np.float32), some.sh)
    save_gaussians(gaussians, tmp_path / "a.ply")
    assert np.abs(load_gaussians(tmp_path / "a.ply").opacities - [0, 1, 0.5]).max() < 1e-7


def test_frame_writer_changes_only_what_moves(tmp_path, random_gaussians):
    gaussians, other = random_gaussians(50, sh_degree=2), random_gaussians(50, sh_degree=2, seed=1)
    writer = PlyFrameWriter(gaussians)
    writer.write(
        tmp_path / "1.ply",
        means=other.means,
        quats_wxyz=other.quats_wxyz,
        scales=other.scales,
        sh_rest=other.sh[:, 1:],
    )
    frame = load_gaussians(tmp_path / "1.ply")
    sh = np.concatenate([gaussians.sh[:, :1], other.sh[:, 1:]], axis=1)
    assert_equal(frame, Gaussians(other.means, other.quats_wxyz, other.scales, gaussians.opacities, sh))
    with pytest.raises(ValueError, match="sh_rest"):
        writer.write(
            tmp_path / "2.ply", means=other.means, quats_wxyz=other.quats_wxyz, scales=other.scales, sh_rest=other.sh
        )
    assert not (tmp_path / "2.ply").exists()


@pytest.mark.parametrize("degree", [0, 3])
def test_plyfile_reads_the_same(tmp_path, random_gaussians, degree):
    plyfile = pytest.importorskip("plyfile", reason="the independent reader plyfile is not installed")
    gaussians = random_gaussians(500, sh_degree=degree)
    save_gaussians(gaussians, tmp_path / "a.ply")
    vertex = plyfile.PlyData.read(str(tmp_path / "a.ply"))["vertex"]
    assert_gaussians(gaussians, expected_gaussians({p.name: np.asarray(vertex[p.name]) for p in vertex.properties}))


@pytest.mark.parametrize("degree", [0, 3])
def test_gsply_reads_the_same(tmp_path, random_gaussians, degree):
    gsply = pytest.importorskip("gsply", reason="the independent reader gsply is not installed")
    gaussians = random_gaussians(500, sh_degree=degree)
    save_gaussians(gaussians, tmp_path / "a.ply")
    other = gsply.plyread(tmp_path / "a.ply")
    assert (other.means == gaussians.means).all()
    assert (other.sh0 == gaussians.sh[:, 0]).all()
    assert (np.asarray(other.quats) == gaussians.quats_wxyz).all()
    np.testing.assert_allclose(np.exp(other.scales), gaussians.scales, rtol=2e-6)
    np.testing.assert_allclose(1 / (1 + np.exp(-other.opacities)), gaussians.opacities, rtol=2e-6)
    if degree:
        assert (np.asarray(other.shN).reshape(500, -1, 3) == gaussians.sh[:, 1:]).all()


def test_splat_record_by_hand(tmp_path):
    path = tmp_path / "a.splat"
    record = struct.pack("<6f8B", 1, 2, 3, 0.1, 0.2, 0.3, 255, 0, 128, 51, 128, 128 + 64, 128, 0)
    path.write_bytes(record * 2)
    gaussians = load_gaussians(path)
    assert len(gaussians) == 2 and gaussians.sh_degree == 0
    assert gaussians.means[0].tolist() == [1, 2, 3]
    np.testing.assert_allclose(gaussians.scales[0], [0.1, 0.2, 0.3], rtol=1e-6)
    np.testing.assert_allclose(0.5 + SH_C0 * gaussians.sh[0, 0], [1, 0, 128 / 255], atol=1e-6)
    np.testing.assert_allclose(gaussians.opacities[0], 0.2, rtol=1e-6)
    np.testing.assert_allclose(gaussians.quats_wxyz[0], np.array([0, 0.5, 0, -1]) / 1.25**0.5, rtol=1e-6)


def test_splat_quantisation_stays_in_its_bounds(tmp_path, random_gaussians, caplog):
    gaussians = random_gaussians(4000, sh_degree=1)
    with caplog.at_level(logging.WARNING):
        save_gaussians(gaussians, tmp_path / "a.splat")
    assert "no spherical harmonics" in caplog.text
    assert (tmp_path / "a.splat").stat().st_size == 32 * 4000
    again = load_gaussians(tmp_path / "a.splat")
    assert (again.means == gaussians.means).all()
    assert (again.scales == gaussians.scales).all()
    assert np.abs(again.opacities - gaussians.opacities).max() <= 1 / 510 + 1e-6
    assert np.abs(again.base_colors - gaussians.base_colors).max() <= 1 / 510 + 1e-6
    # Half a step in each of four components moves a unit quaternion by 1/128, clipping +1 to 127/128 as much again.
    same_sign = np.sign((again.quats_wxyz * gaussians.quats_wxyz).sum(1, keepdims=True))
    assert np.linalg.norm(again.quats_wxyz * same_sign - gaussians.quats_wxyz, axis=1).max() <= 2 / 128


def test_splat_with_zero_quaternion_and_scale(tmp_path):
    path = tmp_path / "a.splat"
    path.write_bytes(struct.pack("<6f8B", 0, 0, 0, 0, 1, 1, 9, 9, 9, 9, 128, 128, 128, 128))
    splat = read_splat(path)
    assert splat.gaussians.quats_wxyz.tolist() == [[1, 0, 0, 0]]
    assert splat.gaussians.scales[0, 0] > 0
    assert len(splat.notes) == 2


def test_content_goes_before_suffix(tmp_path):
    raw = inria_columns(3)
    (tmp_path / "a.splat").write_bytes(ply_bytes(raw))
    (tmp_path / "b").write_bytes(ply_bytes(raw))
    for name in ("a.splat", "b"):
        assert_gaussians(load_gaussians(tmp_path / name), expected_gaussians(raw))
    assert read_splat_file(str(tmp_path / "b")).layout == "PLY, binary_little_endian, 17 properties"


@pytest.mark.parametrize(
    ("name", "hint"), [("a.spz", "later version"), ("a.plz", "Did you mean '.ply'"), ("a", ".ply")]
)
def test_unknown_suffixes_cannot_be_written(tmp_path, random_gaussians, name, hint):
    with pytest.raises(FormatError, match=hint):
        save_gaussians(random_gaussians(2), tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_unwritable_place_is_a_format_error(tmp_path, random_gaussians):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(FormatError, match="cannot be written"):
        save_gaussians(random_gaussians(2), tmp_path / "file" / "a.ply")


def test_atomic_path_keeps_the_old_file_when_writing_fails(tmp_path):
    path = tmp_path / "a.ply"
    path.write_text("old")
    with pytest.raises(RuntimeError), atomic_path(path) as temporary:
        temporary.write_text("half of the new")
        raise RuntimeError("killed")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
    with atomic_path(path) as temporary:
        temporary.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(("name", "count"), [("plant.splat", 113_648), ("ponytail_palm.splat", 14_007)])
def test_real_captures_survive_conversion(tmp_path, shared_data, name, count):
    source = shared_data / "splats" / name
    gaussians = load_gaussians(source)
    assert len(gaussians) == count
    save_gaussians(gaussians, tmp_path / "a.ply")
    again = load_gaussians(tmp_path / "a.ply")
    assert_equal(again, gaussians, rtol=2e-6, atol=1e-7)
    save_gaussians(again, tmp_path / "a.splat")
    old = np.frombuffer(source.read_bytes(), np.uint8).reshape(-1, 32)
    new = np.frombuffer((tmp_path / "a.splat").read_bytes(), np.uint8).reshape(-1, 32)
    assert (old[:, :12] == new[:, :12]).all()  # positions, bit for bit
    assert (old[:, 24:28] == new[:, 24:28]).all()  # colours and opacities
