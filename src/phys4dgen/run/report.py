"""``report.json``: what was assumed, measured and spent, with the warnings first."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from phys4dgen.run.recorder import StageTime
from phys4dgen.types import Continuum, MaterialBook, Parts

__all__ = ["PartReport", "Report", "part_reports", "versions"]


@dataclass(frozen=True)
class PartReport:
    """One part in numbers.

    Attributes:
        gaussians: Gaussians of the part.
        particles: simulated particles of the part.
        volume_cm3: true volume, cubic centimetres.
        mass_g: true mass, grams.
        thickness_mm: median true thickness of its sheets and rods, millimetres; None for solids.
        interior_fraction: share of the volume that takes the interior material.
    """

    name: str
    gaussians: int
    particles: int
    volume_cm3: float
    mass_g: float
    thickness_mm: float | None
    interior_fraction: float
    surface: Mapping[str, Any]
    interior: Mapping[str, Any]


@dataclass
class Report:
    """The report of a run; fields stand in the file in this order.

    Attributes:
        warnings: what the reader must know to judge the result.
        notes: counts, choices and predictions.
        completed_until: last stage that was asked for and reached.
        backends: what did each stage, stand-ins named as such.
        stages: wall-clock seconds per stage, and whether it was reused.
        counts: gaussians, particles, parts, views, frames ...
        metres_per_unit: length of one unit of the input; 1 where there are several objects.
        objects: one entry per object, where there are several.
        parts: one entry per part.
        motion: preset, held parts, gust, frequency, as the motion stage chose them.
        simulation: cell size, CFL numbers, substeps per frame, damping, thickening true and simulated.
        history: time series of energy, momentum and volume.
    """

    input: str
    seed: int
    warnings: Sequence[str] = ()
    notes: Sequence[str] = ()
    completed_until: str = ""
    backends: Mapping[str, str] = field(default_factory=dict)
    stages: Sequence[StageTime] = ()
    counts: Mapping[str, int] = field(default_factory=dict)
    metres_per_unit: float | None = None
    objects: Sequence[Any] = ()
    parts: Sequence[PartReport] = ()
    motion: Any = None
    simulation: Any = None
    history: Any = None

    def as_dict(self) -> dict[str, Any]:
        """What report.json holds, warnings first."""
        seconds: dict[str, float] = {}
        for stage in self.stages:  # an object is turned to twice: for its size, then for all else
            seconds[stage.name] = round(seconds.get(stage.name, 0.0) + stage.seconds, 3)
        return {
            "warnings": list(self.warnings),
            "notes": list(self.notes),
            "input": self.input,
            "completed_until": self.completed_until,
            "seed": self.seed,
            "versions": versions(),
            "backends": dict(self.backends),
            "seconds": seconds,
            "reused": [stage.name for stage in self.stages if stage.reused],
            "seconds_total": round(sum(seconds.values()), 3),
            "counts": dict(self.counts),
            "metres_per_unit": self.metres_per_unit,
            **({"objects": list(self.objects)} if self.objects else {}),
            "parts": list(self.parts),
            "motion": self.motion,
            "simulation": self.simulation,
            "history": self.history,
        }


def part_reports(parts: Parts, continuum: Continuum, book: MaterialBook) -> list[PartReport]:
    """Volume, mass and thickness of every part, from the particles and the materials that they take."""
    reports = []
    for number, name in enumerate(parts.names):
        mine = continuum.part == number
        inside = mine & continuum.is_interior
        volume_m3 = float(continuum.volume_m3[mine].sum())
        interior_m3 = float(continuum.volume_m3[inside].sum())
        materials = book.parts[name]
        mass_kg = (
            volume_m3 - interior_m3
        ) * materials.surface.density_kgm3 + interior_m3 * materials.interior.density_kgm3
        thickness_m = continuum.thickness_m[mine]
        thickness_m = thickness_m[np.isfinite(thickness_m)]
        reports.append(
            PartReport(
                name=name,
                gaussians=int((parts.labels == number).sum()),
                particles=int(mine.sum()),
                volume_cm3=1e6 * volume_m3,
                mass_g=1e3 * mass_kg,
                thickness_mm=1e3 * float(np.median(thickness_m)) if len(thickness_m) else None,
                interior_fraction=interior_m3 / volume_m3 if volume_m3 else 0.0,
                surface=_material(materials.surface),
                interior=_material(materials.interior),
            )
        )
    return reports


def _material(material: Any) -> dict[str, Any]:
    return {
        "name": material.name,
        "source": material.source,
        "law": material.law,
        "density_kgm3": material.density_kgm3,
        "youngs_modulus_pa": material.youngs_modulus_pa,
        "poisson_ratio": material.poisson_ratio,
    }


def versions() -> dict[str, str]:
    """Versions of what computed the result, and the machine."""
    packages = ("phys4dgen", "numpy", "scipy", "numba", "llvmlite", "pillow", "imageio-ffmpeg")
    found = {name: importlib.metadata.version(name) for name in packages}
    found["python"] = platform.python_version()
    found["platform"] = f"{sys.platform} {platform.machine()}, {os.cpu_count()} cores"
    return found
