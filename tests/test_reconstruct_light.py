"""Colours freed of the light of the picture."""

import numpy as np
import pytest
import scipy.ndimage as nd

from phys4dgen.reconstruct.foreground import cut_out
from phys4dgen.reconstruct.inflate import InflateOptions, inflate
from phys4dgen.reconstruct.inflate.even_light import evenly_lit
from phys4dgen.types.color import lab_to_srgb, srgb_to_lab

SIZE = 160


def ball(paint_lab, light):
    """A ball of a colour [S, S, 3] under a light (x right, y up, z to the camera), its mask and its height."""
    y, x = np.mgrid[:SIZE, :SIZE] - (SIZE - 1) / 2
    radius = 0.4 * SIZE
    mask = x**2 + y**2 < radius**2
    height = np.sqrt(np.maximum(radius**2 - x**2 - y**2, 0))
    normal = np.stack([x, -y, height], -1) / radius
    lab = paint_lab + [1, 0, 0] * (20 * normal @ np.asarray(light, float))[..., None]
    return lab_to_srgb(lab).astype(np.float32), mask, height


def spread(rgb, mask):
    """Standard deviation of the colour inside, in Lab, without the outermost pixels."""
    inner = nd.binary_erosion(mask, iterations=4)
    return np.linalg.norm(srgb_to_lab(rgb)[inner].std(0))


@pytest.mark.parametrize("light", [(-0.8, 0.3, 0.5), (0.2, 0.9, 0.4)])
def test_a_ball_of_one_colour_under_a_lamp_becomes_one_colour(light):
    paint = np.broadcast_to([50.0, 20.0, 30.0], (SIZE, SIZE, 3))
    rgb, mask, height = ball(paint, light)
    even = evenly_lit(rgb, mask, height=height, segments=mask.astype(np.int64))
    assert spread(rgb, mask) > 6
    assert spread(even, mask) < 0.25 * spread(rgb, mask)
    np.testing.assert_array_equal(even[~mask], rgb[~mask])


def test_two_paints_stay_two_colours():
    paint = np.broadcast_to([50.0, 20.0, 30.0], (SIZE, SIZE, 3)).copy()
    paint[:, : SIZE // 2] = [60.0, -30.0, 20.0]
    rgb, mask, height = ball(paint, (-0.8, 0.3, 0.5))
    segments = np.where(np.arange(SIZE) < SIZE // 2, 1, 2) * mask
    even = srgb_to_lab(evenly_lit(rgb, mask, height=height, segments=segments))
    left, right = (np.median(even[segments == k], 0) for k in (1, 2))
    assert np.linalg.norm(left - right - [10, -50, -10]) < 12
    assert even[nd.binary_erosion(segments == 1, iterations=4)].std(0).max() < 4


def test_the_pot_of_the_cactus_is_of_one_colour(shared_data):
    images = shared_data / "images"
    cutout = cut_out(images / "cactus_pot_image.png", mask=images / "cactus_pot_mask.png")
    made = inflate(cutout, InflateOptions(front_gaussians=8000))
    low, high = made.gaussians.means[:, 1].min(), made.gaussians.means[:, 1].max()
    height = (made.gaussians.means[:, 1] - low) / (high - low)
    pot = (height > 0.1) & (height < 0.5)
    lit, even = srgb_to_lab(made.gaussians.base_colors[pot]), srgb_to_lab(made.even_colors[pot])
    assert even.std(0).max() < 0.5 * lit.std(0).max()
