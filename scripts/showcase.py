"""Run the scenes of examples/ and put stills of their films on one sheet.

python scripts/showcase.py OUT [NAME ...] [--sheet SHEET.jpg] [--tiles TILES.jpg] [--inputs FOLDER]

Every scene gets a run folder OUT/NAME; finished ones are kept, so that the sheet can be made again at once. The command
prints what each run took and ends with 1 when one of them failed. The sheet has four stills of each, the tiles one, the
least like the first. With a folder of inputs the scenes of examples/files/ are run as well, of those splats
and pictures of others that lie in it or one folder deeper.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from PIL import Image, ImageDraw, ImageFont
from ruamel.yaml import YAML

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
STILLS = 4
WIDTH_PX = 220
TALLEST_PX = 190
LABEL_PX = 18
GAP_PX = 10
TILE_PX = (190, 150)
TILES_A_ROW = 5
DRAWN = 240
"""Pixels darker than this in a channel show something; the ground and the rim of a shadow are lighter."""


def main() -> int:
    """Run what is not there yet, and make the sheet."""
    parser = argparse.ArgumentParser(description="Run the scenes of examples/ and put stills of them on one sheet.")
    parser.add_argument("out", type=Path, help="folder that gets one run folder per scene")
    parser.add_argument("names", nargs="*", metavar="NAME", help="scenes (default: all)")
    parser.add_argument("--sheet", type=Path, help="picture to write (default: OUT/showcase.jpg)")
    parser.add_argument("--tiles", type=Path, help="picture to write with one still of each scene")
    parser.add_argument("--inputs", type=Path, help="folder in which the inputs of examples/files/ are looked for")
    options = parser.parse_args()
    scenes = {path.stem: path for path in sorted(EXAMPLES.glob("*.yaml"))}
    if options.inputs is not None:
        scenes |= {path.stem: path for path in sorted((EXAMPLES / "files").glob("*.yaml"))}
    if unknown := set(options.names) - set(scenes):
        parser.error(f"no scene {', '.join(sorted(unknown))}; there are {', '.join(scenes)}")
    names = options.names or list(scenes)
    failed = [name for name in names if not _run(scenes[name], options.out / name, options.inputs)]
    rows = [_row(options.out / name, name) for name in names if name not in failed]
    if rows:
        sheet = options.sheet or options.out / "showcase.jpg"
        _stacked(rows).save(sheet, quality=82, optimize=True)
        print(sheet)
    if options.tiles is not None:
        _tiled([_tile(options.out / name, name) for name in names if name not in failed]).save(
            options.tiles, quality=84, optimize=True
        )
        print(options.tiles)
    return 1 if failed else 0


def _run(scene: Path, folder: Path, inputs: Path | None) -> bool:
    if (folder / "report.json").is_file() and (folder / "video.mp4").is_file():
        return True
    if scene.parent == EXAMPLES:
        what = ["demo"]
    elif (found := _input(scene, inputs)) is None:
        print(f"{scene.stem}: skipped, its input is not in {inputs}")
        return False
    else:
        what = ["generate", str(found)]
    command = [sys.executable, "-m", "phys4dgen", *what, "--scene", str(scene), "-o", str(folder)]
    start = time.perf_counter()
    done = subprocess.run([*command, "--output.frames", "none", "-q"], check=False, capture_output=True, text=True)
    seconds = time.perf_counter() - start
    said = f"{seconds:.0f} s" if done.returncode == 0 else f"failed: {done.stderr.strip()}"
    print(f"{scene.stem}: {said}", flush=True)
    return done.returncode == 0


def _input(scene: Path, inputs: Path | None) -> Path | None:
    """The file that a scene of examples/files/ names, where the user has it."""
    name = str(YAML(typ="safe").load(scene)["input"])
    places = [] if inputs is None else [inputs / name, *sorted(inputs.glob(f"*/{name}"))]
    return next((place for place in places if place.is_file()), None)


def _frames(folder: Path) -> np.ndarray:
    """All frames of a run's film, [T, H, W, 3]."""
    reader = imageio_ffmpeg.read_frames(str(folder / "video.mp4"))
    width, height = next(reader)["size"]
    return np.stack([np.frombuffer(frame, np.uint8).reshape(height, width, 3) for frame in reader])


