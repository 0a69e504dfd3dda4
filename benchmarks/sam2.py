"""Time and memory of SAM2 at its real size, with random weights, which cost what trained ones cost.

    python benchmarks/sam2.py                                  # Hiera-tiny; some five minutes on two idle cores
    python benchmarks/sam2.py --views 29 --objects 5 --encode 29

Beside wall-clock seconds stand those of the processor, which other work on the machine disturbs less, and what
``grouping/sam2/cost.py`` predicts. Skipped without torch and transformers.
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

SIZE_PX = 512


class Clock:
    """Seconds since it was made, of the wall and of the processor."""

    def __init__(self) -> None:
        self.wall, self.processor = time.perf_counter(), time.process_time()

    def per(self, count: int) -> str:
        """Both, for one of ``count`` steps."""
        wall, processor = time.perf_counter() - self.wall, time.process_time() - self.processor
        return f"{wall / count:6.2f} s (processor {processor / count:6.2f} s)"


def peak_gb() -> float:
    """Largest resident memory of this process so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6


def tell(what: str, took: str, predicted_s: float) -> None:
    """One line of the result."""
    print(f"{what:26} {took}, predicted {predicted_s:.2f} s; peak {peak_gb():.2f} GB", flush=True)


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--views", type=int, default=9, help="views that objects are followed through")
    parser.add_argument("--encode", type=int, default=2, help="views that are really encoded; the others repeat them")
    parser.add_argument("--objects", type=int, nargs="+", default=[1])
    parser.add_argument("--threads", type=int, default=0, help="of PyTorch; 0 for its own choice")
    options = parser.parse_args()
    if any(importlib.util.find_spec(name) is None for name in ("torch", "transformers")):
        print("skipped: torch and transformers are not installed (pip install 'phys4dgen[models]')")
        return 0

    import torch
    from transformers import Sam2VideoConfig, Sam2VideoModel

    from phys4dgen.grouping.sam2.cost import predicted_cost
    from phys4dgen.grouping.sam2.network import Sam2Network, Sam2Segmenter
    from phys4dgen.grouping.sam2.proposals import DEFAULT_CHOICE

    if options.threads:
        torch.set_num_threads(options.threads)
    rng = np.random.default_rng(0)
    frames = rng.integers(0, 256, (options.encode, SIZE_PX, SIZE_PX, 3), np.uint8)
    region = np.zeros((SIZE_PX, SIZE_PX), np.bool_)
    region[128:384, 192:320] = True
    with tempfile.TemporaryDirectory() as folder:
        Sam2VideoModel(Sam2VideoConfig()).save_pretrained(folder)
        network = Sam2Network(Path(folder))
        cost = predicted_cost(Path(folder), "cpu")
    print(f"{torch.get_num_threads()} threads; peak {peak_gb():.2f} GB with the weights loaded", flush=True)
    with torch.no_grad():  # untrained, it says of everything that it is not there
        network.model.mask_decoder.pred_obj_score_head.proj_out.bias.fill_(5.0)

    clock = Clock()
    segmenter = Sam2Segmenter(network, frames)
    tell("encode one view", clock.per(options.encode), cost.view_s)
    held = sum(tensor.nbytes for view in segmenter.features for tensor in view) / options.encode
    print(f"{held / 1e6:.1f} MB of features are held per view", flush=True)

    clock = Clock()
    segmenter.propose(0, region)
    tell("masks of one prompt", clock.per(len(DEFAULT_CHOICE.grid(region))), cost.prompt_s)

    segmenter.features = [segmenter.features[view % options.encode] for view in range(options.views)]
    for count in options.objects:
        steps = segmenter.track(0, [np.roll(region, 40 * k, 1) for k in range(count)])
        next(steps)
        clock, last = Clock(), Clock()
        for view, _ in steps:
            if view == options.views - 2:
                last = Clock()
        tell(f"{count} followed, mean of views", clock.per(count * (options.views - 1)), cost.step_s)
        tell(f"{count} followed, last view", last.per(count), cost.step_s)
    return 0


if __name__ == "__main__":
    sys.exit(main())
