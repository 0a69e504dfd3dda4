"""Time and memory of SAM2 at its real size, with random weights, which cost what trained ones cost.

    python benchmarks/sam2.py                       # Hiera-tiny, 9 views, 1 and 3 objects; about ten minutes
    python benchmarks/sam2.py --views 29 --objects 5

Says what ``grouping/sam2/cost.py`` predicts beside what it took. Skipped without torch and transformers.
"""

from __future__ import annotations

import argparse
import importlib.util
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np


def peak_gb() -> float:
    """Largest resident memory of this process so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--views", type=int, default=9)
    parser.add_argument("--objects", type=int, nargs="+", default=[1, 3])
    options = parser.parse_args()
    if any(importlib.util.find_spec(name) is None for name in ("torch", "transformers")):
        print("skipped: torch and transformers are not installed (pip install 'phys4dgen[models]')")
        return 0

    import torch
    from transformers import Sam2VideoConfig, Sam2VideoModel

    from phys4dgen.grouping.sam2.cost import predicted_cost
    from phys4dgen.grouping.sam2.network import Sam2Network, Sam2Segmenter
    from phys4dgen.grouping.sam2.proposals import DEFAULT_CHOICE

    size_px = 512
    rng = np.random.default_rng(0)
    frames = rng.integers(0, 256, (options.views, size_px, size_px, 3), np.uint8)
    region = np.zeros((size_px, size_px), np.bool_)
    region[128:384, 192:320] = True
    with tempfile.TemporaryDirectory() as folder:
        Sam2VideoModel(Sam2VideoConfig()).save_pretrained(folder)
        start = time.perf_counter()
        network = Sam2Network(Path(folder))
        seconds = time.perf_counter() - start
        print(f"load    {seconds:6.2f} s, {torch.get_num_threads()} threads, peak {peak_gb():.2f} GB")
        cost = predicted_cost(Path(folder), "cpu")
    with torch.no_grad():  # untrained, it says of everything that it is not there
        network.model.mask_decoder.pred_obj_score_head.proj_out.bias.fill_(5.0)

    start = time.perf_counter()
    segmenter = Sam2Segmenter(network, frames)
    seconds = (time.perf_counter() - start) / options.views
    held = sum(tensor.nbytes for view in segmenter.features for tensor in view) / options.views
    print(f"encode  {seconds:6.2f} s per view (predicted {cost.view_s:.2f}), {held / 1e6:.1f} MB held per view, "
          f"peak {peak_gb():.2f} GB", flush=True)  # fmt: skip

    prompts = len(DEFAULT_CHOICE.grid(region))
    start = time.perf_counter()
    segmenter.propose(0, region)
    seconds = (time.perf_counter() - start) / prompts
    print(f"prompt  {seconds:6.2f} s per point (predicted {cost.prompt_s:.2f}), peak {peak_gb():.2f} GB", flush=True)

    for count in options.objects:
        masks = [np.roll(region, 40 * k, 1) for k in range(count)]
        times = [time.perf_counter()]
        for _ in segmenter.track(0, masks):
            times.append(time.perf_counter())
        steps = np.diff(times) / count
        told = f"first {steps[1]:.2f}, last {steps[-1]:.2f}, predicted {cost.step_s:.2f}"
        print(f"follow  {steps[1:].mean():6.2f} s per object, view ({told}), {count} objects, peak {peak_gb():.2f} GB",
              flush=True)  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
