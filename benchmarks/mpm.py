"""Speed of the MPM engine in million particle-substeps per second, law by law, beside its prototype and Taichi.

    python benchmarks/mpm.py [--prototype-dir ../shared/prototypes/mpm] [--rounds 9] [--threads 1 2] [--laws LAW ...]
                             [--only laws|sizes|floor|compile]

The scene is that of the prototype: a cube a third of the domain wide, 100,000 random particles, 64 cells along the
domain, dt 5e-5 s. All competitors of a table run in one process, 100 substeps each in turn, ``rounds`` times; Taichi
in a process of its own with fixed corotated, 5 substeps of its 65,536 particles a turn. A share is the median over
rounds of the ratio within a round, and a rate is a median too, so that a machine that changes its speed disturbs all
alike. Compilation is not counted in the rates. It is measured once, in processes with an empty cache: what all laws
share, each law, and a whole scene of three laws up to its first frame, cold and then with the cache warm; its limits
are held against CPU time, which is the waiting time on an idle machine. What is missing is skipped, with the reason.
Plastic materials are weak enough to flow in most particles.

Three more tables: two threads over one; 20,000 to a million particles at the same number per cell, and the most memory
that the process held; and one core as a share of its arithmetic floor, the time that a measured sgemm would need for
the 2.1 kflop of a particle-substep of fixed corotated (counted by hand, +-15 %), beside a float64 NumPy reference. Exit
code 1 when anything misses its limit.
"""

from __future__ import annotations

import argparse
import importlib.util
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from _mpm_scripts import COLD_START, COMPILE, FLOOR, LAWS, SIZE, SPEEDUP, TAICHI

LIMITS = {
    "NEO_HOOKEAN": 1.0,
    "FIXED_COROTATED": 0.85,
    "STVK_HENCKY": 0.7,
    "VON_MISES": 0.7,
    "DRUCKER_PRAGER": 0.7,
    "SNOW": 0.7,
    "VISCOPLASTIC": 0.7,
    "HERSCHEL_BULKLEY": 0.4,
    "FLUID": 1.0,
}
"""Least share of the prototype's fixed corotated rate, by law."""
LEAST_SPEEDUP = 1.7
"""Of two threads over one, fixed corotated."""
LEAST_OVER_TAICHI = 30.0
"""Of fixed corotated, on two threads."""
FLOOR_KFLOP = 2.1
FLOOR_LIMITS = {"FIXED_COROTATED": 0.40, "VON_MISES": 0.30}
PARTICLES = 100_000
SIZES = (20_000, 100_000, 400_000, 1_000_000)
MOST_MEMORY_GB = 1.2
"""For a million particles in a domain of 128 cells."""
COLD_START_LIMITS_S = {"cold": 30.0, "warm": 2.0}
"""Of a scene of three laws, from the start of the process to the first frame, CPU time."""
SECTIONS = ("laws", "sizes", "floor", "compile")
SHARED = Path(__file__).resolve().parents[2] / "shared"
REFERENCE_FOLDER = Path(__file__).resolve().parents[1] / "tests/reference"


def times(script: str, *arguments: str, cache: str) -> dict[str, float]:
    """Seconds by name that a script reports in a process of its own, which keeps its compiled code in ``cache``."""
    environment = dict(os.environ, NUMBA_CACHE_DIR=cache)
    command = [sys.executable, "-c", script, *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=1200, check=False)
    if done.returncode:
        print(f"failed: {(done.stderr.strip().splitlines() or ['no output'])[-1]}")
    lines = [line.split(maxsplit=2) for line in done.stdout.splitlines() if line.startswith("TIME ")]
    return {name: float(seconds) for _, seconds, name in lines}


def compile_table(options: argparse.Namespace) -> bool:
    """How long kernels take to compile, and a first frame; True if that takes too long."""
    print("\ncompilation with an empty cache, s of CPU time; the first ones bring in what all share")
    with tempfile.TemporaryDirectory() as cache:
        for name, seconds in times(COMPILE, *options.laws, cache=cache).items():
            print(f"  {name:30s} {seconds:6.1f}")
    print("\nstart of a process to the first frame of a scene of three laws: s of CPU time, s in all")
    missed = False
    with tempfile.TemporaryDirectory() as cache:
        for name, limit_s in COLD_START_LIMITS_S.items():
            start = time.perf_counter()
            found = times(COLD_START, cache=cache)
            wall_s = time.perf_counter() - start
            cpu_s = found.get("CPU", math.inf)
            slow = cpu_s > limit_s
            print(f"  {name:30s} {cpu_s:6.1f} {wall_s:6.1f}  {f'over {limit_s:g}' if slow else ''}")
            missed |= slow
    return missed


Rates = dict[str, list[float]]


def rates(script: str, *arguments: str, threads: int, turns: int, particles: int = PARTICLES) -> tuple[Rates, float]:
    """Rates by competitor, turn by turn, and peak memory (GB) that a script reports in a process of its own."""
    environment = dict(os.environ, NUMBA_NUM_THREADS=str(max(2, threads)), PYTHONWARNINGS="ignore")
    environment |= dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), str(threads))
    command = [sys.executable, "-c", script, str(threads), str(turns), str(particles), *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=3600, check=False)
    if done.returncode:
        print(f"failed: {(done.stderr.strip().splitlines() or ['no output'])[-1]}")
    found: Rates = {}
    memory_gb = math.nan
    for line in done.stdout.splitlines():
        if line.startswith("RATE "):
            _, name, value = line.split()
            found.setdefault(name, []).append(float(value))
        elif line.startswith("MEMORY "):
            memory_gb = float(line.split()[1])
    return found, memory_gb