def _drawn_box(frames: np.ndarray) -> tuple[int, int, int, int]:
    """Left, top, right and bottom of what frames [T, H, W, 3] show."""
    drawn = (frames < DRAWN).any((0, 3))
    columns, lines = np.flatnonzero(drawn.any(0)), np.flatnonzero(drawn.any(1))
    return int(columns[0]), int(lines[0]), int(columns[-1]) + 1, int(lines[-1]) + 1


def _row(folder: Path, name: str) -> Image.Image:
    """The scene's name over stills at even times, cropped to what the film shows."""
    frames = _frames(folder)
    shown = frames[np.linspace(0, len(frames) - 1, STILLS).round().astype(int)]
    box = _drawn_box(shown)
    scale = min(WIDTH_PX / (box[2] - box[0]), TALLEST_PX / (box[3] - box[1]))
    wide, tall = round(scale * (box[2] - box[0])), round(scale * (box[3] - box[1]))
    row = Image.new("RGB", (STILLS * WIDTH_PX, tall + LABEL_PX), "white")
    _write(row, name)
    for place, frame in enumerate(shown):
        still = Image.fromarray(frame).crop(box).resize((wide, tall), Image.Resampling.LANCZOS)
        row.paste(still, (place * WIDTH_PX + (WIDTH_PX - wide) // 2, LABEL_PX))
    return row


def _tile(folder: Path, name: str) -> Image.Image:
    """The scene's name over the frame that differs most from the first, at the scale that fills the tile."""
    frames = _frames(folder)
    change = [np.abs(frame.astype(np.int16) - frames[0]).mean() for frame in frames]
    frame = frames[int(np.argmax(change))]
    still = Image.fromarray(frame).crop(_drawn_box(frame[None]))
    still.thumbnail(TILE_PX, Image.Resampling.LANCZOS)
    tile = Image.new("RGB", (TILE_PX[0], TILE_PX[1] + LABEL_PX), "white")
    _write(tile, name)
    tile.paste(still, ((TILE_PX[0] - still.width) // 2, LABEL_PX + TILE_PX[1] - still.height))
    return tile


def _write(image: Image.Image, name: str) -> None:
    ImageDraw.Draw(image).text((4, 2), name.replace("_", " "), "black", ImageFont.load_default(13))


def _tiled(tiles: list[Image.Image]) -> Image.Image:
    """Tiles in rows of ``TILES_A_ROW``."""
    lines = -(-len(tiles) // TILES_A_ROW)
    width, height = tiles[0].width + GAP_PX, tiles[0].height + GAP_PX
    sheet = Image.new("RGB", (TILES_A_ROW * width - GAP_PX, lines * height - GAP_PX), "white")
    for number, tile in enumerate(tiles):
        line, place = divmod(number, TILES_A_ROW)
        sheet.paste(tile, (place * width, line * height))
    return sheet


def _stacked(rows: list[Image.Image]) -> Image.Image:
    """The rows in two columns of about the same height."""
    columns: list[list[Image.Image]] = [[], []]
    for row in rows:
        min(columns, key=lambda column: sum(image.height for image in column)).append(row)
    width = rows[0].width
    heights = [sum(image.height for image in column) for column in columns]
    sheet = Image.new("RGB", (2 * width + 12, max(heights)), "white")
    for number, column in enumerate(columns):
        top = 0
        for row in column:
            sheet.paste(row, (number * (width + 12), top))
            top += row.height
    return sheet


if __name__ == "__main__":
    sys.exit(main())
