"""The pictures that a model sees: the object, the same with lettered colours, and one crop per part.

Paper: Sec. 3.4 (canonical view and segmented sub-images). Crops stand on neutral grey with a margin, not on black as a
whole masked picture would. Every picture is encoded anew from its pixels, so no metadata of a user's photo is in it.
"""

from __future__ import annotations

import colorsys
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import distance_transform_edt

from phys4dgen.types import Camera, Frame, Gaussians, Parts

__all__ = ["CROP_PX", "MAX_PARTS", "VIEW_PX", "PartView", "SubImages", "front_views", "make_sub_images", "picture_view"]

MAX_PARTS = 26
"""Parts that are asked for in one request; A to Z."""
VIEW_PX = 768
"""Longest side of the whole views."""
CROP_PX = 384
"""Longest side of a crop."""
_ENOUGH_PX = 300
"""A part that shows fewer pixels in the canonical view is cropped from the view that shows most of it."""
_GREY = 128
_MARGIN = 0.08
_DISTANCE = 2.4
"""Of the camera, in half diagonals of the object's box: a field of view of 49.1 deg then holds any box."""
_AZIMUTHS_DEG = (0.0, 90.0, 180.0, 270.0, 45.0, 225.0)


@dataclass(frozen=True, eq=False)
class PartView:
    """A picture and the part that each of its pixels shows.

    Attributes:
        rgb: shape [H, W, 3], uint8.
        part_map: part number, -1 for background, shape [H, W], int32.
    """

    rgb: NDArray[np.uint8]
    part_map: NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class SubImages:
    """What is sent, as PNG files.

    Attributes:
        canonical: the object.
        overlay: the same with each part in a colour and its letter.
        crops: one per part by letter, in the order of the letters.
        letters: letter of each part number that is asked for.
        unseen: numbers of parts that no view shows, or that are too many to ask for.
    """

    canonical: bytes
    overlay: bytes
    crops: dict[str, bytes]
    letters: dict[int, str]
    unseen: tuple[int, ...]

    @property
    def byte_count(self) -> int:
        """Bytes of all pictures."""
        return len(self.canonical) + len(self.overlay) + sum(map(len, self.crops.values()))


def front_views(
    gaussians: Gaussians, parts: Parts, frame: Frame, *, size_px: int = VIEW_PX
) -> tuple[PartView, Callable[[], Sequence[PartView]]]:
    """The front view of a splat, and what renders further ones for the parts that it hides.

    Args:
        gaussians: N static Gaussians.
        parts: their parts.
        frame: which way is up; the front looks along +y of its axes.
        size_px: width and height.
    """
    from phys4dgen.render.cameras import orbit_camera
    from phys4dgen.render.views import render_gaussians, render_labels

    lower, upper = gaussians.robust_bounds(rotation=frame.rotation)
    middle = (lower + upper) / 2 @ frame.rotation
    radius = float(np.linalg.norm(upper - lower)) / 2 * _DISTANCE

    def view(azimuth_deg: float, elevation_deg: float) -> PartView:
        camera = orbit_camera(
            azimuth_deg=azimuth_deg, elevation_deg=elevation_deg, target=middle, rotation=frame.rotation,
            radius=radius, fovy_deg=49.1, width=size_px, height=size_px,
        )  # fmt: skip
        rgb = render_gaussians(gaussians, camera).rgb
        return PartView(
            np.rint(np.clip(rgb, 0, 1) * 255).astype(np.uint8), render_labels(gaussians, parts.labels, camera)
        )

    def others() -> list[PartView]:
        turned = [view(azimuth_deg, 15.0) for azimuth_deg in _AZIMUTHS_DEG[1:]]
        return [*turned, view(0.0, 60.0), view(180.0, 60.0), view(0.0, -30.0)]

    return view(_AZIMUTHS_DEG[0], 15.0), others


def picture_view(gaussians: Gaussians, parts: Parts, picture: NDArray[np.float32], camera: Camera) -> PartView:
    """The user's picture as the canonical view, with the parts that its camera sees.

    Args:
        gaussians: made from the picture.
        parts: their parts.
        picture: straight sRGB and opacity, shape [H, W, 4], 0 to 1.
        camera: that sees the Gaussians as the picture; of the same size.
    """
    from phys4dgen.render.views import render_labels

    opacity = np.clip(picture[..., 3:], 0, 1)
    on_white = np.clip(picture[..., :3], 0, 1) * opacity + (1 - opacity)
    part_map = np.where(opacity[..., 0] > 0.5, render_labels(gaussians, parts.labels, camera), -1)
    return PartView(np.rint(on_white * 255).astype(np.uint8), part_map.astype(np.int32))


