"""The inflate stand-in: shapes that have an answer, and real pictures."""

import numpy as np
import pytest
import scipy.ndimage as nd

from phys4dgen.reconstruct.foreground import Cutout, cut_out
from phys4dgen.reconstruct.framing import framed
from phys4dgen.reconstruct.inflate import InflatedSolid, InflateOptions, inflate
from phys4dgen.reconstruct.inflate.balls import inscribed_balls
from phys4dgen.reconstruct.inflate.perspective import Perspective
from phys4dgen.reconstruct.inflate.silhouette import horizontal_runs, silhouette
from phys4dgen.render.cameras import orbit_camera
from phys4dgen.render.views import render_gaussians, render_views
from phys4dgen.types import Camera, rotation_to_z_up
from phys4dgen.types.gaussians import rotation_from_quats

UPRIGHT = rotation_to_z_up(np.array([0.0, 1.0, 0.0]))
FEW = InflateOptions(front_gaussians=20_000)


def cutout_of(mask, color=(0.8, 0.4, 0.2)):
    soft = nd.gaussian_filter(mask.astype(np.float32), 0.6)
    rgba = np.concatenate([np.broadcast_to(np.float32(color), (*mask.shape, 3)), soft[..., None]], -1)
    return Cutout(np.ascontiguousarray(rgba, np.float32), "mask", ())


def grid(size=300):
    return np.mgrid[:size, :size] + 0.5


def ball_mask():
    y, x = grid()
    return (x - 150) ** 2 + (y - 150) ** 2 < 110**2


def strip_mask():
    y, x = grid()
    return (np.abs(x - 150) < 40) & (np.abs(y - 150) < 130)


def pot_mask():
    y, x = grid()
    return (np.abs(x - 150) < 100 - 0.25 * (y - 50)) & (np.abs(y - 150) < 100)


def inside_share(solid, lower, upper, count=400_000):
    points = np.random.default_rng(0).uniform(lower, upper, (count, 3))
    return points[solid.contains(points)], np.prod(np.subtract(upper, lower)) / count


def test_runs_and_balls_of_a_disc():
    mask = ball_mask()
    runs = horizontal_runs(mask)
    assert runs.count.max() == 1
    assert runs.half_width[150, 150] == pytest.approx(110, abs=1)
    y, x = grid()
    sphere = np.maximum(110**2 - (x - 150) ** 2 - (y - 150) ** 2, 0)
    np.testing.assert_allclose(np.sqrt(inscribed_balls(mask).height_squared), np.sqrt(sphere), atol=16)
    np.testing.assert_allclose(inscribed_balls(mask).height_squared, sphere, atol=0.04 * 110**2)


def test_inscribed_balls_are_the_maximum_over_all_balls():
    rng = np.random.default_rng(1)
    mask = nd.gaussian_filter(rng.normal(size=(40, 40)), 4) > 0
    found = inscribed_balls(mask)
    radius = np.maximum(nd.distance_transform_edt(mask) - 0.5, 0)
    y, x = np.nonzero(mask)
    power = radius[y, x] ** 2 - (y[:, None] - y) ** 2 - (x[:, None] - x) ** 2
    np.testing.assert_allclose(found.height_squared[mask], np.maximum(power.max(1), 0), atol=1e-9)


def test_a_disc_becomes_a_sphere():
    made = inflate(cutout_of(ball_mask()), FEW)
    lower, upper = made.gaussians.means.min(0), made.gaussians.means.max(0)
    points, cell = inside_share(made.solid, lower - 0.05, upper + 0.05)
    width = upper[0] - lower[0]
    assert len(points) * cell == pytest.approx(np.pi / 6 * width**3, rel=0.05)


def test_a_strip_becomes_a_cylinder():
    made = inflate(cutout_of(strip_mask()), FEW)
    means = made.gaussians.means
    middle = means[np.abs(means[:, 1]) < 0.1]
    width, _, depth = np.ptp(middle, axis=0)
    assert depth == pytest.approx(width, rel=0.05)


