"""A run's film as a small GIF, for pages that show no video.

python scripts/film_to_gif.py RUN OUT.gif [--width 320] [--every 2] [--colors 96]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from PIL import Image


def main() -> None:
    """Read RUN/video.mp4, crop what stays white, and write the GIF."""
    parser = argparse.ArgumentParser(description="A run's film as a small GIF.")
    parser.add_argument("run", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--width", type=int, default=320, help="pixels")
    parser.add_argument("--every", type=int, default=2, help="take every so many frames")
    parser.add_argument("--colors", type=int, default=96, help="in the palette")
    options = parser.parse_args()
    reader = imageio_ffmpeg.read_frames(str(options.run / "video.mp4"))
    facts = next(reader)
    width, height = facts["size"]
    frames = [np.frombuffer(frame, np.uint8).reshape(height, width, 3) for frame in reader][:: options.every]
    drawn = (np.stack(frames) < 250).any((0, 3))
    rows, columns = np.flatnonzero(drawn.any(1)), np.flatnonzero(drawn.any(0))
    box = (columns[0], rows[0], columns[-1] + 1, rows[-1] + 1)
    size = (options.width, round(options.width * (box[3] - box[1]) / (box[2] - box[0])))
    pictures = [Image.fromarray(frame).crop(box).resize(size, Image.Resampling.LANCZOS) for frame in frames]
    # One palette for all frames: palettes of their own would make still parts flicker.
    strip = Image.new("RGB", (size[0], size[1] * len(pictures)))
    for k, picture in enumerate(pictures):
        strip.paste(picture, (0, k * size[1]))
    palette = strip.quantize(options.colors)
    shown = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    shown[0].save(
        options.out,
        save_all=True,
        append_images=shown[1:],
        duration=round(1000 * options.every / facts["fps"]),
        loop=0,
        optimize=True,
    )


if __name__ == "__main__":
    main()
