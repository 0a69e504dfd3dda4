"""The random walk from clicks: as theory has it on chains, over islands by their look, stopped by creases and edges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from phys4dgen.grouping.clicked import parts_by_random_walk
from phys4dgen.grouping.patch_graph import PatchGraph
from phys4dgen.grouping.regions import describe_regions, join_order, regions_at


def graph(look: list[float], touching: list[tuple[int, int]], crease: dict[tuple[int, int], float]) -> PatchGraph:
    """Patches that differ in lightness alone; one length of border everywhere; a chain bends where it is creased."""
    count = len(look)
    feature = np.zeros((count, 5))
    feature[:, 0] = look
    concavity = np.array([crease.get((i - 1, i), -0.15) + 0.15 for i in range(1, count)])
    slope = np.concatenate([[0.0], np.cumsum(2 * np.arcsin(concavity / 2))])
    along = np.stack([np.cos(slope), np.zeros(count), np.sin(slope)], 1)
    return PatchGraph(
        patch=np.arange(count, dtype=np.int32),
        color=feature[:, :3].astype(np.float32),
        visible=np.ones(count, np.bool_),
        area=np.full(count, 1 / count),
        feature=feature,
        spread=np.zeros((count, 3)),
        centre=np.concatenate([np.zeros((1, 3)), np.cumsum((along[1:] + along[:-1]) / 2, axis=0)]),
        normal=np.stack([-along[:, 2], along[:, 1], along[:, 0]], 1),
        flatness=np.ones(count),
        diameter=np.zeros(count),
        touching=np.array(touching, np.int32).reshape(-1, 2),
        border=np.full(len(touching), 10.0),
        crease=np.array([crease.get(pair, 0.0) for pair in touching]),
    )


def chain(count: int) -> list[tuple[int, int]]:
    return [(i, i + 1) for i in range(count - 1)]


def clicks(count: int, *places: int) -> np.ndarray:
    seeds = np.full(count, -1)
    seeds[list(places)] = np.arange(len(places))
    return seeds


def test_on_an_even_chain_the_border_lies_half_way():
    part = parts_by_random_walk(graph([30.0] * 11, chain(11), {}), clicks(11, 0, 9))
    np.testing.assert_array_equal(part, [0] * 5 + [1] * 6)


def test_the_border_lies_on_the_edge_of_colour_not_half_way():
    part = parts_by_random_walk(graph([30.0] * 3 + [60.0] * 9, chain(12), {}), clicks(12, 0, 11))
    np.testing.assert_array_equal(part, [0] * 3 + [1] * 9)


def test_the_border_lies_in_the_crease_where_all_is_of_one_colour():
    part = parts_by_random_walk(graph([30.0] * 12, chain(12), {(7, 8): 0.6}), clicks(12, 0, 11))
    np.testing.assert_array_equal(part, [0] * 8 + [1] * 4)


@pytest.mark.parametrize(("fold", "border"), [(0.0, 8), (-0.5, 6)])
def test_thickness_parts_what_is_of_one_colour_but_not_over_a_sharp_convex_edge(fold: float, border: int):
    """A wheel and its car; but the top and the rim of one slab."""
    some = graph([30.0] * 12, chain(12), {(7, 8): fold})
    thick = replace(some, diameter=np.log([0.1] * 8 + [0.8] * 4))
    np.testing.assert_array_equal(parts_by_random_walk(thick, clicks(12, 0, 11)), [0] * border + [1] * (12 - border))


def test_an_island_belongs_to_what_it_looks_like():
    """The second half of a bun: between it and the click lies something else, which it touches."""
    look = [50.0] * 4 + [10.0] * 4 + [50.0] * 4
    part = parts_by_random_walk(graph(look, chain(12), {}), clicks(12, 1, 6))
    np.testing.assert_array_equal(part, [0] * 4 + [1] * 4 + [0] * 4)


def test_what_can_be_reached_does_not_leap():
    """A far patch of exactly the other click's look still belongs to the surface that it is a smooth part of."""
    look = [30.0, 31, 32, 33, 34, 35, 36, 37, 60, 60, 37]
    joined = [pair for pair in chain(11) if pair != (9, 10)]
    part = parts_by_random_walk(graph(look, joined, {}), clicks(11, 0, 10))
    np.testing.assert_array_equal(part[:8], 0)


@pytest.mark.parametrize(("fold", "home"), [(-0.25, 0), (0.3, 1), (-0.5, 1)])
def test_a_painted_area_belongs_to_what_it_goes_on_from(fold: float, home: int):
    """The foot of a cup has the colour of the coffee; all along its edge it passes into the cup without a fold."""
    coffee, cup, foot = range(6), range(6, 18), range(18, 24)
    look = [10.0] * 6 + [30.0] * 12 + [10.0] * 6
    edge = [(12 + k, 18 + k) for k in range(6)]
    crease = {(i, i + 1): -0.25 for i in range(23)} | {(5, 6): 0.5} | dict.fromkeys(edge, fold)
    pairs = [pair for pair in chain(24) if pair != (17, 18)] + edge
    part = parts_by_random_walk(graph(look, pairs, crease), clicks(24, 14, 2))
    np.testing.assert_array_equal(part[cup], 0)
    np.testing.assert_array_equal(part[coffee], 1)
    np.testing.assert_array_equal(part[foot], home)


