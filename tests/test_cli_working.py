"""Ctrl-C within a command that works in a run folder."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

from phys4dgen.cli.arguments import parse
from phys4dgen.cli.working import work
from phys4dgen.formats.npz import save_npz


def _interrupt():
    raise KeyboardInterrupt


def _interrupt_amid_an_archive(path: Path) -> None:
    """As where Ctrl-C comes when zipfile has just opened a file for writing: closing the archive fails then."""
    with zipfile.ZipFile(path, "w") as archive, archive.open("array.npy", "w"):
        try:
            _interrupt()
        finally:
            archive.close()


def test_ctrl_c_that_a_library_turns_into_an_error_of_its_own_is_ctrl_c(tmp_path, capsys):
    arguments = parse(["simulate", str(tmp_path)])
    with pytest.raises(ValueError, match="open writing handle"):
        _interrupt_amid_an_archive(tmp_path / "a.npz")
    assert work(arguments, tmp_path, lambda _: _interrupt_amid_an_archive(tmp_path / "b.npz")) == 130  # type: ignore[arg-type, return-value]
    assert "interrupted" in capsys.readouterr().err


def test_errors_without_ctrl_c_stay_errors(tmp_path):
    def fail(_):
        raise ValueError("bad")

    with pytest.raises(ValueError, match="bad"):
        work(parse(["simulate", str(tmp_path)]), tmp_path, fail)


def test_arrays_come_back_and_an_interrupted_write_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "arrays.npz"
    save_npz(path, {"a": np.arange(3)})
    monkeypatch.setattr(Path, "write_bytes", lambda *_: _interrupt())
    with pytest.raises(KeyboardInterrupt):
        save_npz(path, {"a": np.arange(5)})
    with np.load(path, allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["a"], np.arange(3))
    assert [found.name for found in tmp_path.iterdir()] == ["arrays.npz"]
