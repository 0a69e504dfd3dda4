"""What a run leaves behind: frames, colours that turn along, trajectory, video, pictures, facts about a file."""

from __future__ import annotations

import json
import re
import subprocess
from itertools import pairwise

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation
from scipy.special import sph_harm_y

from phys4dgen.errors import RunError
from phys4dgen.export import video
from phys4dgen.export.frames import FrameWriter, frame_path, remove_frames_from
from phys4dgen.export.inspection import inspect_splat
from phys4dgen.export.pictures import contact_sheet, evenly_spaced, part_colors, parts_picture, write_png
from phys4dgen.export.trajectory import read_trajectory, trajectory_writer, write_trajectory
from phys4dgen.export.video import write_video
from phys4dgen.formats import load_gaussians, save_gaussians, write_ply
from phys4dgen.render.sh_rotation import rotate_sh
from phys4dgen.types import Gaussians, Trajectory

# Spherical harmonics -----------------------------------------------------------------------------------------------


def real_harmonics(degree, directions):
    """Real harmonics from SciPy's complex ones, in 3DGS order and sign; [M, (degree + 1)^2], float64.

    3DGS has the sign (-1)^m of the Condon-Shortley phase in it: Y_1 = (-y, z, -x) * 0.4886.
    """
    x, y, z = np.asarray(directions, np.float64).T
    polar, azimuth = np.arccos(np.clip(z, -1, 1)), np.arctan2(y, x)
    columns = []
    for band in range(degree + 1):
        for m in range(-band, band + 1):
            complex_value = sph_harm_y(band, abs(m), polar, azimuth)
            if m < 0:
                columns.append(2**0.5 * complex_value.imag)
            elif m > 0:
                columns.append(2**0.5 * complex_value.real)
            else:
                columns.append(complex_value.real)
    return np.stack(columns, axis=1)


def unit_vectors(rng, count):
    vectors = rng.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_rotated_sh_shows_the_original_seen_from_the_turned_side(degree):
    rng = np.random.default_rng(degree)
    n = 2500  # more than a block
    sh = rng.normal(size=(n, (degree + 1) ** 2, 3)).astype(np.float32)
    rotations = Rotation.random(n, rng=rng).as_matrix()
    turned = rotate_sh(sh, rotations)
    assert (turned[:, 0] == sh[:, 0]).all()
    for _ in range(8):
        directions = unit_vectors(rng, n)
        here = np.einsum("nk,nkc->nc", real_harmonics(degree, directions), turned.astype(np.float64))
        back = np.einsum("nji,nj->ni", rotations, directions)  # R^T d
        there = np.einsum("nk,nkc->nc", real_harmonics(degree, back), sh.astype(np.float64))
        assert np.abs(here - there).max() < 1e-5


def test_scipy_harmonics_have_the_signs_of_3dgs():
    """The oracle itself, against the constants printed in INRIA's code."""
    d = np.array([[0.6, -0.48, 0.64]])
    x, y, z = d[0]
    degree_3 = -0.5900435899266435 * y * (3 * x * x - y * y)
    want = [0.28209479177387814, -0.4886025119029199 * y, 0.4886025119029199 * z, -0.4886025119029199 * x]
    got = real_harmonics(3, d)[0]
    np.testing.assert_allclose(got[:4], want, atol=1e-12)
    np.testing.assert_allclose(got[[4, 7, 9]], [1.0925484305920792 * x * y, -1.0925484305920792 * x * z, degree_3])


def test_rotations_compose_and_the_identity_is_exact_to_rounding():
    rng = np.random.default_rng(5)
    sh = rng.normal(size=(200, 16, 3)).astype(np.float32)
    first, second = (Rotation.random(200, rng=rng).as_matrix() for _ in range(2))
    np.testing.assert_allclose(rotate_sh(rotate_sh(sh, first), second), rotate_sh(sh, second @ first), atol=1e-5)
    np.testing.assert_allclose(rotate_sh(sh, np.tile(np.eye(3), (200, 1, 1))), sh, atol=2e-6)


def test_rotate_sh_refuses_wrong_shapes():
    with pytest.raises(ValueError, match=r"sh: expected shape"):
        rotate_sh(np.zeros((2, 5, 3)), np.zeros((2, 3, 3)))
    with pytest.raises(ValueError, match=r"rotations: expected shape"):
        rotate_sh(np.zeros((2, 4, 3)), np.zeros((3, 3, 3)))


