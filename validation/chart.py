"""Small line charts as SVG text."""

from __future__ import annotations

import math
from dataclasses import dataclass
from html import escape
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Chart", "Curve"]

_WIDTH, _HEIGHT = 480, 280
_LEFT, _RIGHT, _TOP, _BOTTOM = 62, 14, 30, 46
_MOST_POINTS = 150
_COLOURS = ("#1f6fb2", "#c8501e", "#3d8b40", "#8a4fa3", "#a07400")


@dataclass(frozen=True, eq=False)
class Curve:
    """One curve.

    Attributes:
        name: for the key; curves without one do not appear there.
        x, y: its points, [N].
        style: "theory" is a thin dark line, "line" and "dots" are measured.
    """

    name: str
    x: ArrayLike
    y: ArrayLike
    style: Literal["theory", "line", "dots"] = "line"


@dataclass(frozen=True, eq=False)
class Chart:
    """Curves over common axes.

    Attributes:
        title: what is shown.
        x_label, y_label: with units.
        curves: at least one.
    """

    title: str
    x_label: str
    y_label: str
    curves: tuple[Curve, ...]

    def svg(self) -> str:
        """The chart as a document."""
        points = [_thinned(curve) for curve in self.curves]
        x_ticks = _ticks(np.concatenate([p[:, 0] for p in points]))
        y_ticks = _ticks(np.concatenate([p[:, 1] for p in points]))
        right, bottom = _WIDTH - _RIGHT, _HEIGHT - _BOTTOM

        def at(values: NDArray[np.float64]) -> NDArray[np.float64]:
            x = _LEFT + (values[:, 0] - x_ticks[0]) / (x_ticks[-1] - x_ticks[0]) * (right - _LEFT)
            y = bottom - (values[:, 1] - y_ticks[0]) / (y_ticks[-1] - y_ticks[0]) * (bottom - _TOP)
            return np.stack([x, y], 1)

        lines = [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" width="{_WIDTH}" '
            f'height="{_HEIGHT}" font-family="Helvetica, Arial, sans-serif" font-size="11" fill="#333">',
            f'<rect width="{_WIDTH}" height="{_HEIGHT}" rx="4" fill="#fff"/>',
            f'<text x="{_LEFT}" y="18" font-size="12" font-weight="bold">{escape(self.title)}</text>',
        ]
        for tick in x_ticks:
            x = at(np.array([[tick, y_ticks[0]]]))[0, 0]
            lines.append(f'<path d="M{x:.1f} {_TOP}V{bottom}" stroke="#e4e4e4"/>')
            lines.append(f'<text x="{x:.1f}" y="{bottom + 15}" text-anchor="middle">{_label(tick, x_ticks)}</text>')
        for tick in y_ticks:
            y = at(np.array([[x_ticks[0], tick]]))[0, 1]
            lines.append(f'<path d="M{_LEFT} {y:.1f}H{right}" stroke="#e4e4e4"/>')
            lines.append(f'<text x="{_LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{_label(tick, y_ticks)}</text>')
        middle = (_TOP + bottom) / 2
        lines.append(
            f'<text x="{(_LEFT + right) / 2}" y="{_HEIGHT - 12}" text-anchor="middle">{escape(self.x_label)}</text>'
        )
        lines.append(
            f'<text transform="translate(13 {middle}) rotate(-90)" text-anchor="middle">{escape(self.y_label)}</text>'
        )
        colours = iter(_COLOURS * len(self.curves))
        drawn = [
            (curve, at(values), "#222" if curve.style == "theory" else next(colours))
            for curve, values in zip(self.curves, points, strict=True)
        ]
        # theory on top, so that it is seen where the engine agrees with it
        lines += [_drawn(*one) for one in sorted(drawn, key=lambda one: one[0].style == "theory")]
        lines += _key([(curve, colour) for curve, _, colour in drawn if curve.name], right)
        return "\n".join([*lines, "</svg>", ""])


def _thinned(curve: Curve) -> NDArray[np.float64]:
    """The curve's finite points [K, 2], not more than a small chart can show."""
    points = np.stack([np.asarray(curve.x, float), np.asarray(curve.y, float)], 1)
    points = points[np.isfinite(points).all(1)]
    if len(points) > _MOST_POINTS:
        points = points[np.linspace(0, len(points) - 1, _MOST_POINTS).round().astype(int)]
    return points


def _drawn(curve: Curve, points: NDArray[np.float64], colour: str) -> str:
    if curve.style == "dots":
        dots = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in points)
        return f'<path d="{dots}" fill="none" stroke="{colour}" stroke-width="4" stroke-linecap="round"/>'
    path = "M" + " ".join(f"{x:.1f} {y:.1f}" for x, y in points)
    width, dash = ("1.2", ' stroke-dasharray="5 3"') if curve.style == "theory" else ("1.8", "")
    return f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="{width}"{dash} stroke-linejoin="round"/>'


def _key(keys: list[tuple[Curve, str]], right: float) -> list[str]:
    lines = []
    for row, (curve, colour) in enumerate(keys):
        y = _TOP + 14 + 15 * row
        mark = f'<path d="M{right - 24} {y - 4}h18" stroke="{colour}" stroke-width="1.8"/>'
        if curve.style == "theory":
            mark = f'<path d="M{right - 24} {y - 4}h18" stroke="{colour}" stroke-width="1.2" stroke-dasharray="5 3"/>'
        elif curve.style == "dots":
            mark = f'<circle cx="{right - 15}" cy="{y - 4}" r="2.2" fill="{colour}"/>'
        text = f'<text x="{right - 30}" y="{y}" text-anchor="end" fill="{colour}" stroke="#fff" stroke-width="3" '
        lines.append(f'{text}paint-order="stroke">{escape(curve.name)}</text>{mark}')
    return lines


def _ticks(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Round numbers from below the smallest to above the largest value, about six."""
    low, high = float(values.min()), float(values.max())
    if high - low <= 1e-12 * max(abs(low), abs(high), 1e-300):
        low, high = low - max(abs(low), 1.0) / 2, high + max(abs(high), 1.0) / 2
    rough = (high - low) / 5
    unit = 10.0 ** math.floor(math.log10(rough))
    step = next(unit * factor for factor in (1, 2, 2.5, 5, 10) if unit * factor >= rough * 0.999)
    return np.arange(math.floor(low / step + 1e-9), math.ceil(high / step - 1e-9) + 1) * step


def _label(tick: float, ticks: NDArray[np.float64]) -> str:
    step = ticks[1] - ticks[0]
    if abs(tick) < step / 100:
        return "0"
    return f"{tick:.3g}" if abs(tick) < 1e4 and step > 1e-4 else f"{tick:.1e}"