def test_of_two_parts_of_one_look_an_island_belongs_to_the_one_in_like_surroundings():
    """A second lump of coal on the snow, where the hat is as black as coal: one click on each and on the snow."""
    snow, hat = [60.0] * 8, [10.0] * 12
    look = [*snow, 10.0, *snow, 10.0, *snow, *hat]
    crease = {(24, 25): 0.5, (25, 26): 0.5}
    part = parts_by_random_walk(graph(look, chain(38), crease), clicks(38, 4, 8, 31))
    assert part[17] == 1
    np.testing.assert_array_equal(part[26:], 2)


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 40), st.integers(0, 10**6))
@example(16, 87053)  # the fourth most alike is one of two that look the same
@example(38, 838890)  # patches that no click can reach
def test_any_graph_gives_every_patch_a_part_and_keeps_the_clicks(count: int, seed: int):
    rng = np.random.default_rng(seed)
    pairs = [(i, j) for i in range(count) for j in range(i + 1, count) if rng.uniform() < 2 / count]
    some = graph(list(rng.uniform(0, 50, count)), pairs, {pair: rng.uniform(-0.5, 1) for pair in pairs})
    seeds = clicks(count, *rng.permutation(count)[: rng.integers(1, min(count, 5) + 1)])
    part = parts_by_random_walk(some, seeds)
    assert set(part) == set(seeds[seeds >= 0])
    np.testing.assert_array_equal(part[seeds >= 0], seeds[seeds >= 0])
    ends, alone = np.array(pairs, int).reshape(-1, 2), np.bincount(np.ravel(pairs).astype(int), minlength=count) == 1
    if (alone[ends].all(1) & (seeds[ends] >= 0).all(1)).any():
        return  # two that touch nothing else come to look the same; which of two such clicks is nearer is a tie
    # The same whatever the patches are called.
    order = rng.permutation(count)
    number = np.argsort(order)
    renamed = replace(
        some,
        feature=some.feature[order],
        centre=some.centre[order],
        normal=some.normal[order],
        touching=np.sort(number[some.touching], 1).astype(np.int32),
    )
    np.testing.assert_array_equal(parts_by_random_walk(renamed, seeds[order]), part[order])


def test_one_click_means_one_part():
    np.testing.assert_array_equal(parts_by_random_walk(graph([1.0, 90, 5], [], {}), clicks(3, 1)), [0, 0, 0])


def bent_sheet(rows: int, columns: int, noise: float) -> PatchGraph:
    """A sheet of one colour, folded upwards by 60 degrees half way; what each pair of patches says of it is noisy."""
    rng = np.random.default_rng(3)
    count = rows * columns
    pairs = [(i, i + columns) for i in range(count - columns)]
    pairs += [(i, i + 1) for i in range(count) if (i + 1) % columns]
    place = np.indices((rows, columns)).reshape(2, -1).T - [0, columns / 2 - 0.5]
    steep = place[:, 1] > 0
    tilt = np.deg2rad(np.where(steep, 60.0, 0.0))
    flat = graph([30.0] * len(place), pairs, {})
    across = place[:, 1] > 0
    crease = np.where(across[flat.touching[:, 0]] != across[flat.touching[:, 1]], 0.4, -0.15)
    normal = np.stack([np.zeros(len(place)), -np.sin(tilt), np.cos(tilt)], 1) + 0.3 * noise * rng.normal(
        size=(len(place), 3)
    )
    return replace(
        flat,
        feature=flat.feature + noise * rng.normal(size=flat.feature.shape),
        centre=np.stack([place[:, 0], place[:, 1] * np.cos(tilt), place[:, 1] * np.sin(tilt)], 1),
        normal=normal / np.linalg.norm(normal, axis=1, keepdims=True),
        crease=np.clip(crease + noise * 0.7 * rng.normal(size=len(pairs)), -0.5, 1),
    )


def test_what_is_lost_in_noise_pair_by_pair_is_found_on_average_along_the_border():
    rows, columns = 16, 24
    sheet = bent_sheet(rows, columns, noise=1.0)
    steep = np.tile(np.arange(columns) >= columns // 2, rows)
    at_the_fold = steep[sheet.touching[:, 0]] != steep[sheet.touching[:, 1]]
    assert sheet.crease[at_the_fold].min() < -0.4  # a walker over patches finds holes
    region = regions_at(join_order(sheet, sheet.feature), np.full(len(sheet), -1), 6)
    purity = [max(np.mean(steep[region == one]), np.mean(~steep[region == one])) for one in range(region.max() + 1)]
    assert min(purity) > 0.9
    # One click at the very edge of the sheet, the other next to the fold.
    part = parts_by_random_walk(sheet, clicks(len(sheet), 8 * columns, 8 * columns + 13))
    assert ((part == 1) == steep).mean() > 0.95


def test_folds_are_measured_from_all_that_lies_beside_a_border():
    sheet = bent_sheet(16, 24, noise=0.0)
    steep = np.tile(np.arange(24) >= 12, 16).astype(np.int64)
    regions = describe_regions(sheet, steep, sheet.feature)
    np.testing.assert_array_equal(regions.touching, [[0, 1]])
    assert regions.length[0] == 160
    # Two planes at 60 degrees: 2 sin 30 between their normals along the line from one to the other, less what is free.
    np.testing.assert_allclose(regions.fold, 1 - 0.15, atol=0.02)


def test_regions_with_clicks_of_several_parts_stay_divided():
    sheet = bent_sheet(8, 12, noise=0.0)
    seeds = clicks(len(sheet), 0, 1, 2)
    seeds[95] = 0
    region = regions_at(join_order(sheet, sheet.feature), seeds, 1)
    clicked = region[seeds >= 0]
    assert len({*clicked[:3]}) == 3
    for one in range(region.max() + 1):
        assert len({*seeds[(region == one) & (seeds >= 0)]}) <= 1
