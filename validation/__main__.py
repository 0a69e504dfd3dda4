"""Run the benchmarks, or random scenes.

    python -m validation                     # all benchmarks; writes docs/validation.md
    python -m validation B4 B12              # these alone; writes nothing
    python -m validation random --count 200  # random scenes; 200 or more write docs/validation-random.md

Exit code 1 when a number is outside its tolerance or a scene is at fault.
"""

from __future__ import annotations

import argparse
import sys

from validation.case import BENCHMARKS
from validation.page import write_page, write_random_page
from validation.random_run import in_batches
from validation.suite import in_order, run

_COUNT_FOR_THE_PAGE = 200


def _benchmarks(chosen: list[str]) -> int:
    unknown = [key for key in chosen if key not in BENCHMARKS]
    if unknown:
        sys.stderr.write(f"there is no benchmark '{unknown[0]}'; there are {', '.join(b.key for b in in_order())}.\n")
        return 2
    runs = []
    for ran in run([benchmark for benchmark in in_order() if not chosen or benchmark.key in chosen]):
        runs.append(ran)
        name = f"{ran.benchmark.key:4} {ran.benchmark.title}{f': {ran.variant}' if ran.variant else ''}"
        print(f"{name} ({ran.seconds:.0f} s)", flush=True)
        for check in ran.outcome.checks:
            expected, measured, error, tolerance = check.texts()
            verdict = "ok" if check.passed else "MISSED"
            print(f"    {verdict:6} {check.what:58} {measured:>10}  expected {expected}, error {error}, {tolerance}")
    missed = sum(not ran.outcome.passed for ran in runs)
    if not chosen:
        print(f"wrote {write_page(runs)}")
    print(f"{missed} of {len(runs)} outside their tolerances" if missed else "all inside their tolerances")
    return 1 if missed else 0


def _random(first: int, count: int) -> int:
    verdicts = []
    for verdict in in_batches(first, count):
        verdicts.append(verdict)
        word = "FAULT" if verdict.fault else "ended" if verdict.ended else "ok"
        print(f"{verdict.seed:5} {word:5} {verdict.excess:9.2e}  {verdict.title}", flush=True)
        if verdict.fault or verdict.ended:
            print(f"      {verdict.fault or verdict.ended}", flush=True)
    faults = [verdict.seed for verdict in verdicts if verdict.fault]
    if count >= _COUNT_FOR_THE_PAGE:
        print(f"wrote {write_random_page(verdicts)}")
    print(f"at fault: seeds {', '.join(map(str, faults))}" if faults else f"none of {count} scenes is at fault")
    return 1 if faults else 0


def main() -> int:
    """Parse the command and run it."""
    parser = argparse.ArgumentParser(
        prog="python -m validation", description="The engine beside theory and experiment."
    )
    parser.add_argument("keys", nargs="*", help="benchmarks (B1 ..), or 'random'; all benchmarks by default")
    parser.add_argument("--count", type=int, default=_COUNT_FOR_THE_PAGE, help="random scenes")
    parser.add_argument("--first", type=int, default=0, help="seed of the first random scene")
    arguments = parser.parse_args()
    if arguments.keys == ["random"]:
        return _random(arguments.first, arguments.count)
    return _benchmarks(arguments.keys)


if __name__ == "__main__":
    sys.exit(main())
