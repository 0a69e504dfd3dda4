"""Pictures of every kind, and the object cut out of them."""

import io
import zlib

import numpy as np
import pytest
from PIL import Image, ImageCms, ImageDraw

from phys4dgen.errors import FormatError, StageError
from phys4dgen.input_kinds import is_picture
from phys4dgen.reconstruct import matte_onnx
from phys4dgen.reconstruct.border_color import cut_by_border_color
from phys4dgen.reconstruct.foreground import cut_out
from phys4dgen.reconstruct.framing import HALF_HEIGHT, canonical_camera, framed
from phys4dgen.reconstruct.picture import MAX_SIDE_PX, read_mask, read_picture


def disc(size=96, *, background=(255, 255, 255), color=(200, 30, 40)):
    """A disc of half the picture's width, and its mask."""
    mask = Image.new("L", (size, size))
    ImageDraw.Draw(mask).ellipse((size // 4, size // 4, 3 * size // 4, 3 * size // 4), fill=255)
    picture = Image.new("RGB", (size, size), background)
    picture.paste(color, mask=mask)
    return picture, mask


def iou(a, b):
    a, b = np.asarray(a) > 0.5, np.asarray(b) > 0.5
    return (a & b).sum() / (a | b).sum()


@pytest.fixture
def saved(tmp_path):
    def save(image, name="a.png", **options):
        image.save(tmp_path / name, **options)
        return tmp_path / name

    return save


def test_every_kind_of_file_shows_the_same_colours(saved):
    picture, mask = disc()
    rgba = picture.copy()
    rgba.putalpha(mask)
    expected = np.asarray(picture, np.float32) / 255
    for image, name in (
        (picture, "a.png"),
        (picture, "a.bmp"),
        (picture, "a.tif"),
        (picture.quantize(8), "palette.png"),
        (picture.convert("CMYK"), "cmyk.tif"),
    ):
        read = read_picture(saved(image, name))
        assert read.alpha is None
        assert np.abs(read.rgb - expected).mean() < 0.01, name
    with_alpha = read_picture(saved(rgba))
    assert with_alpha.alpha is not None
    assert iou(with_alpha.alpha, np.asarray(mask) / 255) == 1


def test_a_palette_with_a_transparent_colour_has_an_alpha_channel(saved):
    picture, mask = disc()
    palette = picture.quantize(4)
    corner = palette.getpixel((0, 0))
    read = read_picture(saved(palette, "p.png", transparency=corner))
    assert read.alpha is not None
    assert iou(read.alpha, np.asarray(mask) / 255) > 0.97


def test_sixteen_bits_keep_their_range(saved):
    ramp = np.linspace(0, 65535, 64 * 64).reshape(64, 64).astype(np.uint16)
    read = read_picture(saved(Image.fromarray(ramp), "deep.png"))
    np.testing.assert_allclose(read.rgb[..., 1], ramp / 65535, atol=1e-4)


def test_a_camera_held_sideways_is_turned(saved):
    picture = Image.new("RGB", (64, 32), (0, 0, 255))
    exif = Image.Exif()
    exif[0x0112] = 6  # the top of the scene is at the right of the file
    assert read_picture(saved(picture, "a.jpg", exif=exif)).size == (64, 32)


def test_a_colour_profile_of_srgb_or_a_broken_one_changes_nothing(saved):
    """sRGB as a profile changes nothing, and a broken profile is taken as sRGB."""
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    picture, _ = disc()
    same = read_picture(saved(picture, "srgb.png", icc_profile=profile))
    np.testing.assert_allclose(same.rgb, np.asarray(picture) / 255, atol=0.01)
    broken = read_picture(saved(picture, "broken.png", icc_profile=b"no profile"))
    np.testing.assert_allclose(broken.rgb, np.asarray(picture) / 255, atol=1e-6)


def test_large_pictures_are_scaled_down_and_huge_ones_refused(saved, tmp_path):
    assert max(read_picture(saved(Image.new("L", (5000, 1000), 90), "large.png")).size) <= MAX_SIDE_PX
    header = io.BytesIO()
    Image.new("L", (16, 16)).save(header, "PNG")
    bomb = bytearray(header.getvalue())
    bomb[16:24] = (60000).to_bytes(4, "big") * 2
    bomb[29:33] = zlib.crc32(bytes(bomb[12:29])).to_bytes(4, "big")
    (tmp_path / "bomb.png").write_bytes(bytes(bomb))
    with pytest.raises(FormatError, match="too large"):
        read_picture(tmp_path / "bomb.png")


@pytest.mark.parametrize("content", [b"", b"\x89PNG\r\n\x1a\n", b"GIF89a" + bytes(40), b"not a picture"])
def test_damaged_pictures_are_refused_in_one_sentence(tmp_path, content):
    (tmp_path / "a.png").write_bytes(content)
    with pytest.raises(FormatError, match=r"a\.png: cannot read"):
        read_picture(tmp_path / "a.png")
    with pytest.raises(FormatError, match="no such picture"):
        read_picture(tmp_path / "b.png")


def test_a_truncated_picture_is_refused(saved):
    path = saved(disc(256)[0])
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(FormatError, match="cannot read"):
        read_picture(path)


def test_what_counts_as_a_picture():
    assert is_picture("A.JPG")
    assert not is_picture("a.splat")


def test_alpha_comes_before_the_border_and_a_mask_before_both(saved):
    picture, mask = disc()
    rgba = picture.copy()
    rgba.putalpha(mask)
    left = Image.new("L", picture.size)
    left.paste(255, (0, 0, 40, 96))
    assert cut_out(saved(rgba, "rgba.png")).source == "alpha channel"
    opaque = picture.copy()
    opaque.putalpha(255)
    assert cut_out(saved(opaque, "opaque.png")).source.startswith("border")
    masked = cut_out(saved(rgba, "rgba.png"), mask=saved(left, "mask.png"))
    assert masked.source == "mask"
    assert iou(masked.rgba[..., 3], np.asarray(left) / 255) > 0.99
    assert any("cut off at the top and bottom and left" in text for text in masked.warnings)


def test_a_mask_may_be_of_another_size_but_not_of_another_shape(saved):
    mask = saved(disc(192)[1], "mask.png")
    assert iou(read_mask(mask, size=(96, 96)), np.asarray(disc()[1]) / 255) > 0.96
    with pytest.raises(FormatError, match="same section"):
        read_mask(mask, size=(96, 128))


def test_shadows_and_crumbs_are_no_matter(saved):
    picture, mask = disc(200)
    alpha = np.array(mask)
    alpha[160:170, 30:170] = 120
    alpha[5:9, 5:9] = 255
    picture.putalpha(Image.fromarray(alpha))
    found = cut_out(saved(picture))
    assert iou(found.rgba[..., 3], np.asarray(mask) / 255) > 0.98


@pytest.mark.parametrize("background", [(255, 255, 255), (10, 10, 12), (120, 160, 90)])
def test_border_colour_finds_an_object_on_a_gradient_with_a_soft_shadow(background):
    size = 240
    _, mask = disc(size)
    rgb = np.asarray(disc(size, background=background, color=(60, 60, 220))[0], np.float32) / 255
    y, x = np.mgrid[:size, :size] / size
    inside = (np.asarray(mask) > 0)[..., None]
    shadow = 1 - 0.3 * np.exp(-(((x - 0.62) / 0.2) ** 2) - ((y - 0.78) / 0.07) ** 2)
    lit = np.clip(rgb * (0.85 + 0.15 * x)[..., None] * shadow[..., None], 0, 1)
    cut = cut_by_border_color(np.where(inside, rgb, lit).astype(np.float32))
    assert not cut.problem
    assert iou(cut.alpha, np.asarray(mask) / 255) > 0.93


def test_a_busy_border_is_refused_with_the_way_out(saved, monkeypatch):
    monkeypatch.setattr("phys4dgen.reconstruct.foreground.find_matte_model", lambda: None)
    noise = np.random.default_rng(0).integers(0, 255, (128, 128, 3)).astype(np.uint8)
    noise = np.asarray(Image.fromarray(noise).resize((128, 128), Image.Resampling.BOX, box=(0, 0, 16, 16)))
    with pytest.raises(StageError, match=r"--mask FILE.*--matte-model.*curl"):
        cut_out(saved(Image.fromarray(noise)))


def test_an_empty_mask_is_refused(saved):
    picture, _ = disc()
    with pytest.raises(StageError, match="--mask"):
        cut_out(saved(picture), mask=saved(Image.new("L", picture.size), "none.png"))
    with pytest.raises(StageError, match="whole picture"):
        cut_out(saved(picture), mask=saved(Image.new("L", picture.size, 255), "all.png"))


def test_models_of_rembg_are_found(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("U2NET_HOME", raising=False)
    monkeypatch.delenv("REMBG_HOME", raising=False)
    assert matte_onnx.find_matte_model() is None
    nested = tmp_path / ".rembg" / "models" / "u2net" / "u2net.onnx"
    nested.parent.mkdir(parents=True)
    nested.touch()
    assert matte_onnx.find_matte_model() == nested
    monkeypatch.setenv("U2NET_HOME", str(tmp_path))
    (tmp_path / "isnet-general-use.onnx").touch()
    assert matte_onnx.find_matte_model() == tmp_path / "isnet-general-use.onnx"


def test_a_missing_or_wrong_model_is_one_sentence(tmp_path):
    rgb = np.zeros((32, 32, 3), np.float32)
    with pytest.raises(StageError, match=r"no such matting model.*curl -L"):
        matte_onnx.matte_alpha(rgb, tmp_path / "none.onnx")
    pytest.importorskip("onnxruntime", reason="onnxruntime (extra 'matte') is not installed")
    (tmp_path / "bad.onnx").write_bytes(b"no network")
    with pytest.raises(StageError, match=r"bad\.onnx: onnxruntime cannot load"):
        matte_onnx.matte_alpha(rgb, tmp_path / "bad.onnx")


@pytest.mark.parametrize("name", ["cactus_pot", "teddy"])
def test_a_real_network_agrees_with_the_photographers_masks(shared_data, name):
    pytest.importorskip("onnxruntime", reason="onnxruntime (extra 'matte') is not installed")
    model = shared_data / "weights" / "isnet_small.onnx"
    if not model.is_file():
        pytest.skip("the matting network ../shared/data/weights/isnet_small.onnx is not here")
    images = shared_data / "images"
    found = cut_out(images / f"{name}_image.png", matte_model=model).rgba[..., 3]
    assert iou(found, read_mask(images / f"{name}_mask.png", size=found.shape)) >= 0.95


@pytest.mark.parametrize("name", ["cactus_pot", "teddy"])
def test_border_colour_agrees_with_the_photographers_masks(shared_data, name):
    images = shared_data / "images"
    picture = read_picture(images / f"{name}_image.png")
    assert iou(cut_by_border_color(picture.rgb).alpha, read_mask(images / f"{name}_mask.png", size=picture.size)) >= 0.9


def test_the_frame_and_its_camera():
    rgba = np.zeros((60, 100, 4), np.float32)
    rgba[10:50, 20:40] = [0.2, 0.4, 0.6, 1]
    picture = framed(rgba, 200)
    rows, columns = np.flatnonzero((picture[..., 3] > 0.5).any(1)), np.flatnonzero((picture[..., 3] > 0.5).any(0))
    assert abs(len(rows) - 160) <= 1
    assert abs(len(columns) - 80) <= 1
    assert abs(rows.mean() - 99.5) <= 0.5
    np.testing.assert_allclose(picture[100, 100], [0.2, 0.4, 0.6, 1], atol=1e-5)
    for horizon in (0.0, -0.5):
        corners = np.array([[-HALF_HEIGHT, HALF_HEIGHT, 0], [HALF_HEIGHT, -HALF_HEIGHT, 0]])
        pixels, _ = canonical_camera(200, horizon=horizon).project(corners)
        np.testing.assert_allclose(pixels, [[0, 0], [200, 200]], atol=1e-9)
