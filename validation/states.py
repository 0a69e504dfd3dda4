"""Drawings of simulated matter: particles as discs, several moments side by side, as small PNG files."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

__all__ = ["Moment", "States"]

_HEIGHT = 150
_FINER = 3  # drawn so many times larger, then made smaller: smooth discs
_BACKGROUND = (255, 255, 255)
_LINE = (40, 40, 40)
_LOW, _HIGH = np.array([31, 90, 160.0]), np.array([235, 150, 60.0])


@dataclass(frozen=True, eq=False)
class Moment:
    """Matter at one time.

    Attributes:
        title: what it is.
        points: places in the picture's plane, right and up, in metres, [P, 2].
        shade: 0 to 1 for each, blue to orange, [P].
        lines: polylines of theory drawn over it, [K, 2] each.
    """

    title: str
    points: NDArray[np.float64]
    shade: NDArray[np.float64]
    lines: tuple[NDArray[np.float64], ...] = ()


@dataclass(frozen=True, eq=False)
class States:
    """Several moments at one scale.

    Attributes:
        title: what is shown.
        moments: from left to right.
        window_m: (left, right, bottom, top) of each panel.
        disc_m: diameter of a particle.
    """

    title: str
    moments: tuple[Moment, ...]
    window_m: tuple[float, float, float, float]
    disc_m: float

    def png(self) -> bytes:
        """The drawing with a palette of 64 colours."""
        left, right, bottom, top = self.window_m
        scale = _HEIGHT / (top - bottom) * _FINER
        width, caption = round((right - left) * scale), 18 * _FINER
        gap = 8 * _FINER
        size = (len(self.moments) * (width + gap) - gap, _HEIGHT * _FINER + caption)
        image = Image.new("RGB", size, _BACKGROUND)
        draw = ImageDraw.Draw(image)
        radius = max(self.disc_m * scale / 2, 1.0)
        for column, moment in enumerate(self.moments):
            x0 = column * (width + gap)
            places = (moment.points - [left, bottom]) * scale
            colours = _LOW + np.clip(moment.shade, 0, 1)[:, None] * (_HIGH - _LOW)
            inside = ((places > 0) & (places < [width, _HEIGHT * _FINER])).all(1)
            for (x, y), colour in zip(places[inside], colours[inside].astype(int), strict=True):
                centre = (x0 + x, size[1] - y)
                box = (centre[0] - radius, centre[1] - radius, centre[0] + radius, centre[1] + radius)
                draw.ellipse(box, fill=(int(colour[0]), int(colour[1]), int(colour[2])))
            draw.line([(x0, size[1] - 1), (x0 + width, size[1] - 1)], fill=_LINE, width=2 * _FINER)
            for line in moment.lines:
                points = (line - [left, bottom]) * scale
                draw.line([(x0 + x, size[1] - y) for x, y in points], fill=_LINE, width=_FINER)
            draw.text((x0 + 2 * _FINER, 2 * _FINER), moment.title, fill=_LINE, font_size=11 * _FINER)
        small = image.resize((size[0] // _FINER, size[1] // _FINER), Image.Resampling.BOX)
        buffer = io.BytesIO()
        small.quantize(64, dither=Image.Dither.NONE).save(buffer, "PNG", optimize=True)
        return buffer.getvalue()
