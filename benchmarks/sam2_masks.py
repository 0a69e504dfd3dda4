"""How well masks become parts, and how well names on a picture find them, over the bundled objects.

    python benchmarks/sam2_masks.py                  # all objects
    python benchmarks/sam2_masks.py snowman hammer

No network runs. First table: a double of SAM2 that knows the truth, with 10 % wrong pixels, ids that go over to another
part (15 % of all directions), ids lost behind the object, and 120 views from random directions (tests/sam2_oracle.py).
Second: names on a picture in three other lights, up to 20 deg from the front, by the stand-in for CLIP. Exit code 1
when a mean misses its limit.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from phys4dgen.grouping.correspondence import name_parts_by_picture
from phys4dgen.zoo.catalogue import BUNDLED
from test_clip_names import Correspondence
from test_sam2_masks import Scenario, accuracy

LIGHTS = ("overcast", "evening", "backlit")


def masks_become_parts(names: list[str]) -> bool:
    """The first table; whether the limits are met."""
    scores, joined, extra = [], 0, 0
    print("object           right, visible / all   parts true / found   ids   switches   joined again")
    for name in names:
        scenario = Scenario(name, count=120, size_px=128)
        parts, segments, meaning = scenario.parts()
        truth = scenario.object.labels
        known = truth >= 0
        scores.append(accuracy(parts.labels, truth, known & (parts.visible if parts.visible is not None else known)))
        whole = accuracy(parts.labels, truth, known)
        found, all_of = scenario.merged_share(meaning)
        joined, extra = joined + found, extra + all_of
        print(
            f"{name:16} {scores[-1]:.3f} / {whole:.3f} {'':10} {truth.max() + 1} / {parts.count} {'':14} "
            f"{segments.id_count:3}   {scenario.oracle.switched:3} {'':8} {found} of {all_of}",
            flush=True,
        )
    print(f"mean {np.mean(scores):.3f}, least {min(scores):.3f}; joined again {joined} of {extra}")
    return bool(np.mean(scores) >= 0.95) and joined >= 0.9 * extra


def names_find_parts(names: list[str]) -> bool:
    """The second table; whether the limit is met."""
    rng = np.random.default_rng(0)
    right = total = 0
    margins = []
    for name in names:
        line = []
        for light in LIGHTS:
            case = Correspondence(name, light, rng.uniform(-20, 20), 10 + rng.uniform(-20, 20))
            found, _ = name_parts_by_picture(case.named, case.views, case.part_maps)
            good = [n.part is not None and case.part_names[n.part] == n.name for n in found]
            margins += [n.margin for n in found]
            line.append(f"{light} {sum(good)}/{len(good)}")
            right, total = right + sum(good), total + len(good)
        print(f"{name:16} {', '.join(line)}", flush=True)
    print(f"names at the right part: {right} of {total}; median margin {np.median(margins):.2f}")
    return right >= 0.9 * total


def main(names: list[str]) -> int:
    """Both tables."""
    names = names or list(BUNDLED)
    ok = [masks_become_parts(names), names_find_parts(names)]
    return 0 if all(ok) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
