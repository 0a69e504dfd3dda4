"""Labels that a user brings: what is accepted; all else is refused in one sentence before it is read."""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest

from phys4dgen.errors import FormatError, StageError
from phys4dgen.grouping.from_file import parts_from_file, rename_parts, single_part


def test_npy_with_gaps_is_renumbered_in_order(tmp_path: Path):
    np.save(tmp_path / "labels.npy", np.array([40, 7, 7, 3], np.uint8))
    parts = parts_from_file(tmp_path / "labels.npy", 4)
    np.testing.assert_array_equal(parts.labels, [2, 1, 1, 0])
    assert parts.names == ("part_0", "part_1", "part_2")
    assert parts.backend == "file"


@pytest.mark.parametrize("compressed", [False, True])
def test_npz_with_names(tmp_path: Path, compressed: bool):
    save = np.savez_compressed if compressed else np.savez
    save(tmp_path / "groups.npz", labels=np.array([0, 1, 1]), names=np.array(["pot", "leaves"]), votes=np.zeros(9))
    parts = parts_from_file(tmp_path / "groups.npz", 3)
    assert parts.names == ("pot", "leaves")
    np.testing.assert_array_equal(parts.labels, [0, 1, 1])


def test_names_may_be_given_for_unused_numbers_too(tmp_path: Path):
    np.savez(tmp_path / "l.npz", labels=np.array([0, 2]), names=np.array(["a", "unused", "c"]))
    assert parts_from_file(tmp_path / "l.npz", 2).names == ("a", "c")


def save_npz(path: Path, **arrays: object) -> None:
    np.savez(path, allow_pickle=True, **{name: np.asarray(array) for name, array in arrays.items()})


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"labels": [0, 1]}, "one whole number for each of the input's 3 Gaussians, got shape (2,)"),
        ({"labels": [[0, 1, 1]]}, "got shape (1, 3)"),
        ({"labels": [0.0, 1.0, 1.0]}, "labels must be whole numbers (int32), got float64"),
        ({"labels": [0, -1, 1]}, "labels must be 0 or more, got -1 at index 1"),
        ({"labels": ["a", "b", "c"]}, "labels must be whole numbers (int32), got <U1"),
        ({"labels": np.array([0, None, 1], object)}, "labels holds Python objects, which are not read"),
        ({"part": [0, 1, 1]}, "expected an array called labels, got part"),
        ({"labels": [0, 1, 1], "names": ["a"]}, "must name each of the 2 parts"),
        ({"labels": [0, 1, 1], "names": ["a", "a"]}, "names must differ"),
        ({"labels": [0, 1, 1], "names": ["a", ""]}, "printable text of 1 to 64 characters, got ''"),
        ({"labels": [0, 1, 1], "names": [1, 2]}, "names must be a list of text"),
    ],
)
def test_unfit_arrays_are_refused(tmp_path: Path, arrays: dict[str, object], message: str):
    path = tmp_path / "labels.npz"
    save_npz(path, **arrays)
    with pytest.raises(FormatError) as error:
        parts_from_file(path, 3)
    assert message in str(error.value)
    assert str(path) in str(error.value)


def test_too_many_parts_are_refused(tmp_path: Path):
    np.save(tmp_path / "labels.npy", np.arange(300))
    with pytest.raises(FormatError, match="at most 256 different parts, got 300"):
        parts_from_file(tmp_path / "labels.npy", 300)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("l.npy", b"", "labels is not a NumPy array"),
        ("l.npy", b"hello world, no array", "labels is not a NumPy array"),
        ("l.npy", b"\x93NUMPY\x03\x00" + bytes(200), "it is of version 3.0, expected 1.0"),
        ("l.npz", b"", "damaged"),
        ("l.npz", b"PK\x03\x04 broken", "damaged"),
        ("l.txt", b"0 1 1", "from .npy or .npz files, got '.txt'"),
    ],
)
def test_damaged_files_are_refused(tmp_path: Path, name: str, content: bytes, message: str):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FormatError) as error:
        parts_from_file(tmp_path / name, 3)
    assert message in str(error.value)


def test_types_that_numpy_has_given_up_are_refused_without_a_warning(tmp_path: Path):
    np.save(tmp_path / "l.npy", np.zeros(3, np.int64))
    content = (tmp_path / "l.npy").read_bytes()
    (tmp_path / "l.npy").write_bytes(content.replace(b"<i8", b"<a8"))
    with pytest.raises(FormatError, match="labels is not a NumPy array"):
        parts_from_file(tmp_path / "l.npy", 3)


def test_a_missing_file_is_one_sentence(tmp_path: Path):
    with pytest.raises(FormatError, match="cannot read the labels: No such file"):
        parts_from_file(tmp_path / "nothing.npz", 3)


def npy_announcing(shape: str) -> bytes:
    """A .npy file whose header announces a shape that its content does not have."""
    header = f"{{'descr': '<i8', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode()


def test_a_huge_announcement_allocates_nothing(tmp_path: Path):
    (tmp_path / "l.npy").write_bytes(npy_announcing("(1000000000000,)"))
    with pytest.raises(FormatError, match="8,000,000,000,000 bytes; at most 24 fit this input"):
        parts_from_file(tmp_path / "l.npy", 3)
    with zipfile.ZipFile(tmp_path / "l.npz", "w") as archive:
        archive.writestr("labels.npy", npy_announcing("(3,)"))
    with pytest.raises(FormatError, match="labels is cut short; 24 bytes announced, 0 found"):
        parts_from_file(tmp_path / "l.npz", 3)


def test_renaming():
    parts = single_part(5)
    assert parts.names == ("part_0",)
    assert rename_parts(parts, {0: "statue"}).names == ("statue",)
    with pytest.raises(StageError, match="there is no part 3; the parts are 0 to 0"):
        rename_parts(parts, {3: "x"})


def test_renaming_keeps_names_apart(tmp_path: Path):
    np.save(tmp_path / "l.npy", np.array([0, 1]))
    parts = parts_from_file(tmp_path / "l.npy", 2)
    assert rename_parts(parts, {0: "part_1", 1: "part_0"}).names == ("part_1", "part_0")
    with pytest.raises(StageError, match="two would be called 'part_1'"):
        rename_parts(parts, {0: "part_1"})