# Frames ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("degree", [0, 2])
def test_frames_hold_what_was_given(tmp_path, random_gaussians, degree):
    rest, moved = random_gaussians(300, sh_degree=degree), random_gaussians(300, seed=9)
    rotations = Rotation.random(300, rng=np.random.default_rng(2)).as_matrix()
    writer = FrameWriter(rest, tmp_path / "frames")
    first = writer.write(0, means=rest.means, quats_wxyz=rest.quats_wxyz, scales=rest.scales)
    second = writer.write(1, means=moved.means, quats_wxyz=moved.quats_wxyz, scales=moved.scales, rotations=rotations)
    again = writer.write(2, means=rest.means, quats_wxyz=rest.quats_wxyz, scales=rest.scales)
    assert [path.name for path in (first, second, again)] == ["frame_0000.ply", "frame_0001.ply", "frame_0002.ply"]
    write_ply(rest, tmp_path / "gaussians.ply")
    assert first.read_bytes() == again.read_bytes() == (tmp_path / "gaussians.ply").read_bytes()
    frame = load_gaussians(second)
    assert (frame.means == moved.means).all()
    np.testing.assert_allclose(frame.quats_wxyz, moved.quats_wxyz, atol=1e-6)
    np.testing.assert_allclose(frame.scales, moved.scales, rtol=2e-6)
    np.testing.assert_allclose(frame.opacities, rest.opacities, atol=1e-6)
    assert (frame.sh == rotate_sh(rest.sh, rotations)).all()


def test_frames_of_a_longer_run_are_removed(tmp_path):
    for index in (0, 1, 47, 48, 10000):
        frame_path(tmp_path, index).touch()
    (tmp_path / "frame_0099_mine.ply").touch()
    assert remove_frames_from(tmp_path, 48) == 2
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "frame_0000.ply",
        "frame_0001.ply",
        "frame_0047.ply",
        "frame_0099_mine.ply",
    ]


# Trajectory --------------------------------------------------------------------------------------------------------


def random_trajectory(frames, n):
    rng = np.random.default_rng(frames)
    return Trajectory(
        times_s=np.arange(frames) / 24,
        positions=rng.normal(size=(frames, n, 3)).astype(np.float32),
        deformation_gradients=rng.normal(size=(frames, n, 3, 3)).astype(np.float32),
    )


def test_trajectory_round_trip_and_plain_numpy(tmp_path):
    trajectory = random_trajectory(7, 123)
    write_trajectory(trajectory, tmp_path / "trajectory.npz")
    again = read_trajectory(tmp_path / "trajectory.npz")
    with np.load(tmp_path / "trajectory.npz", allow_pickle=False) as plain:
        for name in ("times_s", "positions", "deformation_gradients"):
            assert (getattr(again, name) == getattr(trajectory, name)).all()
            assert (plain[name] == getattr(trajectory, name)).all()
            assert plain[name].dtype == getattr(trajectory, name).dtype
    write_trajectory(trajectory, tmp_path / "b.npz")
    assert (tmp_path / "b.npz").read_bytes() == (tmp_path / "trajectory.npz").read_bytes()
    np.savez(tmp_path / "c.npz", **{name: getattr(again, name) for name in vars(again)})
    assert (read_trajectory(tmp_path / "c.npz").positions == trajectory.positions).all()


def test_unfinished_trajectory_leaves_nothing(tmp_path):
    trajectory = random_trajectory(3, 4)
    path = tmp_path / "trajectory.npz"
    with (
        pytest.raises(ValueError, match="expected 3 frames, got 1"),
        trajectory_writer(path, times_s=trajectory.times_s, gaussian_count=4) as append,
    ):
        append(trajectory.positions[0], trajectory.deformation_gradients[0])
    with (
        pytest.raises(ValueError, match=r"positions: expected shape \(4, 3\), got \(3, 3\)"),
        trajectory_writer(path, times_s=trajectory.times_s, gaussian_count=4) as append,
    ):
        append(trajectory.positions[0][:3], trajectory.deformation_gradients[0])
    assert not list(tmp_path.iterdir())


# Video -------------------------------------------------------------------------------------------------------------


