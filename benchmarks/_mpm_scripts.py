"""What runs in the processes of ``mpm.py``: each script measures one thing or several in turn and prints the rates.

Arguments of the scripts that measure rates: threads, turns, particles, and what the script says. They print a line
"RATE name value" for each turn of each competitor, and "MEMORY GB", the most that the process held.
"""

from __future__ import annotations

__all__ = ["COLD_START", "COMPILE", "FLOOR", "LAWS", "SIZE", "SPEEDUP", "TAICHI"]

_SCENE = """
import sys, time
import numpy as np
threads, turns, P, *more = int(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), *sys.argv[4:]
rng = np.random.default_rng(0)
cells = min(round(64 * (P / 100_000) ** (1 / 3)), 128)
x = 1 / 3 + rng.random((P, 3)) / 3
d = x - 0.5
v = np.stack([-3 * d[:, 1] + 6 * d[:, 2], 3 * d[:, 0], 0 * d[:, 0]], 1)
volume = (1 / 3) ** 3 / P
mu, lam = 1e5 / 2.6, 3e4 / (1.3 * 0.4)
one = np.ones(P)
def in_turn(competitors):  # by name: what to run, and how many millions of what are counted that does
    for run, _ in competitors.values():
        run()
    for _ in range(turns):
        for name, (run, millions) in competitors.items():
            start = time.perf_counter()
            run()
            print("RATE", name, millions / (time.perf_counter() - start))
    import resource
    print("MEMORY", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9)
"""

_PRODUCT = """
import numba
from phys4dgen.mpm import Body, LawId, Settings, Simulator
def product(law, threads):  # segments of 50 substeps of dt 5e-5, sorting and checks included, frames' diagnostics not
    numbers = {
        "yield_stress_pa": 2e3, "hardening_modulus_pa": 2e4, "friction_angle_deg": 30.0, "viscosity_pas": 20.0,
        "critical_compression": 0.025, "critical_stretch": 0.0075, "hardening_coefficient": 10.0,
        "consistency_pasn": 20.0, "flow_exponent": 0.5,
    }
    body = Body(x, volume * one, 1e3 * one, 1e5 * one, 0.3 * one, np.full(P, LawId[law]), 0 * one, 0 * one, ("cube",),
                v, law_numbers={name: value * one for name, value in numbers.items()})
    simulator = Simulator(body, Settings(1 / cells, 0.01, gravity_ms2=(0, 0, -9.8), chunks=threads))
    def run():
        numba.set_num_threads(threads)
        for _ in range(2):
            simulator._segment(5e-5 * np.arange(51), 5e-5)
            simulator._inspect(frame=1, time_s=0.0)
            if not simulator._grid.holds(simulator._extent):
                simulator._grid = simulator._lay_grid(frame=1, time_s=0.0)
    return run, P * 100 / 1e6
"""

LAWS = (
    _SCENE
    + _PRODUCT
    + """
competitors = {law: product(law, threads) for law in more[1:]}
if more[0]:
    sys.path.insert(0, more[0])
    import mpm_numba
    solver = mpm_numba.Solver(x.astype(np.float32), v.astype(np.float32), volume, 1e3 * volume, mu, lam, 1e9, 0.0, 0.0,
                              n=64, dt=5e-5, chunks=threads, every=50)
    def prototype():
        numba.set_num_threads(threads)
        solver.run(100)
    competitors["prototype"] = prototype, P * 100 / 1e6
in_turn(competitors)
"""
)
"""More arguments: folder of the prototype or nothing, laws."""

SPEEDUP = _SCENE + _PRODUCT + 'in_turn({"one": product(more[0], 1), "two": product(more[0], 2)})\n'
"""More arguments: a law."""

SIZE = _SCENE + _PRODUCT + "in_turn({more[0]: product(more[0], threads)})\n"
"""More arguments: a law."""

FLOOR = (
    _SCENE
    + _PRODUCT
    + """
a, b = rng.random((2, 1536, 1536), np.float32)
competitors = {"sgemm": (lambda: [a @ b for _ in range(4)], 4 * 2 * 1536**3 / 1e9)}
competitors |= {law: product(law, threads) for law in more[1:]}
sys.path.insert(0, more[0])
import mpm_reference
P = 10_000
part = slice(P)
reference = mpm_reference.Reference(
    x[part], v[part], 1e3 * volume * one[part], volume * one[part], mu * one[part], lam * one[part],
    one[part].astype(int), dx=1 / cells, origin=(0, 0, 0), nodes=(cells,) * 3,
)
competitors["reference"] = lambda: reference.substep(5e-5), P / 1e6
in_turn(competitors)
"""
)
"""More arguments: folder of the float64 reference, laws. The rate of sgemm is in GFLOP/s."""

TAICHI = (
    _SCENE
    + _PRODUCT
    + """
import taichi as ti
from importlib.util import find_spec
from pathlib import Path
source = Path(find_spec("taichi").origin).parent / "examples/ggui_examples/mpm3d_ggui.py"
text = source.read_text()
kernels = text[: text.index("def init(")]  # fields and the substep kernel; the rest opens a window
kernels = kernels.replace("ti.init(arch=ti.cuda)", "ti.init(arch=ti.cpu, cpu_max_num_threads=threads)")
kernels = kernels.replace("ti.init(arch=ti.gpu)", "ti.init(arch=ti.cpu, cpu_max_num_threads=threads)")
path = Path(more[0]) / "taichi_example.py"
path.write_text(f"threads = {threads}\\n" + kernels)
sys.path.insert(0, more[0])
import taichi_example as example
competitors = {law: product(law, threads) for law in more[1:]}
P = example.n_particles
example.F_x.from_numpy((0.3 + 0.4 * rng.random((P, 3))).astype(np.float32))
example.F_dg.from_numpy(np.tile(np.eye(3, dtype=np.float32), (P, 1, 1)))
example.F_used.fill(1)
example.F_materials.fill(1)
def run():
    for _ in range(5):
        example.substep(0.0, -9.8, 0.0)
    ti.sync()
competitors["Taichi"] = run, P * 5 / 1e6
in_turn(competitors)
"""
)
"""More arguments: a folder to write to, laws."""

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
