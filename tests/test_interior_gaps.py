"""How much of the thin surfaces lies too close to another one for the grid to tell them apart."""

from dataclasses import replace

import numpy as np
import pytest

from phys4dgen.interior.gaps import narrow_gaps
from phys4dgen.types import SHEET, Continuum, Frame, rotation_to_z_up

CELL_M = 4e-3
FRAME = Frame(rotation_to_z_up(np.array([0.0, 1, 0])), 0.35)


def _sheets(*heights_cells, tilt=(0.0, 0.0, 1.0), size=12, curve_cells=0.0):
    """Two-layer sheets of sites half a cell apart, stacked at the given heights."""
    normal = np.array(tilt) / np.linalg.norm(tilt)
    first = np.linalg.svd(normal[None])[2][1:]
    grid = (np.stack(np.meshgrid(np.arange(size), np.arange(size), indexing="ij"), -1).reshape(-1, 2)) * CELL_M / 2
    bend = curve_cells * CELL_M * (grid[:, 0] / grid.max()) ** 2
    middle = np.concatenate([grid @ first + (h * CELL_M + bend)[:, None] * normal for h in np.array(heights_cells)])
    offset = np.repeat(2e-4 * normal[None], len(middle), 0)
    middle, offset = np.repeat(middle, 2, 0), np.stack([offset, -offset], 1).reshape(-1, 3)
    p = len(middle)
    return Continuum(
        positions=FRAME.from_metres(middle + offset),
        part=np.zeros(p, np.int32),
        is_interior=np.zeros(p, bool),
        volume_m3=np.full(p, 1e-9),
        gaussian_index=np.full(p, -1, np.int32),
        piece=np.zeros(p, np.int32),
        shape=np.full(p, SHEET, np.int8),
        thickness_m=np.full(p, 7e-4),
        thickness_measured=np.ones(p, bool),
        offset_m=offset,
        site=np.repeat(np.arange(p // 2, dtype=np.int32), 2),
        spacing_m=CELL_M / 2,
    )


def _share(continuum, free=None):
    free = np.ones(len(continuum), bool) if free is None else free
    body_id = np.zeros(len(continuum), np.int32)
    gaps = narrow_gaps(continuum, frame=FRAME, free=free, body_id=body_id, cell_m=CELL_M)
    assert gaps.close == gaps.welded
    assert gaps.welded_parts == 0
    return gaps.welded


@pytest.mark.parametrize("tilt", [(0.0, 0.0, 1.0), (0.4, -0.3, 0.8)])
def test_one_sheet_is_not_glued_to_itself(tilt):
    assert _share(_sheets(0.0, tilt=tilt)) == 0
    assert _share(_sheets(0.0, tilt=tilt, curve_cells=1.5)) == 0


@pytest.mark.parametrize("gap_cells, expected", [(0.8, 1.0), (1.5, 1.0), (2.2, 0.0), (4.0, 0.0)])
def test_two_sheets_closer_than_two_cells_move_as_one(gap_cells, expected):
    assert _share(_sheets(0.0, gap_cells, tilt=(0.4, -0.3, 0.8))) == expected


def test_only_what_is_free_counts():
    three = _sheets(0.0, 1.0, 10.0)
    held = np.arange(len(three)) < len(three) // 3
    assert _share(three) == pytest.approx(2 / 3)
    assert _share(three, ~held) == 0
    assert _share(three, np.zeros(len(three), bool)) == 0


def test_bodies_with_their_own_velocity_fields_are_close_but_not_glued():
    three = _sheets(0.0, 1.0, 2.0)
    third = np.repeat(np.int32([0, 1, 2]), len(three) // 3)
    three = replace(three, part=third)
    free = np.ones(len(three), bool)
    for body_id, welded in ((third, 0.0), (np.minimum(third, 1), 2 / 3), (0 * third, 1.0)):
        gaps = narrow_gaps(three, frame=FRAME, free=free, body_id=body_id, cell_m=CELL_M)
        assert gaps == pytest.approx((1.0, welded, welded))
