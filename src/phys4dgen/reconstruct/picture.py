"""Picture files -> arrays: orientation, colour space, bit depth and size are settled here, once.

Reading is Pillow's; what this file adds is a bound on the size before anything is decoded, and one meaning for every
kind of file: straight (not premultiplied) sRGB in [0, 1], and the alpha channel if there is one.
"""

from __future__ import annotations

import io
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageCms, ImageOps

from phys4dgen.errors import FormatError

__all__ = ["Picture", "read_mask", "read_picture"]

MAX_SIDE_PX = 2048
"""Larger pictures are scaled down to it: far above the finest working grid, far below what fills the memory."""
MAX_FILE_BYTES = 256 * 2**20
_MEGAPIXELS = (Image.MAX_IMAGE_PIXELS or 0) / 1e6
_SIXTEEN_BIT = ("I;16", "I;16L", "I;16B", "I;16N", "I")


@dataclass(frozen=True, eq=False)
class Picture:
    """A decoded picture.

    Attributes:
        rgb: sRGB in [0, 1], shape [H, W, 3], float32.
        alpha: opacity in [0, 1], shape [H, W], float32; None where the file has no alpha channel.
    """

    rgb: NDArray[np.float32]
    alpha: NDArray[np.float32] | None

    @property
    def size(self) -> tuple[int, int]:
        """Height and width, pixels."""
        return self.rgb.shape[0], self.rgb.shape[1]


def read_picture(path: Path | str) -> Picture:
    """Read a picture upright (EXIF), in sRGB, at most ``MAX_SIDE_PX`` pixels long.

    Raises:
        FormatError: missing, not a picture, damaged or too large.
    """
    image = _decoded(Path(path))
    if image.mode in _SIXTEEN_BIT:
        grey = np.asarray(image, np.float32)
        grey = np.clip(grey / 65535, 0, 1) if grey.max(initial=0) > 255 else grey / 255
        return Picture(np.repeat(grey[..., None], 3, -1).astype(np.float32), None)
    if image.mode == "F":
        grey = np.asarray(image, np.float32)
        if not np.isfinite(grey).all():
            raise FormatError(f"{path}: expected finite brightness, got NaN or infinity; save it as 8 or 16 bit PNG.")
        grey = np.clip(grey / max(float(grey.max(initial=0)), 1.0), 0, 1)
        return Picture(np.repeat(grey[..., None], 3, -1).astype(np.float32), None)
    has_alpha = "A" in image.getbands() or "transparency" in image.info
    if not has_alpha:
        return Picture(_unit(image.convert("RGB")), None)
    rgba = _unit(image.convert("RGBA"))
    return Picture(np.ascontiguousarray(rgba[..., :3]), np.ascontiguousarray(rgba[..., 3]))


def read_mask(path: Path | str, *, size: tuple[int, int]) -> NDArray[np.float32]:
    """Read a mask of a picture: white (or opaque) is the object, black (or transparent) is not.

    Args:
        path: a picture file; its alpha channel is the mask if it has one that varies, else its brightness.
        size: height and width of the picture as read; the mask must show the same section, at any resolution.

    Returns:
        Opacity in [0, 1], shape ``size``.

    Raises:
        FormatError: as ``read_picture``, or of another shape than the picture.
    """
    mask = read_picture(path)
    uses_alpha = mask.alpha is not None and float(np.ptp(mask.alpha)) > 0.5
    values = mask.alpha if uses_alpha and mask.alpha is not None else mask.rgb.mean(-1)
    height, width = size
    got_height, got_width = mask.size
    if abs(got_width / got_height - width / height) > 0.02 * width / height:
        raise FormatError(
            f"{path}: the mask is {got_width} x {got_height} pixels, the picture {width} x {height}; "
            "expected the same section of the scene, so save the mask at the picture's size."
        )
    if mask.size != size:
        resized = Image.fromarray(values.astype(np.float32)).resize((width, height), Image.Resampling.BOX)
        values = np.asarray(resized, np.float32)
    return np.clip(values, 0, 1).astype(np.float32)


def _decoded(path: Path) -> Image.Image:
    """The picture, upright, in sRGB and scaled down where it is large; refused before decoding where it is huge."""
    if not path.is_file():
        raise FormatError(f"{path}: there is no such picture; check the name.")
    too_large = f"{path}: the picture is too large; this version reads up to {_MEGAPIXELS:.0f} megapixels"
    if path.stat().st_size > MAX_FILE_BYTES:
        raise FormatError(f"{too_large} and {MAX_FILE_BYTES // 2**20} MB; scale it down to {MAX_SIDE_PX} pixels.")
    try:
        with path.open("rb") as stream, warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            image = Image.open(stream)
            image.draft(None, (MAX_SIDE_PX, MAX_SIDE_PX))  # a JPEG can be decoded at a half, a quarter or an eighth
            image.load()
        upright = ImageOps.exif_transpose(image)
    except (Image.DecompressionBombWarning, Image.DecompressionBombError) as error:
        raise FormatError(f"{too_large}; scale it down to {MAX_SIDE_PX} pixels.") from error
    except (OSError, SyntaxError, ValueError, MemoryError, EOFError) as error:
        raise FormatError(
            f"{path}: cannot read it as a picture ({error}); expected PNG, JPEG, WebP or TIFF."
        ) from error
    if min(upright.size) < 16:
        raise FormatError(
            f"{path}: expected a picture of at least 16 x 16 pixels, got {upright.width} x {upright.height}."
        )
    srgb = _in_srgb(upright)
    factor = max(srgb.size) // MAX_SIDE_PX + (max(srgb.size) % MAX_SIDE_PX > 0)
    if factor > 1 and srgb.mode not in (*_SIXTEEN_BIT, "F"):
        if "A" not in srgb.getbands() and "transparency" not in srgb.info:
            return srgb.convert("RGB").reduce(factor)
        return srgb.convert("RGBA").convert("RGBa").reduce(factor).convert("RGBA")
    return srgb.resize([max(1, side // factor) for side in srgb.size], Image.Resampling.NEAREST) if factor > 1 else srgb


def _in_srgb(image: Image.Image) -> Image.Image:
    """The picture converted from the colour profile that it carries; one without, or a broken one, is taken as sRGB."""
    profile = image.info.get("icc_profile")
    if not profile or image.mode not in ("RGB", "RGBA", "CMYK"):
        return image.convert("RGB") if image.mode == "CMYK" else image
    try:
        source = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        target = "RGBA" if image.mode == "RGBA" else "RGB"
        converted = ImageCms.profileToProfile(image, source, ImageCms.createProfile("sRGB"), outputMode=target)
    except (ImageCms.PyCMSError, OSError, ValueError):
        return image.convert("RGB") if image.mode == "CMYK" else image
    return image if converted is None else converted


def _unit(image: Image.Image) -> NDArray[np.float32]:
    return np.asarray(image, np.float32) / np.float32(255)
