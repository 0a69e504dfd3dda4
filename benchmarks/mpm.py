"""Speed of the MPM engine in million particle-substeps per second, law by law, beside its prototype and Taichi.

    python benchmarks/mpm.py [--prototype-dir ../shared/prototypes/mpm] [--rounds 3] [--threads 1 2] [--laws LAW ...]
                             [--only laws|sizes|floor|compile]

The scene is that of the prototype: a cube a third of the domain wide, 100,000 random particles, 64 cells along the
domain, dt 5e-5 s. Every competitor runs in a process of its own, in turn, ``rounds`` times; the best round counts, so
that a busy machine disturbs all alike. Compilation is not counted in the rates. It is measured once, in processes with
an empty cache: what all laws share, each law, and a whole scene of three laws up to its first frame, cold and then with
the cache warm; its limits are held against CPU time, which is the waiting time on an idle machine. What is missing is
skipped, with the reason. Plastic materials are weak enough to flow in most particles.

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
import subprocess
import sys
import tempfile
import time
from pathlib import Path

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
SIZES = (20_000, 100_000, 400_000, 1_000_000)
MOST_MEMORY_GB = 1.2
"""For a million particles in a domain of 128 cells."""
COLD_START_LIMITS_S = {"cold": 30.0, "warm": 2.0}
"""Of a scene of three laws, from the start of the process to the first frame, CPU time."""
SECTIONS = ("laws", "sizes", "floor", "compile")
SHARED = Path(__file__).resolve().parents[2] / "shared"
REFERENCE_FOLDER = Path(__file__).resolve().parents[1] / "tests/reference"
PROTOTYPE_NAME = "prototype, fixed corotated"
TAICHI_NAME = "Taichi mpm3d_ggui, ti.cpu"

SCENE = """
import sys, time
import numpy as np
threads, seconds = int(sys.argv[1]), float(sys.argv[2])
rng = np.random.default_rng(0)
P = int(sys.argv[4]) if len(sys.argv) > 4 else 100_000
cells = min(round(64 * (P / 100_000) ** (1 / 3)), 128)
x = 1 / 3 + rng.random((P, 3)) / 3
d = x - 0.5
v = np.stack([-3 * d[:, 1] + 6 * d[:, 2], 3 * d[:, 0], 0 * d[:, 0]], 1)
volume = (1 / 3) ** 3 / P
def report(run, substeps):
    run()
    best, end = 1e30, time.perf_counter() + seconds
    while time.perf_counter() < end:
        start = time.perf_counter()
        run()
        best = min(best, time.perf_counter() - start)
    import resource
    print("MEMORY", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9)
    print("RATE", P * substeps / best / 1e6)
"""

PRODUCT = (
    SCENE
    + """
import numba
from phys4dgen.mpm import Body, LawId, Settings, Simulator
numba.set_num_threads(threads)
one = np.ones(P)
law = LawId[sys.argv[3]]
numbers = {
    "yield_stress_pa": 2e3, "hardening_modulus_pa": 2e4, "friction_angle_deg": 30.0, "viscosity_pas": 20.0,
    "critical_compression": 0.025, "critical_stretch": 0.0075, "hardening_coefficient": 10.0,
    "consistency_pasn": 20.0, "flow_exponent": 0.5,
}
body = Body(x, volume * one, 1e3 * one, 1e5 * one, 0.3 * one, np.full(P, law), 0 * one, 0 * one, ("cube",), v,
            law_numbers={name: value * one for name, value in numbers.items()})
