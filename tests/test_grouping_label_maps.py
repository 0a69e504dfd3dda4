"""Label maps that a user brings: the two forms, and one clear sentence for everything else."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from phys4dgen.errors import FormatError
from phys4dgen.grouping.label_maps import read_label_maps
from phys4dgen.grouping.lift import lift, parts_from_maps
from phys4dgen.render.cameras import intrinsics
from phys4dgen.types import Camera, Gaussians

SIZE = 8


def camera() -> Camera:
    viewmat = np.eye(4)
    viewmat[2, 3] = 4.0
    return Camera(viewmat=viewmat, K=intrinsics(60, SIZE, SIZE), width=SIZE, height=SIZE)


def write_cameras(folder: Path, names: tuple[str, ...]) -> None:
    one = camera()
    entry = {"width": SIZE, "height": SIZE, "K": one.K.tolist(), "viewmat": one.viewmat.tolist()}
    (folder / "cameras.json").write_text(json.dumps({"cameras": [{"name": name, **entry} for name in names]}))


def write_png(path: Path, values: np.ndarray) -> None:
    Image.fromarray(values.astype(np.uint8)).save(path)


def halves() -> np.ndarray:
    """3 on the left, 7 on the right, nothing in the lowest row."""
    labels = np.full((SIZE, SIZE), 3)
    labels[:, SIZE // 2 :] = 7
    labels[-1] = -1
    return labels


def test_a_folder_of_pictures_and_arrays(tmp_path: Path):
    write_cameras(tmp_path, ("view_00", "view_01", "view_02"))
    write_png(tmp_path / "view_00_parts.png", halves() + 1)  # 0 abstains in a picture
    np.save(tmp_path / "view_02.npy", halves())
    maps = read_label_maps(tmp_path)
    assert len(maps.cameras) == 2
    np.testing.assert_array_equal(maps.numbers, [3, 7])
    expected = np.select([halves() == 3, halves() == 7], [0, 1], -1)
    np.testing.assert_array_equal(maps.masks.labels, [expected, expected])


def test_an_archive_with_its_own_cameras_and_names_becomes_parts(tmp_path: Path):
    one = camera()
    names = np.array([f"n{number}" for number in range(8)])
    np.savez(tmp_path / "m.npz", masks=halves()[None], viewmats=one.viewmat[None], Ks=one.K[None], names=names)
    maps = read_label_maps(tmp_path / "m.npz")
    gaussians = Gaussians(
        means=np.array([[-0.5, 0, 0], [0.5, 0, 0]], np.float32),
        quats_wxyz=np.tile([1, 0, 0, 0], (2, 1)).astype(np.float32),
        scales=np.full((2, 3), 0.02, np.float32),
        opacities=np.full(2, 0.9, np.float32),
        sh=np.zeros((2, 1, 3), np.float32),
    )
    depth = np.full((1, SIZE, SIZE), 4.0, np.float32)
    parts = parts_from_maps(maps, lift(gaussians, maps.masks, cameras=maps.cameras, depth=depth))
    assert parts.names == ("n3", "n7")
    np.testing.assert_array_equal(parts.labels, [0, 1])
    assert parts.votes is not None and parts.visible is not None
    assert parts.votes.shape == (2, 2) and parts.visible.all()


def test_maps_of_another_size_take_the_cameras_of_the_run(tmp_path: Path):
    np.savez(tmp_path / "m.npz", masks=np.zeros((1, 16, 16), np.int64))
    maps = read_label_maps(tmp_path / "m.npz", cameras=[camera()])
    assert (maps.cameras[0].width, maps.cameras[0].height) == (16, 16)
    np.testing.assert_allclose(maps.cameras[0].K[:2], 2 * camera().K[:2])


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"masks": np.zeros((2, 8, 8), int)}, "2 masks need as many cameras, got 1; add viewmats and Ks"),
        ({"masks": np.zeros((8, 8), int)}, "masks must be whole numbers of shape"),
        ({"masks": np.zeros((1, 8, 8))}, "masks must be whole numbers of shape"),
        ({"masks": np.zeros((1, 8, 6), int)}, "masks of 6 x 8 px do not fit a view of 8 x 8 px"),
        ({"masks": np.full((1, 8, 8), -2)}, "or -1 for none; got -2"),
        ({"masks": np.full((1, 8, 8), -1)}, "1 to 256 different parts, got 0"),
        ({"labels": np.zeros((1, 8, 8), int)}, "expected an array called masks, got labels"),
        ({"masks": np.zeros((1, 8, 8), int), "viewmats": np.eye(4), "Ks": np.eye(3)}, "need viewmats of shape (1, 4"),
        ({"masks": np.ones((1, 8, 8), int), "names": np.array(["a"])}, "a name for each number from 0 to 1"),
    ],
)
def test_unfit_archives_are_refused(tmp_path: Path, arrays: dict[str, np.ndarray], message: str):
    path = tmp_path / "m.npz"
    np.savez(path, allow_pickle=False, **arrays)
    with pytest.raises(FormatError) as error:
        read_label_maps(path, cameras=[camera()])
    assert message in str(error.value)


def test_unfit_folders_are_refused(tmp_path: Path):
    with pytest.raises(FormatError, match="cannot read the cameras of the label maps"):
        read_label_maps(tmp_path)
    (tmp_path / "cameras.json").write_text("[" * 100_000)
    with pytest.raises(FormatError, match="expected JSON as in the views folder"):
        read_label_maps(tmp_path)
    write_cameras(tmp_path, ("../view",))
    with pytest.raises(FormatError, match="needs a name of its own that can be a file's"):
        read_label_maps(tmp_path)
    write_cameras(tmp_path, ("view_00",))
    text = (tmp_path / "cameras.json").read_text()
    (tmp_path / "cameras.json").write_text(text.replace('"width": 8', '"width": 1e999'))
    with pytest.raises(FormatError, match="needs name, width, height"):
        read_label_maps(tmp_path)
    (tmp_path / "cameras.json").write_text(re.sub(r'"K": \[\[[^,]*', '"K": [[1' + "0" * 400, text))
    with pytest.raises(FormatError, match="too large to convert"):
        read_label_maps(tmp_path)
    (tmp_path / "cameras.json").write_text(text)
    with pytest.raises(FormatError, match="expected a label map for a camera"):
        read_label_maps(tmp_path)
    write_png(tmp_path / "view_00.png", np.zeros((4, 4)))
    with pytest.raises(FormatError, match="expected 8 x 8 px as its camera says, got 4 x 4"):
        read_label_maps(tmp_path)
    write_png(tmp_path / "view_00.png", np.zeros((8, 8, 3)))
    with pytest.raises(FormatError, match="expected a grey or indexed picture"):
        read_label_maps(tmp_path)
    (tmp_path / "view_00.png").write_bytes(b"\x89PNG broken")
    with pytest.raises(FormatError, match="cannot read the label map"):
        read_label_maps(tmp_path)
