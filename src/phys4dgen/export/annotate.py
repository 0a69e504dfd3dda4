"""What is written and drawn on rendered pictures: legends, a scale bar, arrows.

Arrows are drawn at three times their size and scaled down, because Pillow draws hard edges.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

__all__ = ["Arrow", "Color", "draw_arrows", "strain_colors", "with_legend", "with_scale_bar"]

Color = tuple[int, int, int]

_OVERSAMPLING = 3
_ROW_PX = 26
_PAD_PX = 10
_STRAIN_STOPS = np.array(
    [[222, 224, 226], [250, 214, 140], [243, 146, 66], [211, 55, 56], [122, 16, 84], [52, 6, 66]], np.float64
)
"""Pale grey where nothing happens, then orange, red and violet; lightness falls evenly, so grey copies read too."""


@dataclass(frozen=True)
class Arrow:
    """An arrow in a picture.

    Attributes:
        tail, tip: pixels (x, y).
        color: of its body; the rim is white.
        towards_viewer: how far it points out of the picture, -1 to 1, which shows where it is seen end on.
    """

    tail: tuple[float, float]
    tip: tuple[float, float]
    color: Color
    towards_viewer: float = 0.0


def strain_colors(share: NDArray[np.floating]) -> NDArray[np.float32]:
    """Colours in [0, 1] of shares of the full scale, [N] -> [N, 3]; what lies above is drawn as 1."""
    places = np.linspace(0, 1, len(_STRAIN_STOPS))
    clipped = np.clip(share, 0, 1)
    channels = [np.interp(clipped, places, _STRAIN_STOPS[:, channel] / 255) for channel in range(3)]
    return np.stack(channels, axis=1).astype(np.float32)


def with_legend(image: NDArray[np.uint8], entries: Sequence[tuple[Color | None, str]]) -> NDArray[np.uint8]:
    """The picture with a strip below it: coloured squares with words, in as many rows as they need.

    Args:
        image: [H, W, 3], uint8; its corner gives the colour of the strip.
        entries: colour of the square (None: words alone) and text.
    """
    font = ImageFont.load_default(14)
    width = image.shape[1]
    rows: list[list[tuple[float, Color | None, str]]] = [[]]
    left = float(_PAD_PX)
    for color, text in entries:
        needed = (22 if color else 0) + font.getlength(text) + 18
        if rows[-1] and left + needed > width:
            rows.append([])
            left = float(_PAD_PX)
        rows[-1].append((left, color, text))
        left += needed
    strip, draw, ink = _strip(image, _ROW_PX * len(rows) + _PAD_PX)
    for number, row in enumerate(rows):
        middle = _PAD_PX / 2 + _ROW_PX * (number + 0.5)
        for left, color, text in row:
            start = left
            if color is not None:
                draw.rounded_rectangle((left, middle - 7, left + 14, middle + 7), 3, fill=color, outline=ink)
                start += 22
            draw.text((start, middle), text, ink, font, anchor="lm")
    return np.vstack([image, np.asarray(strip)])


def with_scale_bar(image: NDArray[np.uint8], title: str, labels: Sequence[str]) -> NDArray[np.uint8]:
    """The picture with a strip below it: the strain colours from 0 to the full scale.

    Args:
        image: [H, W, 3], uint8.
        title: what the bar measures.
        labels: along the bar, evenly spaced from its left to its right end.
    """
    strip, draw, ink = _strip(image, 62)
    font = ImageFont.load_default(14)
    width = image.shape[1]
    bar = min(360, width - 6 * _PAD_PX)
    left = (width - bar) // 2
    ramp = np.rint(255 * strain_colors(np.linspace(0, 1, bar))).astype(np.uint8)
    strip.paste(Image.fromarray(np.repeat(ramp[None], 12, axis=0)), (left, 24))
    draw.rectangle((left - 1, 23, left + bar, 36), outline=ink)
    draw.text((width / 2, 11), title, ink, font, anchor="mm")
    for number, label in enumerate(labels):
        x = left + bar * number / (len(labels) - 1)
        draw.line((x, 36, x, 40), ink)
        draw.text((x, 42), label, ink, font, anchor="ma")
    return np.vstack([image, np.asarray(strip)])


def draw_arrows(image: NDArray[np.uint8], arrows: Sequence[Arrow]) -> NDArray[np.uint8]:
    """The picture with arrows on it; one seen end on becomes a dot (towards the viewer) or a cross in a ring."""
    if not arrows:
        return image
    height, width = image.shape[:2]
    thickness = max(4.0, width / 130)
    layer = Image.new("RGBA", (width * _OVERSAMPLING, height * _OVERSAMPLING))
    draw = ImageDraw.Draw(layer)
    for arrow in arrows:
        for color, rim in (((255, 255, 255), 0.45 * thickness), (arrow.color, 0.0)):
            _draw_arrow(draw, arrow, color, thickness, rim)
    layer = layer.resize((width, height), Image.Resampling.LANCZOS)
    return np.asarray(Image.alpha_composite(Image.fromarray(image).convert("RGBA"), layer).convert("RGB"))


def _draw_arrow(draw: ImageDraw.ImageDraw, arrow: Arrow, color: Color, thickness: float, rim: float) -> None:
    """One arrow, grown by ``rim`` on all sides."""
    k = _OVERSAMPLING
    tail, tip = np.array(arrow.tail), np.array(arrow.tip)
    length = float(np.linalg.norm(tip - tail))
    head = 3.2 * thickness
    if length < head:
        radius = 1.6 * thickness + rim
        x, y = tip * k
        draw.ellipse((x - radius * k, y - radius * k, x + radius * k, y + radius * k), fill=color)
        if not rim:
            inner = 0.55 * thickness * k
            if arrow.towards_viewer > 0:
                draw.ellipse((x - inner, y - inner, x + inner, y + inner), fill="white")
            else:
                for sign in (-1, 1):
                    draw.line((x - 1.6 * inner, y - sign * 1.6 * inner, x + 1.6 * inner, y + sign * 1.6 * inner),
                              fill="white", width=round(0.5 * inner))  # fmt: skip
        return
    along = (tip - tail) / length
    across = np.array([-along[1], along[0]])
    half, wide = 0.5 * thickness + rim, 1.5 * thickness + 1.3 * rim
    neck, point, start = tip - along * (head + rim), tip + along * 1.6 * rim, tail - along * rim
    outline = [start + across * half, neck + across * half, neck + across * wide, point,
               neck - across * wide, neck - across * half, start - across * half]  # fmt: skip
    draw.polygon([(float(x * k), float(y * k)) for x, y in outline], fill=color)


def _strip(image: NDArray[np.uint8], height: int) -> tuple[Image.Image, ImageDraw.ImageDraw, Color]:
    """A strip as wide as the picture, of the colour of its corner, and an ink that is legible on it."""
    red, green, blue = (int(value) for value in image[0, 0])
    ink = (30, 30, 30) if math.hypot(red, green, blue) > 260 else (235, 235, 235)
    strip = Image.new("RGB", (image.shape[1], height), (red, green, blue))
    return strip, ImageDraw.Draw(strip), ink
