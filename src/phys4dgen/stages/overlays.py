"""What can be laid over the film: parts, material, strain, forces.

An overlay colours the Gaussians of a frame, and writes on the rendered picture what the colours mean. The strain is
the von Mises equivalent of the logarithmic strain ln U, U the right stretch of the total F = R U:
sqrt(2/3 dev(ln U) : dev(ln U)). It is 0 for rigid motion and for a change of volume alone, and the engineering strain
of a thin incompressible rod that is pulled a little.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phys4dgen.export.annotate import Arrow, Color, draw_arrows, strain_colors, with_legend, with_scale_bar
from phys4dgen.export.pictures import part_colors
from phys4dgen.scene import (
    ALL_PARTS,
    AccelerationForce,
    Force,
    Impulse,
    PerParticleForce,
    Scene,
    TotalForce,
    VelocitySet,
    Wind,
    parts_meant,
)
from phys4dgen.stages.asset import Asset
from phys4dgen.stages.motion import Motion
from phys4dgen.types import Camera, Material, MaterialBook, Parts

__all__ = ["OVERLAYS", "Overlay", "OverlayInputs", "equivalent_strain"]

_LUMA = np.array([0.2126, 0.7152, 0.0722], np.float32)
_HELD_COLOR: Color = (0, 114, 178)
_FORCE_COLOR: Color = (213, 94, 0)
_SCALE_FRAMES = 12
_SCALE_PERCENTILE = 99.5
_STILL = 1e-5
_GRAVITY_MS2 = 9.81
_BLOW_SHOWN_S = 0.15


@dataclass(frozen=True, eq=False)
class OverlayInputs:
    """All that overlays show."""

    scene: Scene
    asset: Asset
    parts: Parts
    book: MaterialBook
    motion: Motion


class Overlay(Protocol):
    """Colours the Gaussians of each frame and annotates its picture."""

    def colors(self, positions: NDArray[np.float32], gradients: NDArray[np.float32]) -> NDArray[np.float32]:
        """RGB in [0, 1] per Gaussian, [N, 3], of a frame with these positions and deformation gradients."""
        ...

    def annotate(
        self, image: NDArray[np.uint8], time_s: float, positions: NDArray[np.float32], camera: Camera
    ) -> NDArray[np.uint8]:
        """The picture of the frame with what the colours mean; of the same size for all frames."""
        ...


def equivalent_strain(gradients: NDArray[np.floating]) -> NDArray[np.float64]:
    """Von Mises equivalent of ln U of deformation gradients [N, 3, 3]; shape [N], dimensionless."""
    F = gradients.astype(np.float64)
    squares = np.linalg.eigvalsh(np.swapaxes(F, 1, 2) @ F)
    logarithms = 0.5 * np.log(np.maximum(squares, 1e-12))
    deviator = logarithms - logarithms.mean(axis=1, keepdims=True)
    return np.sqrt(2 / 3 * (deviator**2).sum(axis=1))


class _Legend:
    """Fixed colours with a legend."""

    def __init__(self, colors: NDArray[np.float32], entries: Sequence[tuple[Color | None, str]]) -> None:
        self._colors, self._entries = colors, entries

    def colors(self, positions: NDArray[np.float32], gradients: NDArray[np.float32]) -> NDArray[np.float32]:
        """The same in every frame."""
        return self._colors

    def annotate(
        self, image: NDArray[np.uint8], time_s: float, positions: NDArray[np.float32], camera: Camera
    ) -> NDArray[np.uint8]:
        """The legend."""
        return with_legend(image, self._entries)


def _parts(inputs: OverlayInputs) -> Overlay:
    palette = part_colors(inputs.parts.count)
    colors = palette[inputs.parts.labels] / np.float32(255) * _part_shading(inputs)
    entries = [(_color(palette[number]), name) for number, name in enumerate(inputs.parts.names)]
    return _Legend(colors.astype(np.float32), entries)


def _material(inputs: OverlayInputs) -> Overlay:
    surfaces = [inputs.book.parts[name].surface for name in inputs.parts.names]
    kinds = list(dict.fromkeys(_described(surface) for surface in surfaces))
    palette = part_colors(len(kinds))
    number_of_part = np.array([kinds.index(_described(surface)) for surface in surfaces])
    colors = palette[number_of_part[inputs.parts.labels]] / np.float32(255) * _part_shading(inputs)
    entries = []
    for number, kind in enumerate(kinds):
        names = [name for name, own in zip(inputs.parts.names, number_of_part, strict=True) if own == number]
        entries.append((_color(palette[number]), f"{kind}: {_listed(names)}"))
    return _Legend(colors.astype(np.float32), entries)


class _Strain:
    """Strain in colour, one scale for the whole film."""

    def __init__(self, inputs: OverlayInputs) -> None:
        self._shading = _shading(inputs.asset, 0.82)
        frames = len(inputs.motion.times_s)
        wanted = set(np.linspace(0, frames - 1, min(frames, _SCALE_FRAMES)).astype(int).tolist())
        opaque = inputs.asset.gaussians.opacities > 0.3
        counted = opaque if opaque.any() else np.ones(len(opaque), bool)
        largest = 0.0
        for index, (_, gradients) in enumerate(inputs.motion.frames()):
            if index in wanted:
                strains = equivalent_strain(gradients[counted])
                moved = strains[strains > 1e-6]
                if len(moved):
                    largest = max(largest, float(np.percentile(moved, _SCALE_PERCENTILE)))
        self._full = _round_up(largest)

    def colors(self, positions: NDArray[np.float32], gradients: NDArray[np.float32]) -> NDArray[np.float32]:
        """Strain of this frame."""
        return strain_colors(equivalent_strain(gradients) / self._full) * self._shading

    def annotate(
        self, image: NDArray[np.uint8], time_s: float, positions: NDArray[np.float32], camera: Camera
    ) -> NDArray[np.uint8]:
        """The scale bar."""
        labels = [f"{100 * self._full * share:.3g} %" for share in (0, 0.25, 0.5, 0.75, 1)]
        return with_scale_bar(image, f"equivalent strain (von Mises)   t = {time_s:.2f} s", labels)


@dataclass(frozen=True)
class _Push:
    """A push during a time window; ``part`` None: everything that is free."""

    direction: NDArray[np.float64]
    strength: str
    from_s: float
    to_s: float
    part: str | None
    name: str

    def is_active(self, time_s: float) -> bool:
        return self.from_s <= time_s < self.to_s


@dataclass
class _Forces:
    """Arrows of what pushes, and what is held in blue."""

    inputs: OverlayInputs
    _held: NDArray[np.bool_] = field(init=False)
    _pushes: list[_Push] = field(init=False)
    _colors: NDArray[np.float32] = field(init=False)

    def __post_init__(self) -> None:
        asset = self.inputs.asset
        rest = asset.gaussians.means
        moved = np.zeros(len(rest), np.float32)
        for positions, _ in self.inputs.motion.frames():
            np.maximum(moved, np.abs(positions - rest).max(axis=1), out=moved)
        self._held = moved < _STILL * float((asset.upper - asset.lower).max())
        self._pushes = _pushes(self.inputs)
        base = asset.gaussians.base_colors
        tint = np.array(_HELD_COLOR, np.float32) / 255 * _shading(asset, 0.45)
        self._colors = np.where(self._held[:, None], 0.25 * base + 0.75 * tint, base).astype(np.float32)

    def colors(self, positions: NDArray[np.float32], gradients: NDArray[np.float32]) -> NDArray[np.float32]:
        """The object's own, what is held in blue."""
        return self._colors

    def annotate(
        self, image: NDArray[np.uint8], time_s: float, positions: NDArray[np.float32], camera: Camera
    ) -> NDArray[np.uint8]:
        """Arrows of what is active now, and in words."""
        active = [push for push in self._pushes if push.is_active(time_s)]
        arrows = [arrow for push in active for arrow in self._arrows(push, positions, camera)]
        entries: list[tuple[Color | None, str]] = [(None, f"t = {time_s:.2f} s")]
        for push in self._pushes:
            window = "" if math.isinf(push.to_s) else f", {push.from_s:g} to {push.to_s:g} s"
            text = f"{push.name} {push.strength}{window}"
            entries.append((_FORCE_COLOR if push.is_active(time_s) else (205, 205, 205), text))
        if not self._pushes:
            entries.append((None, "no force"))
        if self._held.any():
            entries.append((_HELD_COLOR, f"held: {_listed(self._held_parts())}"))
        return with_legend(draw_arrows(image, arrows), entries)

    def _held_parts(self) -> list[str]:
        labels = self.inputs.parts.labels
        still = [bool(self._held[labels == number].all()) for number in range(self.inputs.parts.count)]
        names = [name for name, all_of_it in zip(self.inputs.parts.names, still, strict=True) if all_of_it]
        return names or ["what does not move"]

    def _arrows(self, push: _Push, positions: NDArray[np.float32], camera: Camera) -> list[Arrow]:
        """Five arrows that come upon everything from upwind, or one whose tip lies in the middle of its part."""
        asset = self.inputs.asset
        pushed = ~self._held
        if push.part is not None:
            names = self.inputs.parts.names
            pushed = np.isin(self.inputs.parts.labels, [names.index(part) for part in parts_meant(push.part, names)])
        pushed &= asset.gaussians.opacities > 0.1
        points = (positions[pushed] if pushed.any() else positions).astype(np.float64)
        direction = push.direction
        low, middle, high = np.percentile(points, [5, 50, 95], axis=0)
        size = float((asset.upper - asset.lower).max())
        length = 0.16 * size
        if push.part is not None:
            return [_projected(middle - length * direction, middle, camera)]
        along = (points - middle) @ direction
        upwind = middle + direction * (float(np.percentile(along, 2)) - 0.02 * size)
        across = np.cross(direction, asset.frame.up)
        if np.linalg.norm(across) < 0.1:
            across = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
        rows = np.cross(across / np.linalg.norm(across), direction)
        reach = 0.5 * float(np.abs((high - low) @ rows))
        tips = [upwind + rows * reach * share for share in np.linspace(-0.9, 0.9, 5)]
        return [_projected(tip - length * direction, tip, camera) for tip in tips]


