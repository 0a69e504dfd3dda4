"""Still pictures of the result, made from renders: ``preview.png``, ``contact_sheet.png`` and ``parts.png``."""

from __future__ import annotations

import colorsys
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from phys4dgen.errors import RunError
from phys4dgen.formats import atomic_path

__all__ = ["contact_sheet", "evenly_spaced", "part_colors", "parts_picture", "write_png"]

OKABE_ITO = ("E69F00", "56B4E9", "009E73", "F0E442", "0072B2", "D55E00", "CC79A7")
"""Colours that stay distinct under all common colour-vision deficiencies (Okabe and Ito 2008), without black."""

GAP_PX = 8
INK = (30, 30, 30)
PAPER = (255, 255, 255)


def write_png(image: NDArray[np.uint8], path: Path | str) -> Path:
    """Write a picture [H, W, 3] (uint8, sRGB) atomically.

    Raises:
        RunError: the file cannot be written.
    """
    try:
        with atomic_path(path) as temporary:
            Image.fromarray(np.ascontiguousarray(image)).save(temporary)
    except OSError as error:
        raise RunError(f"{path}: the picture cannot be written ({error}); check disk space and rights.") from error
    return Path(path)


def evenly_spaced(frame_count: int, count: int = 12) -> list[int]:
    """Indices of at most ``count`` frames from the first to the last, as even as they can be, without repeats."""
    chosen = min(frame_count, count)
    return [round(i * (frame_count - 1) / max(chosen - 1, 1)) for i in range(chosen)]


def contact_sheet(
    images: Sequence[NDArray[np.uint8]], times_s: Sequence[float], *, columns: int = 4, tile_width_px: int = 400
) -> NDArray[np.uint8]:
    """A grid of frames in reading order, each with its time below.

    Args:
        images: chosen frames, each [H, W, 3], uint8, all of one size (see ``evenly_spaced``).
        times_s: time of each frame.
        columns: tiles per row.
        tile_width_px: frames wider than this are scaled down to it.

    Returns:
        The sheet, [H', W', 3], uint8.
    """
    if not images or len(images) != len(times_s):
        raise ValueError(f"images, times_s: expected as many times as images, got {len(images)} and {len(times_s)}.")
    height, width = images[0].shape[:2]
    tile_w = min(width, tile_width_px)
    tile_h = max(1, round(height * tile_w / width))
    columns = min(columns, len(images))
    rows = math.ceil(len(images) / columns)
    font = ImageFont.load_default(14)
    caption_h = 24
    sheet = Image.new(
        "RGB", (GAP_PX + columns * (tile_w + GAP_PX), GAP_PX + rows * (tile_h + caption_h + GAP_PX)), PAPER
    )
    draw = ImageDraw.Draw(sheet)
    for index, (image, time_s) in enumerate(zip(images, times_s, strict=True)):
        left = GAP_PX + index % columns * (tile_w + GAP_PX)
        top = GAP_PX + index // columns * (tile_h + caption_h + GAP_PX)
        sheet.paste(Image.fromarray(image).resize((tile_w, tile_h), Image.Resampling.LANCZOS), (left, top))
        draw.text((left + tile_w / 2, top + tile_h + 4), f"{time_s:.2f} s", INK, font, anchor="ma")
    return np.asarray(sheet)


def part_colors(count: int) -> NDArray[np.uint8]:
    """One colour per part, [count, 3]: the Okabe-Ito colours, then the same ones darker and paler."""
    colors = []
    for index in range(count):
        round_index, position = divmod(index, len(OKABE_ITO))
        red, green, blue = (value / 255 for value in bytes.fromhex(OKABE_ITO[position]))
        hue, lightness, saturation = colorsys.rgb_to_hls(red, green, blue)
        lightness *= (1.0, 0.55, 1.35, 0.75)[round_index % 4]
        colors.append([round(255 * value) for value in colorsys.hls_to_rgb(hue, min(lightness, 0.9), saturation)])
    return np.array(colors, np.uint8).reshape(count, 3)


def parts_picture(
    renders: Sequence[NDArray[np.uint8]],
    part_maps: Sequence[NDArray[np.int32]],
    *,
    names: Sequence[str],
    shares: Sequence[float],
) -> NDArray[np.uint8]:
    """The parts, coloured over the shading of the renders and numbered, with a legend below.

    Args:
        renders: views side by side (two azimuths say most), each [H, W, 3], uint8, all of one size.
        part_maps: part number per pixel of each view, -1 for background, [H, W], int32.
        names: name per part.
        shares: part's share of all Gaussians, 0 to 1.

    Returns:
        The picture, [H', W', 3], uint8.
    """
    if len(renders) != len(part_maps) or not renders or len(names) != len(shares):
        raise ValueError(
            f"expected one part map per render and one share per name, got {len(renders)}, {len(part_maps)}, "
            f"{len(shares)}, {len(names)}."
        )
    colors = part_colors(len(names))
    tiles = [numbered(coloured(*pair, colors), pair[1]) for pair in zip(renders, part_maps, strict=True)]
    legend_columns = max(1, (tiles[0].width * len(tiles)) // 320)
    legend_rows = math.ceil(len(names) / legend_columns)
    width = GAP_PX + sum(tile.width + GAP_PX for tile in tiles)
    height = 2 * GAP_PX + tiles[0].height + 28 * legend_rows + GAP_PX
    picture = Image.new("RGB", (width, height), PAPER)
    for index, tile in enumerate(tiles):
        picture.paste(tile, (GAP_PX + index * (tile.width + GAP_PX), GAP_PX))
    draw = ImageDraw.Draw(picture)
    font = ImageFont.load_default(15)
    for index, (name, share, color) in enumerate(zip(names, shares, colors.tolist(), strict=True)):
        left = GAP_PX + index % legend_columns * ((width - GAP_PX) // legend_columns)
        top = 2 * GAP_PX + tiles[0].height + index // legend_columns * 28
        draw.rectangle((left, top + 3, left + 20, top + 21), fill=tuple(color), outline=INK)
        short = name if len(name) <= 24 else name[:23] + "…"
        draw.text((left + 28, top + 12), f"{index}: {short}, {100 * share:.1f} % of Gaussians", INK, font, anchor="lm")
    return np.asarray(picture)


def coloured(render: NDArray[np.uint8], part_map: NDArray[np.int32], colors: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Part colours times the render's brightness, spread over what the object shows; the background stays."""
    inside = part_map >= 0
    if not inside.any():
        return render
    luma = render @ np.array([0.2126, 0.7152, 0.0722])
    low, high = np.percentile(luma[inside], [2, 98])
    shade = 0.35 + 0.65 * np.clip((luma[inside] - low) / max(high - low, 1.0), 0, 1)
    picture = render.copy()
    picture[inside] = np.rint(colors[part_map[inside]] * shade[:, None])
    return picture


def numbered(picture: NDArray[np.uint8], part_map: NDArray[np.int32]) -> Image.Image:
    """Write each part's number on the pixel of the part that lies nearest to its middle."""
    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image)
    font = ImageFont.load_default(max(12, picture.shape[0] // 30))
    for part in np.unique(part_map[part_map >= 0]):
        rows, cols = np.nonzero(part_map == part)
        if len(rows) < 64:  # smaller than the number itself
            continue
        nearest = np.argmin((rows - np.median(rows)) ** 2 + (cols - np.median(cols)) ** 2)
        at = (float(cols[nearest]), float(rows[nearest]))
        draw.text(at, str(part), PAPER, font, anchor="mm", stroke_width=2, stroke_fill=INK)
    return image