settings = Settings(1 / cells, 0.01, gravity_ms2=(0, 0, -9.8), chunks=threads)
substeps = 200
simulator = Simulator(body, settings)
def run():  # segments of 50 substeps of dt 5e-5, sorting and checks included, frames' diagnostics not
    for _ in range(substeps // 50):
        simulator._segment(5e-5 * np.arange(51), 5e-5)
        simulator._inspect(frame=1, time_s=0.0)
        if not simulator._grid.holds(simulator._extent):
            simulator._grid = simulator._lay_grid(frame=1, time_s=0.0)
report(run, substeps)
"""
)

SGEMM = """
import sys, time
import numpy as np
a, b = np.random.default_rng(0).random((2, 1536, 1536), np.float32)
best, end = 1e30, time.perf_counter() + float(sys.argv[2])
while time.perf_counter() < end:
    start = time.perf_counter()
    a @ b
    best = min(best, time.perf_counter() - start)
print("RATE", 2 * 1536**3 / best / 1e9)
"""

REFERENCE = (
    SCENE
    + """
sys.path.insert(0, sys.argv[3])
import mpm_reference
mu, lam = 1e5 / 2.6, 3e4 / (1.3 * 0.4)
one = np.ones(P)
reference = mpm_reference.Reference(x, v, 1e3 * volume * one, volume * one, mu * one, lam * one, one.astype(int),
                                    dx=1 / cells, origin=(0, 0, 0), nodes=(cells,) * 3)
report(lambda: reference.substep(5e-5), 1)
"""
)

COMPILE = """
import sys, time
from phys4dgen.mpm.kernels.chunk_pass import address_of_chunk_pass
from phys4dgen.mpm.kernels.grid_pass import address_of_grid_plane
from phys4dgen.mpm.kernels.law_step import address_of_law
from phys4dgen.mpm.kernels.particle_pass import address_of_pass
from phys4dgen.mpm.laws import LAWS, LawId
shared = {"grid": address_of_grid_plane, "particle pass": address_of_pass, "chunk": address_of_chunk_pass}
laws = {name: lambda name=name: address_of_law(LAWS[LawId[name]]) for name in sys.argv[1:]}
for name, compile in (shared | laws).items():
    start = time.process_time()
    compile()
    print("TIME", time.process_time() - start, name)
"""

COLD_START = """
import time
import numpy as np
from phys4dgen.mpm import Body, LawId, Settings, Simulator
P = 3000
one = np.ones(P)
law = np.resize([LawId.FIXED_COROTATED, LawId.VON_MISES, LawId.DRUCKER_PRAGER], P).astype(np.int32)
numbers = {"yield_stress_pa": 2e3 * one, "friction_angle_deg": 30 * one}
body = Body(np.random.default_rng(0).random((P, 3)) / 10, 1e-3 / P * one, 1e3 * one, 1e5 * one, 0.3 * one, law, 0 * one,
            0 * one, ("cube",), law_numbers=numbers)
Simulator(body, Settings(0.01, 0.01, gravity_ms2=(0, 0, -9.8), chunks=2)).advance()
print("TIME", time.process_time(), "CPU")
"""

PROTOTYPE = (
    SCENE
    + """
sys.path.insert(0, sys.argv[3])
import numba
import mpm_numba
numba.set_num_threads(threads)
mu, lam = 1e5 / 2.6, 3e4 / (1.3 * 0.4)
solver = mpm_numba.Solver(x.astype(np.float32), v.astype(np.float32), volume, 1e3 * volume, mu, lam, 1e9, 0.0, 0.0,
                          n=64, dt=5e-5, chunks=threads, every=50)
report(lambda: solver.run(200), 200)
"""
)

TAICHI = (
    SCENE
    + """
import taichi as ti
from importlib.util import find_spec
from pathlib import Path
source = Path(find_spec("taichi").origin).parent / "examples/ggui_examples/mpm3d_ggui.py"
text = source.read_text()
kernels = text[: text.index("def init(")]  # fields and the substep kernel; the rest opens a window
kernels = kernels.replace("ti.init(arch=ti.cuda)", "ti.init(arch=ti.cpu, cpu_max_num_threads=threads)")
kernels = kernels.replace("ti.init(arch=ti.gpu)", "ti.init(arch=ti.cpu, cpu_max_num_threads=threads)")
path = Path(sys.argv[3]) / "taichi_example.py"
path.write_text(f"threads = {threads}\\n" + kernels)
sys.path.insert(0, sys.argv[3])
import taichi_example as example
P = example.n_particles
state = np.random.default_rng(0)
example.F_x.from_numpy((0.3 + 0.4 * state.random((P, 3))).astype(np.float32))
example.F_dg.from_numpy(np.tile(np.eye(3, dtype=np.float32), (P, 1, 1)))
example.F_used.fill(1)
example.F_materials.fill(1)
def run():
    for _ in range(5):
        example.substep(0.0, -9.8, 0.0)
    ti.sync()
report(run, 5)
"""
)


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


def rate(script: str, *arguments: str, threads: int) -> tuple[float, float] | str:
    """Rate and peak memory (GB) that a script reports in a process of its own, or the last line of what went wrong."""
    environment = dict(os.environ, NUMBA_NUM_THREADS=str(max(2, threads)), PYTHONWARNINGS="ignore")
    environment |= dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), str(threads))
    command = [sys.executable, "-c", script, str(threads), *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=1200, check=False)
    found = dict(line.split() for line in done.stdout.splitlines() if line.startswith(("RATE ", "MEMORY ")))
    if "RATE" in found:
        return float(found["RATE"]), float(found.get("MEMORY", "nan"))
    return (done.stderr.strip().splitlines() or ["no output"])[-1]


def best_rates(runners: dict[str, tuple[str, ...]], *, threads: int, rounds: int) -> dict[str, tuple[float, float]]:
    """Best rate and largest memory of each, all in turn."""
    best: dict[str, tuple[float, float]] = {}
    for _ in range(rounds):
        for name, (script, *arguments) in runners.items():
            value = rate(script, *arguments, threads=threads)
            if isinstance(value, str):
                print(f"{name}: failed: {value}")
            else:
                before = best.get(name, (0.0, 0.0))
                best[name] = max(before[0], value[0]), max(before[1], value[1])
    return best


def judged(value: float, least: float) -> tuple[str, bool]:
    """A note for the table, and whether a limit is missed."""
    return (f"below {least:g}", True) if value < least else ("", False)


def laws_table(options: argparse.Namespace, scratch: str) -> bool:
    """Every law beside the prototype and Taichi, and two threads over one; True if something is too slow."""
    seconds = str(options.seconds)
    runners: dict[str, tuple[str, ...]] = {law: (PRODUCT, seconds, law) for law in options.laws}
    if (options.prototype_dir / "mpm_numba.py").is_file():
        copy = Path(scratch) / "prototype"  # its folder may be read-only, and Numba caches beside the source
        copy.mkdir()
        for source in options.prototype_dir.glob("*.py"):
            (copy / source.name).write_text(source.read_text())
        runners[PROTOTYPE_NAME] = (PROTOTYPE, seconds, str(copy))
    else:
        print(f"prototype: skipped, no mpm_numba.py in {options.prototype_dir}")
    if importlib.util.find_spec("taichi"):
        runners[TAICHI_NAME] = (TAICHI, seconds, scratch)
    else:
        print("Taichi: skipped, not installed (pip install 'phys4dgen[bench]')")
    missed = False
    fixed_corotated: dict[int, float] = {}
    for threads in options.threads:
        best = best_rates(runners, threads=threads, rounds=options.rounds)
        base = best.get(PROTOTYPE_NAME, (float("nan"), 0.0))[0]
        print(f"\n{threads} thread{'s' if threads > 1 else ''}: million particle-substeps/s, share of the prototype's")
        for name, (value, _) in best.items():
            note, slow = judged(value / base, LIMITS.get(name, 0.0))
            print(f"  {name:30s} {value:8.2f} {value / base:6.2f}  {note}")
            missed |= slow
        if "FIXED_COROTATED" in best:
            fixed_corotated[threads] = best["FIXED_COROTATED"][0]
            if TAICHI_NAME in best:
                ratio = fixed_corotated[threads] / best[TAICHI_NAME][0]
                note, slow = judged(ratio, LEAST_OVER_TAICHI if threads == 2 else 0.0)
                print(f"  fixed corotated over Taichi    {ratio:8.1f}         {note}")
                missed |= slow
    if {1, 2} <= fixed_corotated.keys():
        ratio = fixed_corotated[2] / fixed_corotated[1]
        note, slow = judged(ratio, LEAST_SPEEDUP)
        print(f"\ntwo threads over one, fixed corotated: {ratio:.2f}  {note}")
        missed |= slow
    return missed


def sizes_table(options: argparse.Namespace) -> bool:
    """Fixed corotated from 20,000 to a million particles; True if a million take too much memory."""
    runners = {f"{size}": (PRODUCT, str(options.seconds), "FIXED_COROTATED", str(size)) for size in SIZES}
    missed = False
    for threads in options.threads:
        best = best_rates(runners, threads=threads, rounds=options.rounds)
        print(f"\nfixed corotated, {threads} thread{'s' if threads > 1 else ''}: particles, M/s, most memory in GB")
        for name, (value, memory_gb) in best.items():
            too_much = int(name) == SIZES[-1] and memory_gb > MOST_MEMORY_GB
            print(f"  {int(name):10,d} {value:8.2f} {memory_gb:6.2f}  {f'over {MOST_MEMORY_GB}' if too_much else ''}")
            missed |= too_much
    return missed


def floor_table(options: argparse.Namespace) -> bool:
    """One core as a share of what its arithmetic would allow; True if a law uses too little of it."""
    seconds = str(options.seconds)
    runners: dict[str, tuple[str, ...]] = {"sgemm": (SGEMM, seconds)}
    runners |= {law: (PRODUCT, seconds, law) for law in FLOOR_LIMITS}
    runners["float64 NumPy reference"] = (REFERENCE, seconds, str(REFERENCE_FOLDER), "10000")
    best = best_rates(runners, threads=1, rounds=options.rounds)
    if "sgemm" not in best:
        return True
    gflops = best.pop("sgemm")[0]
    floor = gflops / FLOOR_KFLOP
    print(f"\none core: sgemm {gflops:.0f} GFLOP/s, so {floor:.1f} M/s at most; M/s, share of that")
    missed = False
    for name, (value, _) in best.items():
        note, slow = judged(value / floor, FLOOR_LIMITS.get(name, 0.0))
        print(f"  {name:30s} {value:8.3f} {value / floor:7.3f}  {note}")
        missed |= slow
    return missed


def main() -> int:
    """Run all, print rates and ratios; 1 if something misses its limit."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--prototype-dir", type=Path, default=SHARED / "prototypes/mpm")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--laws", nargs="+", choices=LIMITS, default=list(LIMITS), metavar="LAW")
    parser.add_argument("--only", nargs="+", choices=SECTIONS, default=list(SECTIONS))
    options = parser.parse_args()
    missed = False
    if "laws" in options.only:
        with tempfile.TemporaryDirectory() as scratch:
            missed |= laws_table(options, scratch)
    if "sizes" in options.only:
        missed |= sizes_table(options)
    if "floor" in options.only:
        missed |= floor_table(options)
    if "compile" in options.only:
        missed |= compile_table(options)
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