def moving_square(frames, height, width):
    pictures = []
    for index in range(frames):
        picture = np.full((height, width, 3), (250, 250, 250), np.uint8)
        picture[20:60, 10 + 4 * index : 50 + 4 * index] = (30, 160, 60)
        pictures.append(picture)
    return pictures


def decode(ffmpeg, path):
    """Frames of a video and what the ffmpeg program says about its stream."""
    colour = ["-vf", "scale=in_color_matrix=bt709:out_range=pc,format=rgb24"]
    command = [ffmpeg, "-hide_banner", "-i", str(path), *colour, "-f", "rawvideo", "-"]
    done = subprocess.run(command, capture_output=True, check=True)
    (stream,) = re.findall(r"Video: .*", done.stderr.decode().split("Output #0")[0])
    width, height = map(int, re.search(r", (\d+)x(\d+)", stream).groups())
    return np.frombuffer(done.stdout, np.uint8).reshape(-1, height, width, 3), stream


@pytest.fixture
def ffmpeg():
    found = video.ffmpeg_executable()
    if found is None:
        pytest.skip("there is no ffmpeg here")
    return found


@pytest.mark.parametrize(("height", "width", "fps"), [(120, 160, 24), (121, 161, 30000 / 1001)])
def test_mp4_decodes_to_the_same_pictures(tmp_path, ffmpeg, height, width, fps):
    pictures = moving_square(13, height, width)
    path, warnings = write_video(iter(pictures), tmp_path / "video.mp4", fps=fps)
    assert path == tmp_path / "video.mp4" and warnings == ()
    assert [p.name for p in tmp_path.iterdir()] == ["video.mp4"]
    frames, stream = decode(ffmpeg, path)
    assert frames.shape == (13, height + height % 2, width + width % 2, 3)
    assert float(re.search(r"([\d.]+) fps", stream)[1]) == pytest.approx(fps, abs=0.01)
    assert "h264" in stream and "yuv420p(tv, bt709" in stream
    for frame, picture in zip(frames, pictures, strict=True):
        assert np.abs(frame[:height, :width].astype(int) - picture).mean() < 2
    content = path.read_bytes()
    assert content.index(b"moov") < content.index(b"mdat")  # playable before it is fully loaded


def test_mp4_keeps_colours(tmp_path, ffmpeg):
    pictures = moving_square(5, 120, 160)
    path, _ = write_video(pictures, tmp_path / "video.mp4", fps=24)
    # Decoded with the matrix that the file names; converted with one and tagged with another, it is off by 10.
    frames, _ = decode(ffmpeg, path)
    assert np.abs(frames[0, 30:50, 20:40].mean((0, 1)) - (30, 160, 60)).max() < 4
    assert np.abs(frames[0, 90:110, 100:150].mean((0, 1)) - 250).max() < 3


def test_without_ffmpeg_the_video_is_webp_and_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr(video, "ffmpeg_executable", lambda: None)
    path, warnings = write_video(moving_square(6, 80, 100), tmp_path / "video.mp4", fps=24)
    assert path == tmp_path / "video.webp" and "WebP" in warnings[0]
    with Image.open(path) as image:
        assert image.n_frames == 6 and image.size == (100, 80)
    assert [p.name for p in tmp_path.iterdir()] == ["video.webp"]


def test_ffmpeg_that_fails_is_one_sentence(tmp_path, monkeypatch):
    monkeypatch.setattr(video, "ffmpeg_executable", lambda: "/bin/false")
    with pytest.raises(RunError, match="ffmpeg ended with code 1"):
        write_video(moving_square(40, 200, 300), tmp_path / "video.mp4", fps=24)
    assert not list(tmp_path.iterdir())


def test_frames_that_differ_in_size_stop_the_video(tmp_path, ffmpeg):
    pictures = [*moving_square(2, 80, 100), *moving_square(1, 82, 100)]
    with pytest.raises(ValueError, match=r"frames: expected uint8 of shape \(80, 100, 3\)"):
        write_video(pictures, tmp_path / "video.mp4", fps=24)
    with pytest.raises(ValueError, match="at least one"):
        write_video([], tmp_path / "video.mp4", fps=24)
    assert not list(tmp_path.iterdir())