def test_a_pot_stands_flat_and_round():
    made = inflate(cutout_of(pot_mask()), FEW)
    means = made.gaussians.means
    low, high = means[:, 1].min(), means[:, 1].max()
    unit = 2 * 0.685 / len(made.picture)
    for height in (0.1, 0.5):
        level = means[np.abs(means[:, 1] - low - height * (high - low)) < 0.02]
        width, _, depth = np.ptp(level, axis=0)
        assert depth >= 0.9 * width
    base = means[means[:, 1] < low + 4 * unit]
    assert len(base) > 1000
    normal_down = rotation_from_quats(made.gaussians.quats_wxyz)[:, :, 2][:, 1] < -0.9
    assert np.ptp(means[normal_down][:, 1]) < 2 * unit
    waist = means[np.abs(means[:, 1] - 0.5 * (low + high)) < 0.02][:, [0, 2]]
    radius = np.linalg.norm(waist - (waist.max(0) + waist.min(0)) / 2, axis=1)
    assert np.abs(radius - radius.mean()).max() < 0.05 * radius.mean()


def test_a_curved_base_tells_the_elevation_of_the_camera():
    y, x = grid()
    sine = np.sin(np.radians(12))
    body = (np.abs(x - 150) < 70) & (y > 50) & (y < 230)
    rim = ((x - 150) / 70) ** 2 + ((y - 230) / (70 * sine)) ** 2 < 1
    found = silhouette((body | rim).astype(np.float32))
    assert np.degrees(np.arctan(found.tilt)) == pytest.approx(12, abs=2)
    made = inflate(cutout_of(body | rim), FEW)
    base = rotation_from_quats(made.gaussians.quats_wxyz)[:, :, 2][:, 1] < -0.97
    unit = 2 * 0.685 / len(made.picture)
    assert np.ptp(made.gaussians.means[base][:, 1]) < 3 * unit
    flat = silhouette(body.astype(np.float32))
    assert flat.tilt == 0
    assert silhouette(ball_mask().astype(np.float32)).tilt == 0


def test_thickness_scales_the_depth():
    deep = inflate(cutout_of(strip_mask()), FEW).gaussians.means
    half = inflate(cutout_of(strip_mask()), InflateOptions(20_000, thickness=0.5)).gaussians.means
    assert np.ptp(half[:, 2]) == pytest.approx(0.5 * np.ptp(deep[:, 2]), rel=0.06)


def test_the_map_to_the_world_and_back():
    rng = np.random.default_rng(2)
    bend = nd.gaussian_filter(rng.uniform(0, 0.3, (64, 64)), 6)
    perspective = Perspective(bend, 50.0, 0.15)
    position = rng.uniform([5, 5, -15], [58, 58, 15], (200, 3))
    np.testing.assert_allclose(perspective.from_world(perspective.to_world(position)), position, atol=1e-6)
    step = 1e-5
    smooth = Perspective(0.001 * np.mgrid[:64, :64][1], 50.0, 0.15)
    for axis in range(3):
        tangent = np.zeros((200, 3))
        tangent[:, axis] = 1
        keep = np.abs(smooth.to_world(position) @ smooth.upright)[:, 2] > 1e-3  # away from the seam at z = 0
        moved = (smooth.to_world(position + step * tangent) - smooth.to_world(position - step * tangent)) / (2 * step)
        np.testing.assert_allclose(smooth.tangents_to_world(position, tangent)[keep], moved[keep], atol=1e-6)


def test_the_inside_survives_a_file():
    made = inflate(cutout_of(pot_mask()), InflateOptions(4000))
    points = np.random.default_rng(0).uniform(-0.6, 0.6, (2000, 3))
    again = InflatedSolid.from_arrays(made.solid.arrays())
    inside = made.solid.contains(points)
    assert 0.05 < inside.mean() < 0.9
    np.testing.assert_array_equal(again.contains(points), inside)


