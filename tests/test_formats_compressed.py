"""PlayCanvas compressed PLY: files packed here bit by bit, from the format's description, and an independent reader."""

import math
import struct

import numpy as np
import pytest

from phys4dgen.errors import FormatError
from phys4dgen.formats import load_gaussians, read_splat_file, save_gaussians
from phys4dgen.formats.compressed_ply_writer import chunk_bounds, morton_order

C0 = 0.28209479177387814


def bits(value, low, high, width):
    """A number as so many bits between its bounds."""
    share = 0.0 if high == low else (value - low) / (high - low)
    return min(max(round(share * (2**width - 1)), 0), 2**width - 1)


def three(values, low, high):
    x, y, z = (bits(v, a, b, w) for v, a, b, w in zip(values, low, high, (11, 10, 11), strict=True))
    return x << 21 | y << 11 | z


def rotation(quat_wxyz):
    largest = max(range(4), key=lambda i: abs(quat_wxyz[i]))
    sign = 1 if quat_wxyz[largest] > 0 else -1
    others = [sign * quat_wxyz[i] for i in range(4) if i != largest]
    a, b, c = (bits(value, -math.sqrt(0.5), math.sqrt(0.5), 10) for value in others)
    return largest << 30 | a << 20 | b << 10 | c


def compressed(gaussians, *, colors=True, degree=0, counts=(None, None, None)):
    """The file of some Gaussians, and what its quantisation makes of them is up to the reader."""
    n = len(gaussians)
    log_scales, rgb = np.log(gaussians.scales), 0.5 + C0 * gaussians.sh[:, 0]
    chunks, vertices = b"", b""
    for start in range(0, n, 256):
        rows = range(start, min(start + 256, n))
        own = [table[start : start + 256] for table in (gaussians.means, log_scales, rgb)]
        limits = [(table.min(0), table.max(0)) for table in own]
        if not colors:
            limits[2] = (np.zeros(3), np.ones(3))
        for low, high in limits[: 3 if colors else 2]:
            chunks += struct.pack("<6f", *low, *high)
        for i in rows:
            red, green, blue = (bits(v, a, b, 8) for v, a, b in zip(rgb[i], *limits[2], strict=True))
            vertices += struct.pack(
                "<4I",
                three(gaussians.means[i], *limits[0]),
                rotation(gaussians.quats_wxyz[i]),
                three(log_scales[i], *limits[1]),
                red << 24 | green << 16 | blue << 8 | bits(gaussians.opacities[i], 0, 1, 8),
            )
    rest = 3 * ((degree + 1) ** 2 - 1)
    levels = b""
    for i in range(n if rest else 0):
        for channel in range(3):
            levels += bytes(bits(v, -4, 4, 8) for v in gaussians.sh[i, 1:, channel])
    names = [f"{end}_{axis}" for end in ("min", "max") for axis in "xyz"]
    names += [f"{end}_scale_{axis}" for end in ("min", "max") for axis in "xyz"]
    names += [f"{end}_{channel}" for end in ("min", "max") for channel in "rgb"] if colors else []
    claimed = [a if a is not None else b for a, b in zip(counts, (math.ceil(n / 256), n, n), strict=True)]
    lines = ["ply", "format binary_little_endian 1.0", f"element chunk {claimed[0]}"]
    lines += [f"property float {name}" for name in names] + [f"element vertex {claimed[1]}"]
    lines += [f"property uint packed_{name}" for name in ("position", "rotation", "scale", "color")]
    if rest:
        lines += [f"element sh {claimed[2]}", *(f"property uchar f_rest_{i}" for i in range(rest))]
    return "\n".join([*lines, "end_header", ""]).encode() + chunks + vertices + levels