def _pushes(inputs: OverlayInputs) -> list[_Push]:
    """The forces of the scene that have one direction, the gust of the motion, and weight where it acts; input axes."""
    pushes = [_push_of(force) for force in inputs.scene.forces]
    facts, rotation = inputs.motion.facts, inputs.asset.frame.rotation
    if facts.wind_up is not None and facts.gust_ms2:
        gust = facts.gust_ms2 * rotation.T @ np.array(facts.wind_up)
        pushes.append(_one_push("gust", gust, "m/s2", 0.0, facts.gust_s, ALL_PARTS))
    if facts.gravity == "on":
        asked = inputs.scene.gravity_ms2
        weight = -_GRAVITY_MS2 * inputs.asset.frame.up if isinstance(asked, str) else np.array(asked)
        pushes.append(_one_push("gravity", weight, "m/s2", 0.0, math.inf, ALL_PARTS))
    return [push for push in pushes if push is not None]


def _push_of(force: Force) -> _Push | None:
    """What an arrow shows of a force; None where it has no one direction."""
    to_s = getattr(force, "to_s", None) or math.inf
    match force:
        case AccelerationForce():
            return _one_push("force", force.value_ms2, "m/s2", force.from_s, to_s, force.part)
        case TotalForce():
            return _one_push("force", force.value_n, "N", force.from_s, to_s, force.part)
        case PerParticleForce():
            return _one_push("force", force.value_n, "N per particle", force.from_s, to_s, force.part)
        case Impulse():
            return _one_push("blow", force.value_ns, "N s", force.at_s, force.at_s + _BLOW_SHOWN_S, force.part)
        case VelocitySet():
            return _one_push("velocity", force.value_ms, "m/s", force.from_s, to_s, force.part)
        case Wind():
            return _one_push("wind", force.velocity_ms, "m/s", force.from_s, to_s, force.part)
        case _:
            return None