def median_share(ours: list[float], theirs: list[float], of_theirs: float = 1.0) -> float:
    """Median over turns of the ratio within a turn."""
    return statistics.median(a / (b * of_theirs) for a, b in zip(ours, theirs, strict=True))


def judged(value: float, least: float) -> tuple[str, bool]:
    """A note for the table, and whether a limit is missed."""
    return (f"below {least:g}", True) if value < least else ("", False)


def laws_table(options: argparse.Namespace, scratch: str) -> bool:
    """Every law beside the prototype and Taichi; True if something is too slow."""
    prototype = ""
    if (options.prototype_dir / "mpm_numba.py").is_file():
        copy = Path(scratch) / "prototype"  # its folder may be read-only, and Numba caches beside the source
        copy.mkdir()
        for source in options.prototype_dir.glob("*.py"):
            (copy / source.name).write_text(source.read_text())
        prototype = str(copy)
    else:
        print(f"prototype: skipped, no mpm_numba.py in {options.prototype_dir}")
    has_taichi = importlib.util.find_spec("taichi") is not None
    if not has_taichi:
        print("Taichi: skipped, not installed (pip install 'phys4dgen[bench]')")
    missed = False
    for threads in options.threads:
        found, _ = rates(LAWS, prototype, *options.laws, threads=threads, turns=options.rounds)
        if not set(options.laws) <= found.keys():
            return True
        print(f"\n{threads} thread{'s' if threads > 1 else ''}: million particle-substeps/s, share of the prototype's")
        base = found.get("prototype")
        for name, ours in found.items():
            share = median_share(ours, base) if base else math.nan
            note, slow = judged(share, LIMITS.get(name, 0.0))
            print(f"  {name:30s} {statistics.median(ours):8.2f} {share:6.2f}  {note}")
            missed |= slow
        if has_taichi and "FIXED_COROTATED" in found:
            found, _ = rates(TAICHI, scratch, "FIXED_COROTATED", threads=threads, turns=options.rounds)
            if not found:
                return True
            ratio = median_share(found["FIXED_COROTATED"], found["Taichi"])
            note, slow = judged(ratio, LEAST_OVER_TAICHI if threads == 2 else 0.0)
            print(f"  {'Taichi mpm3d_ggui, ti.cpu':30s} {statistics.median(found['Taichi']):8.2f}")
            print(f"  {'fixed corotated over Taichi':30s} {ratio:8.1f}         {note}")
            missed |= slow
    return missed


def speedup_line(options: argparse.Namespace) -> bool:
    """Two threads over one; True if too little."""
    found, _ = rates(SPEEDUP, "FIXED_COROTATED", threads=2, turns=4 * options.rounds)
    if not found:
        return True
    ratio = median_share(found["two"], found["one"])
    note, slow = judged(ratio, LEAST_SPEEDUP)
    print(f"\ntwo threads over one, fixed corotated: {ratio:.2f}  {note}")
    return slow


def sizes_table(options: argparse.Namespace) -> bool:
    """Fixed corotated from 20,000 to a million particles; True if a million take too much memory."""
    missed = False
    for threads in options.threads:
        print(f"\nfixed corotated, {threads} thread{'s' if threads > 1 else ''}: particles, M/s, most memory in GB")
        for size in SIZES:
            found, memory_gb = rates(SIZE, "FIXED_COROTATED", threads=threads, turns=options.rounds, particles=size)
            too_much = size == SIZES[-1] and not memory_gb <= MOST_MEMORY_GB
            speed = statistics.median(found.get("FIXED_COROTATED", [math.nan]))
            print(f"  {size:10,d} {speed:8.2f} {memory_gb:6.2f}  {f'over {MOST_MEMORY_GB}' if too_much else ''}")
            missed |= too_much
    return missed


def floor_table(options: argparse.Namespace) -> bool:
    """One core as a share of what its arithmetic would allow; True if a law uses too little of it."""
    found, _ = rates(FLOOR, str(REFERENCE_FOLDER), *FLOOR_LIMITS, threads=1, turns=options.rounds)
    if not found:
        return True
    gflops = found.pop("sgemm")
    median = statistics.median(gflops)
    print(f"\none core: sgemm {median:.0f} GFLOP/s, so {median / FLOOR_KFLOP:.1f} M/s at most; M/s, share of that")
    missed = False
    for name, ours in found.items():
        share = median_share(ours, gflops, 1 / FLOOR_KFLOP)
        note, slow = judged(share, FLOOR_LIMITS.get(name, 0.0))
        print(f"  {name:30s} {statistics.median(ours):8.3f} {share:7.3f}  {note}")
        missed |= slow
    return missed


def main() -> int:
    """Run all, print rates and ratios; 1 if something misses its limit."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--prototype-dir", type=Path, default=SHARED / "prototypes/mpm")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--laws", nargs="+", choices=LIMITS, default=list(LIMITS), metavar="LAW")
    parser.add_argument("--only", nargs="+", choices=SECTIONS, default=list(SECTIONS))
    options = parser.parse_args()
    missed = False
    if "laws" in options.only:
        with tempfile.TemporaryDirectory() as scratch:
            missed |= laws_table(options, scratch)
        missed |= speedup_line(options)
    if "sizes" in options.only:
        missed |= sizes_table(options)
    if "floor" in options.only:
        missed |= floor_table(options)
    if "compile" in options.only:
        missed |= compile_table(options)
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
