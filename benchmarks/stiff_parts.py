"""The paper's own stiff parts, simulated: ``python benchmarks/stiff_parts.py [OUT]``.

The potted flower with a pot of 10^9.3 Pa and petals of plastic (1 GPa, the failure that the paper reports), and the
snowman with a hat of 5e7 Pa at 200 kg/m3 (the answers of its model, appendix). Printed is what the report says about
each: taken as it is, softened where that cannot be seen, or rigid. Exit code 1 where a film does not come to its end or
a stiff part is in the report neither way.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from phys4dgen.run.demo import prepare_demo
from phys4dgen.run.generate import continue_run, generate

CASES: dict[str, dict[str, dict[str, float]]] = {
    "potted_flower": {
        "pot": {"youngs_modulus_pa": 10**9.3},
        "petals": {"youngs_modulus_pa": 1e9, "density_kgm3": 1050.0},
    },
    "snowman": {"hat": {"youngs_modulus_pa": 5e7, "density_kgm3": 200.0}},
}


def main() -> int:
    """Run both and tell."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, nargs="?", help="folder for the runs (default: a temporary one)")
    parser.add_argument("--duration-s", type=float, default=1.0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        out = options.out or Path(scratch)
        missed = [told(name, stiff, out / name, duration_s=options.duration_s) for name, stiff in CASES.items()]
    return int(any(missed))


def told(name: str, stiff: dict[str, dict[str, float]], folder: Path, *, duration_s: float) -> bool:
    """Simulate one object and print what became of its stiff parts; True if something is missing."""
    scene = prepare_demo(folder, name=name).with_overrides({"simulation.duration_s": duration_s})
    generate(scene, folder, until="materials")
    yaml = YAML()
    materials = folder / "materials.yaml"
    tree = yaml.load(materials)
    for part, numbers in stiff.items():
        for side in tree["parts"][part].values():
            side.update(numbers)
    yaml.dump(tree, materials)
    report: dict[str, Any] = dict(continue_run(folder, since="simulate", until="simulate").report)
    motion = report["simulation"]
    frames = report["counts"]["frames"]
    held = str(report["motion"]["held"])
    print(f"{name}: {frames} frames; {report['seconds']['simulate']:.0f} s; {held}")
    silent = False
    for part, numbers in stiff.items():
        said = [
            text for text in report["warnings"] if f"Part '{part}'" in text and ("E = " in text or "deform" in text)
        ]
        if part in held:
            said.append("held: it does not move, so its stiffness asks for nothing")
        silent |= not said and not any(part in str(entry) for entry in motion["thickening"])
        print(f"  {part} {numbers['youngs_modulus_pa']:.2g} Pa: {' '.join(said) or 'simulated as it is'}")
    return silent or frames != scene.frame_count


if __name__ == "__main__":
    sys.exit(main())