def _one_push(name: str, value: ArrayLike, unit: str, from_s: float, to_s: float, part: str) -> _Push | None:
    vector = np.asarray(value, np.float64)
    size = float(np.linalg.norm(vector))
    if size == 0:
        return None
    everything = part == ALL_PARTS
    label = name if everything else f"{name} on {part}"
    return _Push(vector / size, f"{size:.3g} {unit}", from_s, to_s, None if everything else part, label)


def _projected(tail: NDArray[np.float64], tip: NDArray[np.float64], camera: Camera) -> Arrow:
    ends = []
    for point in (tail, tip):
        x, y, z = camera.viewmat[:3, :3] @ point + camera.viewmat[:3, 3]
        u, v, w = camera.K @ np.array([x, y, max(z, 1e-9)])
        ends.append((float(u / w), float(v / w)))
    towards = -float(camera.viewmat[2, :3] @ (tip - tail)) / float(np.linalg.norm(tip - tail))
    return Arrow(ends[0], ends[1], _FORCE_COLOR, towards)


def _shading(asset: Asset, darkest: float) -> NDArray[np.float32]:
    """Brightness of the object's own texture, from ``darkest`` to 1, [N, 1], so that shapes stay readable."""
    return _stretched(asset.gaussians.base_colors @ _LUMA, darkest)[:, None]


def _part_shading(inputs: OverlayInputs) -> NDArray[np.float32]:
    """The same within each part, so that a dark part has the colour of the legend too."""
    labels, luma = inputs.parts.labels, inputs.asset.gaussians.base_colors @ _LUMA
    shading = np.zeros(len(labels), np.float32)
    for number in range(inputs.parts.count):
        shading[labels == number] = _stretched(luma[labels == number], 0.45)
    return shading[:, None]


def _stretched(luma: NDArray[np.float32], darkest: float) -> NDArray[np.float32]:
    low, high = np.percentile(luma, [2, 98])
    share = np.clip((luma - low) / max(float(high - low), 1e-3), 0, 1)
    return (darkest + (1 - darkest) * share).astype(np.float32)


def _described(material: Material) -> str:
    return f"{material.name.replace('_', ' ')} ({_engineering(material.youngs_modulus_pa)}Pa)"


def _engineering(value: float) -> str:
    """3 significant digits with a prefix: 2.5e7 -> '25 M'."""
    power = min(max(math.floor(math.log10(value) / 3), 0), 4)
    return f"{value / 1000**power:.3g} {['', 'k', 'M', 'G', 'T'][power]}"


def _round_up(value: float) -> float:
    """The next of 1, 2, 4 or 8 times a power of ten."""
    if value <= 0:
        return 0.01
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1, 2, 4, 8, 10) if step * power >= value * (1 - 1e-9))


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")


def _color(row: NDArray[np.uint8]) -> Color:
    red, green, blue = row.tolist()
    return red, green, blue


OVERLAYS: dict[str, Callable[[OverlayInputs], Overlay]] = {
    "parts": _parts,
    "material": _material,
    "strain": _Strain,
    "forces": _Forces,
}
"""What ``render --overlay`` takes."""
