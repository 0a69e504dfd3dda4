"""Make ``tests/data/sam2_reference.npz``: what the official SAM2 processor does to a small picture and a mask.

    python -m venv reference && reference/bin/pip install torch==2.14.1 torchvision==0.29.1 transformers==5.23.0 pillow
    reference/bin/python scripts/sam2_reference.py

It is run once, in an environment of its own, because the processor needs a torchvision that fits its torch; the tests
need neither. The picture is drawn by the script, so the file holds nothing of others.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

OUT = Path(__file__).parents[1] / "tests" / "data" / "sam2_reference.npz"
SIZE = 32
"""Of the network's input; real ones take 1024."""


def picture() -> np.ndarray:
    """Edges, a gradient and fine stripes: what resizing treats differently."""
    y, x = np.mgrid[:40, :56]
    rgb = np.stack([x * 4, y * 6, (x + y) % 2 * 255], -1).astype(np.uint8)
    rgb[(x - 20) ** 2 + (y - 18) ** 2 < 90] = (250, 20, 60)
    return rgb


def main() -> None:
    """Run the processor and store the result."""
    import torch
    from transformers import Sam2VideoModel, Sam2VideoProcessor  # noqa: F401  the processor's own module needs both
    from transformers.models.sam2.image_processing_sam2 import Sam2ImageProcessor
    from transformers.models.sam2_video.video_processing_sam2_video import Sam2VideoVideoProcessor

    rgb = picture()
    size = {"height": SIZE, "width": SIZE}
    image_processor = Sam2ImageProcessor(size=size, mask_size=size)
    processor = Sam2VideoProcessor(image_processor, Sam2VideoVideoProcessor(size=size))
    session = processor.init_video_session(video=[rgb], inference_device="cpu", dtype=torch.float32)
    pixels = session.get_frame(0)
    mask = (rgb[..., 0] == 250) & (rgb[..., 1] == 20)
    processor.add_inputs_to_inference_session(session, frame_idx=0, obj_ids=[1], input_masks=torch.from_numpy(mask))
    prompt = session.mask_inputs_per_obj[0][0]
    OUT.parent.mkdir(exist_ok=True)
    np.savez_compressed(
        OUT,
        rgb=rgb,
        pixels=pixels.numpy().astype(np.float16),
        mask=mask,
        prompt=prompt.numpy()[0, 0].astype(np.bool_),
    )
    print(OUT, OUT.stat().st_size, "bytes", tuple(pixels.shape), tuple(prompt.shape))


if __name__ == "__main__":
    main()