@pytest.mark.parametrize(("degree", "colors", "n"), [(0, True, 700), (1, True, 256), (3, False, 257)])
def test_what_was_packed_comes_back(tmp_path, random_gaussians, degree, colors, n):
    gaussians = random_gaussians(n, sh_degree=degree)
    (tmp_path / "a.compressed.ply").write_bytes(compressed(gaussians, degree=degree, colors=colors))
    splat = read_splat_file(tmp_path / "a.compressed.ply")
    found = splat.gaussians
    assert "PlayCanvas" in splat.layout
    for start in range(0, n, 256):
        rows = slice(start, start + 256)
        step = np.ptp(gaussians.means[rows], axis=0) / [2047, 1023, 2047]
        assert (np.abs(found.means[rows] - gaussians.means[rows]) <= 0.51 * step + 1e-6).all()
        step = np.ptp(np.log(gaussians.scales[rows]), axis=0) / [2047, 1023, 2047]
        assert (np.abs(np.log(found.scales[rows] / gaussians.scales[rows])) <= 0.51 * step + 1e-5).all()
    np.testing.assert_allclose(found.opacities, gaussians.opacities, atol=0.51 / 255)
    turned = np.abs((found.quats_wxyz * gaussians.quats_wxyz).sum(1))
    assert turned.min() > 1 - 1e-5
    assert found.sh.shape == gaussians.sh.shape
    shown = np.clip(gaussians.sh[:, 0] * C0 + 0.5, *((-9, 9) if colors else (0, 1)))
    np.testing.assert_allclose(found.sh[:, 0] * C0 + 0.5, shown, atol=0.51 * np.ptp(shown) / 255 + 1e-3)
    np.testing.assert_allclose(found.sh[:, 1:], gaussians.sh[:, 1:], atol=0.51 * 8 / 255)


def test_a_real_file_reads_as_an_independent_reader_reads_it(shared_data):
    gsply = pytest.importorskip("gsply")
    path = shared_data / "splats" / "guitar.compressed.ply"
    found, other = load_gaussians(path), gsply.plyread(str(path))
    np.testing.assert_allclose(found.means, other.means, atol=1e-5)
    np.testing.assert_allclose(np.log(found.scales), other.scales, atol=1e-4)
    assert np.abs((found.quats_wxyz * other.quats).sum(1)).min() > 1 - 1e-5
    np.testing.assert_allclose(found.sh[:, 0], other.sh0, atol=1e-4)


def assert_near(found, gaussians):
    """Rows of both lie in the same order; each value within half a step of its chunk."""
    for start in range(0, len(gaussians), 256):
        rows = slice(start, start + 256)
        step = np.ptp(gaussians.means[rows], axis=0) / [2047, 1023, 2047]
        assert (np.abs(found.means[rows] - gaussians.means[rows]) <= 0.51 * step + 1e-6).all()
        step = np.ptp(np.log(gaussians.scales[rows]), axis=0) / [2047, 1023, 2047]
        assert (np.abs(np.log(found.scales[rows] / gaussians.scales[rows])) <= 0.51 * step + 1e-5).all()
        step = np.ptp(gaussians.sh[rows, 0], axis=0) / 255
        assert (np.abs(found.sh[rows, 0] - gaussians.sh[rows, 0]) <= 0.51 * step + 1e-5).all()
    assert np.abs((found.quats_wxyz * gaussians.quats_wxyz).sum(1)).min() > 1 - 1e-5
    np.testing.assert_allclose(found.opacities, gaussians.opacities, atol=0.51 / 255)
    np.testing.assert_allclose(found.sh[:, 1:], np.clip(gaussians.sh[:, 1:], -4, 4), atol=0.51 * 8 / 255)