def make_sub_images(canonical: PartView, others: Callable[[], Sequence[PartView]], part_count: int) -> SubImages:
    """Cut the pictures for a model out of the views.

    Args:
        canonical: the user's picture or the front view.
        others: renders further views; called only if the canonical one hides a part.
        part_count: G; the parts are numbered 0 .. G-1.
    """
    canonical = _bounded(canonical)
    wanted = range(part_count)
    best = {number: (canonical, _pixels(canonical, number)) for number in wanted}
    if any(pixels < _ENOUGH_PX for _, pixels in best.values()):
        for view in map(_bounded, others()):
            for number, (_, pixels) in best.items():
                if pixels < _ENOUGH_PX and _pixels(view, number) > pixels:
                    best[number] = (view, _pixels(view, number))
    largest_first = sorted(wanted, key=lambda number: -best[number][1])
    seen = sorted(number for number in largest_first[:MAX_PARTS] if best[number][1] > 0)
    letters = {number: chr(ord("A") + place) for place, number in enumerate(seen)}
    return SubImages(
        canonical=_png(Image.fromarray(canonical.rgb)),
        overlay=_png(_overlay(canonical, letters)),
        crops={letters[number]: _png(_crop(best[number][0], number)) for number in seen},
        letters=letters,
        unseen=tuple(number for number in wanted if number not in letters),
    )


def _bounded(view: PartView) -> PartView:
    """The view at most VIEW_PX wide and high."""
    height, width = view.part_map.shape
    if view.rgb.shape != (height, width, 3):
        raise ValueError(f"part_map: expected one label per pixel of rgb {view.rgb.shape}, got {view.part_map.shape}.")
    scale = VIEW_PX / max(height, width)
    if scale >= 1:
        return view
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    rgb = Image.fromarray(view.rgb).resize(size, Image.Resampling.LANCZOS)
    part_map = Image.fromarray(view.part_map).resize(size, Image.Resampling.NEAREST)
    return PartView(np.asarray(rgb), np.asarray(part_map, np.int32))


def _pixels(view: PartView, number: int) -> int:
    return int((view.part_map == number).sum())


def _crop(view: PartView, number: int) -> Image.Image:
    """The part alone on grey, with a margin, at most CROP_PX wide and high; small parts are enlarged twice."""
    mine = view.part_map == number
    rows, cols = np.flatnonzero(mine.any(1)), np.flatnonzero(mine.any(0))
    margin = round(_MARGIN * max(np.ptp(rows), np.ptp(cols))) + 4
    height, width = mine.shape
    top, bottom = max(rows[0] - margin, 0), min(rows[-1] + margin + 1, height)
    left, right = max(cols[0] - margin, 0), min(cols[-1] + margin + 1, width)
    alone = np.where(mine[..., None], view.rgb, np.uint8(_GREY))[top:bottom, left:right]
    image = Image.fromarray(alone)
    scale = min(CROP_PX / max(image.size), 2.0)
    return image.resize(
        (max(1, round(image.width * scale)), max(1, round(image.height * scale))), Image.Resampling.LANCZOS
    )


def _overlay(view: PartView, letters: dict[int, str]) -> Image.Image:
    """The view in grey under one colour per part, with its letter where the part is widest."""
    luma = view.rgb @ np.array([0.2126, 0.7152, 0.0722])
    picture = np.repeat(luma[..., None], 3, axis=2)
    for place, number in enumerate(letters):
        mine = view.part_map == number
        color = 255 * np.array(colorsys.hls_to_rgb(place * 0.381966 % 1, 0.55, 0.9))
        picture[mine] = 0.45 * picture[mine] + 0.55 * color
    image = Image.fromarray(np.rint(np.clip(picture, 0, 255)).astype(np.uint8))
    draw = ImageDraw.Draw(image)
    font = ImageFont.load_default(max(16, image.height // 24))
    for number, letter in letters.items():
        mine = view.part_map == number
        if mine.any():
            depth = np.asarray(distance_transform_edt(np.pad(mine, 1)))[1:-1, 1:-1]
            row, col = np.unravel_index(np.argmax(depth), depth.shape)
            at = (float(col), float(row))
            draw.text(at, letter, (255, 255, 255), font, anchor="mm", stroke_width=3, stroke_fill=(20, 20, 20))
    return image


def _png(image: Image.Image) -> bytes:
    """The pixels as a PNG file, and nothing else."""
    bare = Image.frombytes("RGB", image.size, image.convert("RGB").tobytes())
    buffer = io.BytesIO()
    bare.save(buffer, "PNG", optimize=True)
    return buffer.getvalue()
