"""How reliable a model is: the paper's table of repeated answers, and models side by side (appendix B.5)."""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from phys4dgen.materials.mllm.reading import Reading, SideReading

__all__ = ["PartStatistics", "comparison_table", "part_statistics", "reliability_table"]


@dataclass(frozen=True)
class PartStatistics:
    """The answers on the surface of one part.

    Attributes:
        of: number of answers.
        material: most frequent name in the models' words, and its share.
        top: most frequent value and its share, by property: log10_e_pa, density_kgm3, poisson_ratio.
        mean: by property.
        median: by property.
    """

    of: int
    material: tuple[str, float]
    top: Mapping[str, tuple[float, float]]
    mean: Mapping[str, float]
    median: Mapping[str, float]


_PROPERTIES = (
    ("log10_e_pa", "$E$ ($\\log_{10}$ Pa)", 3),
    ("density_kgm3", "$\\rho$ (kg/m³)", 0),
    ("poisson_ratio", "$\\nu$", 3),
)


def part_statistics(readings: Sequence[Reading], letter: str) -> PartStatistics | None:
    """Statistics of the surface of a part; None where no answer describes it."""
    sides = [reading.parts[letter].surface for reading in readings if letter in reading.parts]
    if not sides:
        return None
    values = {key: [_value(side, key) for side in sides] for key, _, _ in _PROPERTIES}
    name, votes = _top([side.said for side in sides])
    return PartStatistics(
        of=len(sides),
        material=(str(name), votes),
        top={key: _top([round(value, 3) for value in column]) for key, column in values.items()},
        mean={key: statistics.fmean(column) for key, column in values.items()},
        median={key: statistics.median(column) for key, column in values.items()},
    )


def reliability_table(readings: Sequence[Reading], letters: Mapping[str, str], *, model: str) -> str:
    """The paper's table as Markdown: one column per part.

    Args:
        readings: the answers.
        letters: letter of each part by name.
        model: id of the model, for the heading.
    """
    columns = {name: part_statistics(readings, letter) for name, letter in letters.items()}
    found = {name: column for name, column in columns.items() if column is not None}
    rows = [["Property", *found]]
    rows.append(["Top-1 material / share", *(_named(column.material) for column in found.values())])
    for key, label, digits in _PROPERTIES:
        rows.append([f"Top-1 {label} / share", *(_shared(column.top[key], digits) for column in found.values())])
    for key, label, digits in _PROPERTIES:
        rows.append(
            [f"{label} mean / median"]
            + [f"{column.mean[key]:.{digits}f} / {column.median[key]:.{digits}f}" for column in found.values()]
        )
    return f"# {len(readings)} answers of {model} on the surface of each part\n\n{_markdown(rows)}"


def comparison_table(answers: Mapping[str, Sequence[Reading]], letters: Mapping[str, str]) -> str:
    """Median log10 of Young's modulus at the surface of each part, one row per model, as Markdown."""
    rows = [["Model", "Answers", *letters]]
    for model, readings in answers.items():
        cells = []
        for letter in letters.values():
            column = part_statistics(readings, letter)
            cells.append("–" if column is None else f"{column.median['log10_e_pa']:.3f} ({column.material[0]})")
        rows.append([model, str(len(readings)), *cells])
    return f"# Median $E$ ($\\log_{{10}}$ Pa) and most frequent material by model\n\n{_markdown(rows)}"


def _value(side: SideReading, key: str) -> float:
    return math.log10(side.youngs_modulus_pa) if key == "log10_e_pa" else float(getattr(side, key))


def _top(values: Sequence[str] | Sequence[float]) -> tuple[float, float]:
    """The most frequent value (of equals the smallest) and its share."""
    counts: Counter[str | float] = Counter(values)
    value = min(counts, key=lambda candidate: (-counts[candidate], candidate))
    return value, counts[value] / len(values)  # type: ignore[return-value]


def _named(top: tuple[str, float]) -> str:
    return f"{top[0]} / {100 * top[1]:.0f} %"


def _shared(top: tuple[float, float], digits: int) -> str:
    value = f"{top[0]:.{digits}f}"
    short = value.rstrip("0").rstrip(".") if "." in value else value
    return f"{short} / {100 * top[1]:.0f} %"


def _markdown(rows: Sequence[Sequence[str]]) -> str:
    clean = [[cell.replace("|", "/") for cell in row] for row in rows]
    lines = ["| " + " | ".join(row) + " |" for row in clean]
    lines.insert(1, "|" + " --- |" * len(rows[0]))
    return "\n".join(lines) + "\n"
