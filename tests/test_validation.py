"""The quick benchmarks of ``validation`` (PHYSICS table B1 to B21) and some of its random scenes."""

from __future__ import annotations

import pytest
from validation.case import BENCHMARKS
from validation.random_run import judge
from validation.random_scenes import random_scene
from validation.suite import in_order

QUICK = [(benchmark.key, variant) for benchmark in in_order() for variant in benchmark.in_tests]


@pytest.mark.parametrize(("key", "variant"), QUICK, ids=[f"{key} {variant}".strip() for key, variant in QUICK])
def test_benchmark(key, variant):
    benchmark = BENCHMARKS[key]
    outcome = benchmark.run(**benchmark.variants[variant])
    missed = [(check.what, *check.texts()) for check in outcome.checks if not check.passed]
    assert not missed


def test_every_quick_variant_exists():
    for benchmark in BENCHMARKS.values():
        assert set(benchmark.in_tests) <= set(benchmark.variants)


@pytest.mark.parametrize("seed", [1, 2, 3, 5, 6, 8, 10, 46, 122])
def test_random_scene(seed):
    verdict = judge(seed)
    assert not verdict.fault, verdict
    assert not verdict.ended, verdict


def test_a_seed_always_makes_the_same_scene():
    first, second = random_scene(7), random_scene(7)
    assert first.title == second.title
    assert (first.body.positions_m == second.body.positions_m).all()