# Pictures ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("frames", "count"), [(1, 12), (2, 12), (5, 12), (12, 12), (48, 12), (97, 12), (48, 1)])
def test_evenly_spaced_frames(frames, count):
    chosen = evenly_spaced(frames, count)
    assert len(chosen) == min(frames, count)
    assert chosen[0] == 0 and all(a < b for a, b in pairwise(chosen))
    if count > 1:
        assert chosen[-1] == frames - 1
        steps = np.diff(chosen)
        assert len(steps) == 0 or steps.max() - steps.min() <= 1


def test_contact_sheet_shows_every_frame_in_order(tmp_path):
    images = [np.full((60, 80, 3), 10 + 20 * i, np.uint8) for i in range(7)]
    sheet = contact_sheet(images, [i / 24 for i in range(7)], columns=4)
    assert sheet.dtype == np.uint8 and sheet.shape[2] == 3
    for i in range(7):
        top, left = 8 + i // 4 * (60 + 24 + 8), 8 + i % 4 * 88
        assert (sheet[top : top + 60, left : left + 80] == 10 + 20 * i).all()
        assert (sheet[top + 60 : top + 84, left : left + 80] < 128).any()  # the caption
    write_png(sheet, tmp_path / "contact_sheet.png")
    with Image.open(tmp_path / "contact_sheet.png") as image:
        assert (np.asarray(image) == sheet).all()


def test_parts_picture_colours_the_parts_and_keeps_the_background():
    render = np.full((100, 120, 3), 240, np.uint8)
    part_map = np.full((100, 120), -1, np.int32)
    part_map[20:50, 20:100] = 0
    part_map[50:90, 20:100] = 1
    render[20:90, 20:100] = np.linspace(40, 220, 80).astype(np.uint8)[None, :, None]
    picture = parts_picture([render, render], [part_map, part_map], names=["pot", "leaves"], shares=[0.25, 0.75])
    first = picture[8:108, 8:128].astype(int)
    assert (first[:15] == 240).all()
    colors = part_colors(2).astype(int)
    for part, row in ((0, 25), (1, 85)):
        assert np.abs(first[row, 99] - colors[part]).max() <= 2  # the brightest pixel has the legend's colour
        assert first[row, 21].sum() < 0.6 * first[row, 97].sum()  # the shading stays
    legend = picture[116:]
    assert all((np.abs(legend.astype(int) - color).sum(axis=2) == 0).sum() > 100 for color in colors)


def test_part_colors_are_distinct():
    colors = part_colors(21).astype(int)
    distances = np.abs(colors[:, None] - colors[None]).sum(axis=2)
    assert distances[~np.eye(21, dtype=bool)].min() > 20
    assert part_colors(0).shape == (0, 3)


# Inspection and the up guess ---------------------------------------------------------------------------------------


def test_inspection_names_every_problem(tmp_path, random_gaussians):
    some = random_gaussians(1000, sh_degree=1)
    means, scales, quats = some.means.copy(), some.scales.copy(), some.quats_wxyz.copy()
    means[0] = 500
    scales[1] = 50
    means[2], scales[2], quats[2] = means[3], scales[3], quats[3]
    opacities, sh = some.opacities.copy(), some.sh.copy()
    opacities[2], sh[2] = opacities[3], sh[3]
    save_gaussians(Gaussians(means, quats, scales, opacities, sh), tmp_path / "a.ply")
    facts = inspect_splat(tmp_path / "a.ply")
    assert facts == json.loads(json.dumps(facts))
    assert facts["count"] == 1000 and facts["sh_degree"] == 1
    assert facts["bytes"] == (tmp_path / "a.ply").stat().st_size
    assert facts["opacity"]["share_below_0.1"] == pytest.approx((opacities < 0.1).mean(), abs=1e-3)
    assert facts["bounds"]["full_upper"] == [500, 500, 500]
    assert max(facts["bounds"]["robust_upper"]) < 5
    text = " ".join(facts["problems"])
    assert len(facts["problems"]) == 3
    assert "1 of 1000 Gaussians repeat" in text
    assert "1 of 1000 Gaussians float" in text
    assert "1 of 1000 Gaussians have a standard deviation" in text


def test_inspection_of_a_real_capture(shared_data):
    facts = inspect_splat(shared_data / "splats" / "plant.splat")
    assert facts["count"] == 113_648
    assert facts["up"]["vector"] == [0, -1, 0] and facts["up"]["sure"]
    assert 0.2 < facts["opacity"]["share_below_0.1"] < 0.3
    assert facts["problems"] == []
