"""Section ``interior``: the inside is found and filled."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from phys4dgen.scene.sections.values import Auto, PartAddress, Section

__all__ = ["Interior"]


class Interior(Section):
    """How the inside is found and filled with particles (Paper: Sec. 3.3)."""

    label_grid: Annotated[int, Field(ge=8, le=128)] = 32
    """cells along the longest side of the grid that labels the inside"""
    confidence: Annotated[float, Field(gt=0, lt=1)] = 0.95
    """of the chi-square test that a cell is covered by a Gaussian"""
    max_particles_per_gaussian: Annotated[int, Field(ge=1, le=100)] = 10
    """samples drawn from one Gaussian at most"""
    spacing: Auto | Annotated[float, Field(ge=0.2, le=1)] = "auto"
    """between simulated particles, in grid cells (dx); auto: 0.5"""
    particles: Literal["auto", "gaussians"] = "auto"
    """auto: well spaced, the Gaussians ride on them; gaussians: every Gaussian is one, with the interior cells of the
    label grid (the paper's; slower)"""
    method: Literal["auto", "ipsd", "winding", "both", "none"] = "auto"
    """auto: exact where the reconstruction knows the inside, else ipsd; ipsd: carve by masks and depths (the paper's);
    winding: fill by the winding number; both: what they agree on; none: nothing inside, a skin of one layer of
    particles (the paper's ablation)"""
    hollow: dict[PartAddress, bool | Annotated[float, Field(gt=0, lt=1)]] = Field(default_factory=dict)
    """parts of which only a wall is filled: its thickness in metres; true: as parts.NAME.thickness_m, else as usual
    for parts.NAME.material"""