@pytest.mark.parametrize(("degree", "n"), [(0, 700), (1, 256), (3, 257), (0, 1)])
def test_what_is_written_reads_back_here_and_elsewhere(tmp_path, random_gaussians, degree, n):
    gsply = pytest.importorskip("gsply", reason="the independent reader gsply is not installed")
    gaussians = random_gaussians(n, sh_degree=degree)
    path = tmp_path / "a.compressed.ply"
    save_gaussians(gaussians, path)
    assert path.stat().st_size < 18 * n + 45 * n * (degree > 0) + 3000
    order = morton_order(gaussians.means)
    assert sorted(order) == list(range(n))
    gaussians = gaussians.subset(order)
    found, other = load_gaussians(path), gsply.plyread(str(path))
    assert_near(found, gaussians)
    np.testing.assert_allclose(found.means, other.means, atol=1e-5)
    np.testing.assert_allclose(np.log(found.scales), other.scales, atol=1e-4)
    assert np.abs((found.quats_wxyz * other.quats).sum(1)).min() > 1 - 1e-5
    np.testing.assert_allclose(found.sh[:, 0], other.sh0, atol=1e-4)
    np.testing.assert_allclose(1 / found.opacities - 1, np.exp(-other.opacities), rtol=1e-3)
    if degree:
        np.testing.assert_allclose(found.sh[:, 1:], other.shN.reshape(n, -1, 3), atol=0.51 * 8 / 255)


def test_neighbours_share_a_chunk(random_gaussians):
    """In Morton order the boxes of 256 rows are far smaller than in a random order."""
    means = random_gaussians(20_000).means
    sorted_boxes, boxes = (chunk_bounds(m) for m in (means[morton_order(means)], means))
    sizes = [np.prod(b[:, 3:] - b[:, :3], axis=1).mean() for b in (sorted_boxes, boxes)]
    assert sizes[0] < 0.2 * sizes[1]


def damaged(gaussians):
    good = compressed(gaussians, degree=1)
    chunk, _, _ = good.partition(b"element vertex")
    nan = good.replace(b"end_header\n", b"end_header\n" + struct.pack("<f", math.nan), 1)
    return {
        "cut off": (good[:-1], "cut off"),
        "too many chunks": (
            compressed(gaussians, counts=(9, None, None)),
            "expected 2 chunks for 300 Gaussians, got 9",
        ),
        "huge": (compressed(gaussians, counts=(3906250000, 10**12, None)), "promises"),
        "no Gaussians": (compressed(gaussians, counts=(0, 0, None)), "0 Gaussians"),
        "too few sh": (compressed(gaussians, degree=1, counts=(None, None, 7)), "as many rows in 'sh'"),
        "a bound is no number": (nan, "not usable numbers"),
        "bound missing": (good.replace(b"max_scale_z", b"max_scale_q"), "min_x ... max_scale_z"),
        "words of another type": (good.replace(b"uint packed_color", b"int packed_color"), "packed_color"),
        "chunks last": (b"ply\nformat binary_little_endian 1.0\n" + good[len(chunk) :], "chunk, vertex"),
        "ascii": (good.replace(b"binary_little_endian", b"ascii"), "binary"),
        "half an SH degree": (good.replace(b"property uchar f_rest_8\n", b""), "9, 24 or 45"),
    }


@pytest.mark.parametrize("case", ["cut off", "too many chunks", "huge", "no Gaussians", "too few sh",
                                  "a bound is no number", "bound missing", "words of another type", "chunks last",
                                  "ascii", "half an SH degree"])  # fmt: skip
def test_hostile_compressed_ply_gets_one_sentence(tmp_path, random_gaussians, case):
    content, says = damaged(random_gaussians(300, sh_degree=1))[case]
    (tmp_path / "a.ply").write_bytes(content)
    with pytest.raises(FormatError, match=says) as caught:
        load_gaussians(tmp_path / "a.ply")
    assert "\n" not in str(caught.value)


def test_random_words_are_never_more_than_a_sentence(tmp_path, random_gaussians):
    content = bytearray(compressed(random_gaussians(300), degree=0))
    rng = np.random.default_rng(0)
    for _ in range(60):
        damaged_file = content.copy()
        at = rng.integers(0, len(content), 8)
        for place in at:
            damaged_file[place] = rng.integers(0, 256)
        (tmp_path / "a.ply").write_bytes(damaged_file)
        try:
            load_gaussians(tmp_path / "a.ply")
        except FormatError as error:
            assert str(error).isprintable()
