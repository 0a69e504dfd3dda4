"""Several insides, each found by itself, as one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np

from phys4dgen.interior.bridge import BridgeReport
from phys4dgen.interior.discover import Interior
from phys4dgen.types import Continuum

__all__ = ["joined_interiors"]


def joined_interiors(interiors: Sequence[Interior]) -> Interior:
    """Particles one after the other, sites and counts added up, and the worst figure of quality.

    Args:
        interiors: in the same coordinates, with part and Gaussian numbers of the whole.
    """
    continua = [interior.continuum for interior in interiors]
    first_site = np.cumsum([0, *(int(continuum.site.max()) + 1 for continuum in continua[:-1])])
    continua = [
        replace(continuum, site=continuum.site + first) for continuum, first in zip(continua, first_site, strict=True)
    ]
    names = [entry.name for entry in fields(Continuum) if entry.name != "spacing_m"]
    bridges = [interior.bridges for interior in interiors]
    return Interior(
        Continuum(
            **{name: np.concatenate([getattr(continuum, name) for continuum in continua]) for name in names},
            spacing_m=max(continuum.spacing_m for continuum in continua),
        ),
        BridgeReport(
            pieces_before=sum(report.pieces_before for report in bridges),
            pieces_after=sum(report.pieces_after for report in bridges),
            share_in_largest=min(report.share_in_largest for report in bridges),
            bridge_voxels=sum(report.bridge_voxels for report in bridges),
        ),
        solid_voxels=sum(interior.solid_voxels for interior in interiors),
        agreement=min((i.agreement for i in interiors if not math.isnan(i.agreement)), default=math.nan),
        density_threshold=math.nan,
        loose_particles=sum(interior.loose_particles for interior in interiors),
        backend="; ".join(dict.fromkeys(interior.backend for interior in interiors)),
    )