def test_the_inside_agrees_with_the_surface():
    made = inflate(cutout_of(ball_mask()), FEW)
    normals = rotation_from_quats(made.gaussians.quats_wxyz)[:, :, 2]
    means = made.gaussians.means.astype(float)
    reach = 0.02
    assert made.solid.contains(means - reach * normals).mean() > 0.99
    assert made.solid.contains(means + reach * normals).mean() < 0.01


def test_marks_stay_on_the_front():
    y, x = grid()
    made_of = cutout_of(ball_mask())
    for eye in (110, 190):
        made_of.rgba[(x - eye) ** 2 + (y - 120) ** 2 < 18**2, :3] = 0.02
    made = inflate(made_of, FEW)
    dark = made.gaussians.base_colors.max(1) < 0.2
    in_front = made.gaussians.means[:, 2] > 0.1
    assert dark[in_front].mean() > 0.02
    assert dark[~in_front].mean() < 0.001


def orbit(gaussians, directions, size=256):
    lower, upper = gaussians.robust_bounds(rotation=UPRIGHT)
    return [
        orbit_camera(
            azimuth_deg=azimuth,
            elevation_deg=elevation,
            target=(lower + upper) / 2 @ UPRIGHT,
            rotation=UPRIGHT,
            radius=float(np.linalg.norm(upper - lower)) * 1.9,
            fovy_deg=30,
            width=size,
            height=size,
        )
        for azimuth, elevation in directions
    ]


def holes(alpha):
    """Share of pixels with alpha < 0.95 inside the own silhouette, closed by 3 px and eroded by 2 px."""
    silhouette_ = nd.binary_erosion(nd.binary_closing(alpha > 0.5, iterations=3), iterations=2)
    return (silhouette_ & (alpha < 0.95)).sum() / silhouette_.sum()


@pytest.mark.parametrize(
    ("name", "mask"),
    [("hamburger_rgba.png", None), ("rubber_duck_rgba.png", None), ("teddy_image.png", "teddy_mask.png")],
)
def test_a_real_picture_is_closed_and_looks_like_itself(shared_data, name, mask):
    images = shared_data / "images"
    cutout = cut_out(images / name, mask=None if mask is None else images / mask)
    made = inflate(cutout)
    assert len(made.gaussians) <= 130_000
    camera, size = made.camera, 512
    K = np.diag([size / camera.width, size / camera.height, 1]) @ camera.K
    seen = render_gaussians(made.gaussians, Camera(viewmat=camera.viewmat, K=K, width=size, height=size))
    target = framed(cutout.rgba, size)
    inside = target[..., 3] > 0.5
    error = (np.clip(seen.rgb, 0, 1) - (target[..., :3] * target[..., 3:] + 1 - target[..., 3:])) ** 2
    assert -10 * np.log10(error.mean()) >= 27
    assert -10 * np.log10(error[inside].mean()) >= 23
    shown = seen.alpha > 0.5
    assert (shown & inside).sum() / (shown | inside).sum() >= 0.98
    views = render_views(made.gaussians, orbit(made.gaussians, [(a, e) for e in (0, 30) for a in range(0, 360, 72)]))
    shares = [holes(alpha) for alpha in views.alpha]
    assert np.mean(shares) <= 0.005
    assert np.max(shares) <= 0.012


def test_the_teddy_has_no_face_behind(shared_data):
    images = shared_data / "images"
    made = inflate(cut_out(images / "teddy_image.png", mask=images / "teddy_mask.png"), FEW)
    back = render_gaussians(made.gaussians, orbit(made.gaussians, [(180, 0)])[0])
    middle = (slice(40, 200), slice(88, 168))
    assert (back.rgb[middle][back.alpha[middle] > 0.9].min(-1) > 0.6).mean() < 0.002
