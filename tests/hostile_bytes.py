"""Good files and lying headers, from which hostile files are made."""

from __future__ import annotations

import io
import zipfile

import numpy as np

from ply_bytes import inria_columns, ply_bytes

RAW = inria_columns(8, degree=1)
GOOD = ply_bytes(RAW)
VERTEX = b"element vertex 8"


def with_values(**values):
    """A PLY in which the first rows of some columns are replaced."""
    columns = {name: column.copy() for name, column in RAW.items()}
    for name, replacement in values.items():
        columns[name][: len(np.atleast_1d(replacement))] = replacement
    return ply_bytes(columns, types=dict.fromkeys(values, "double"))


def without(*names):
    return ply_bytes({name: column for name, column in RAW.items() if name not in names})


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
