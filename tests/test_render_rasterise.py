"""The CPU renderer against a float64 brute force, physics of transparency, and hostile input."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from phys4dgen.render import rasterise as rasterise_module
from phys4dgen.render.cameras import intrinsics, look_at, orbit_camera
from phys4dgen.render.rasterise import (
    Rasteriser,
    default_near,
    packed_covariances,
    rasterise,
)
from phys4dgen.render.views import render_gaussians, render_labels, render_views
from phys4dgen.types import SH_C0, Camera, Gaussians, covariance_from_quats_scales
from reference.render_reference import psnr_db, real_spherical_harmonics, render

WIDTH, HEIGHT = 90, 75  # not multiples of the tile size


def make_camera(*, azimuth_deg=33, elevation_deg=20, radius=1.5, width=WIDTH, height=HEIGHT):
    return orbit_camera(
        azimuth_deg=azimuth_deg, elevation_deg=elevation_deg, target=[0, 0, 0], rotation=np.eye(3), radius=radius,
        fovy_deg=49.1, width=width, height=height,
    )  # fmt: skip


def random_gaussians(n, *, degree, seed, scale=0.03):
    """A cloud of Gaussians of every opacity and shape."""
    rng = np.random.default_rng(seed)
    quats = rng.normal(size=(n, 4))
    return Gaussians(
        means=rng.uniform(-0.5, 0.5, (n, 3)),
        quats_wxyz=quats / np.linalg.norm(quats, axis=1, keepdims=True),
        scales=scale * np.exp(rng.normal(0, 0.6, (n, 3))),
        opacities=rng.uniform(0.002, 0.999, n),
        sh=rng.normal(0, 0.3, (n, (degree + 1) ** 2, 3)),
    )


def sphere_gaussians(n, *, degree, seed):
    """Flat, mostly opaque Gaussians on a sphere over a plate: layers in front of each other, as a capture has."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    means = 0.3 * normals
    plate = np.arange(n) % 3 == 0
    means[plate] = np.column_stack([rng.uniform(-0.5, 0.5, (plate.sum(), 2)), np.full(plate.sum(), -0.3)])
    normals[plate] = [0, 0, 1]
    turns = Rotation.concatenate([Rotation.align_vectors(normal[None], [[0, 0, 1]])[0] for normal in normals])
    sh = rng.normal(0, 0.08, (n, (degree + 1) ** 2, 3))
    sh[:, 0] = 0.4 * np.sin(8 * means + [0, 2, 4]) / SH_C0
    return Gaussians(
        means=means,
        quats_wxyz=turns.as_quat()[:, [3, 0, 1, 2]],
        scales=np.column_stack([rng.uniform(0.01, 0.04, (n, 2)), np.full(n, 0.002)]),
        opacities=rng.beta(4, 1, n).clip(0.01, 0.999),
        sh=sh,
    )


def reference_of(gaussians, camera, **options):
    return render(
        gaussians.means, gaussians.covariances(), gaussians.opacities, sh=gaussians.sh, camera=camera, **options
    )


@pytest.mark.parametrize("antialiased", [False, True])
@pytest.mark.parametrize("degree", [0, 1, 2, 3])
@pytest.mark.parametrize("make", [random_gaussians, sphere_gaussians])
def test_picture_equals_float64_brute_force(make, degree, antialiased):
    gaussians = make(1500, degree=degree, seed=degree)
    camera = make_camera()
    picture = render_gaussians(gaussians, camera, antialiased=antialiased)
    truth = reference_of(gaussians, camera, antialiased=antialiased)
    assert psnr_db(picture.rgb, truth.rgb) > 75
    assert psnr_db(picture.alpha, truth.alpha) > 70
    covered = truth.alpha > 0.51
    assert covered.mean() > 0.1
    equal = np.abs(picture.depth - truth.median_depth) < 1e-5
    assert equal[covered].mean() > 0.999
    assert (picture.depth[truth.alpha < 0.49] == 0).all()


def test_subpixel_gaussians_equal_brute_force():
    gaussians = random_gaussians(2000, degree=1, seed=5, scale=0.004)
    camera = make_camera()
    for antialiased in (False, True):
        picture = render_gaussians(gaussians, camera, antialiased=antialiased)
        assert psnr_db(picture.rgb, reference_of(gaussians, camera, antialiased=antialiased).rgb) > 85


def test_expected_depth_equals_brute_force():
    gaussians = sphere_gaussians(1500, degree=0, seed=3)
    camera = make_camera()
    picture = render_gaussians(gaussians, camera, depth="expected")
    truth = reference_of(gaussians, camera)
    assert np.abs(picture.depth - truth.expected_depth)[truth.alpha > 0.1].max() < 2e-3
    assert np.array_equal(picture.rgb, render_gaussians(gaussians, camera, depth="median").rgb)


def test_label_map_shows_the_gaussian_at_the_median():
    gaussians = sphere_gaussians(1500, degree=0, seed=4)
    camera = make_camera()
    labels = np.arange(1500) % 7
    shown = render_labels(gaussians, labels, camera)
    truth = reference_of(gaussians, camera)
    expected = np.where(truth.median_index >= 0, labels[truth.median_index], -1)
    assert shown.dtype == np.int32
    assert (shown == expected).mean() > 0.999
    picture = render_gaussians(gaussians, camera)
    assert np.array_equal(shown >= 0, picture.alpha >= 0.5)
    assert np.array_equal(shown >= 0, picture.depth > 0)


def test_large_labels_are_exact():
    camera = make_camera()
    gaussians = random_gaussians(1, degree=0, seed=0, scale=0.5)
    gaussians = Gaussians(gaussians.means * 0, gaussians.quats_wxyz, gaussians.scales, np.ones(1), gaussians.sh)
    assert render_labels(gaussians, np.array([2**24 - 1]), camera).max() == 2**24 - 1


def test_spherical_harmonics_are_those_of_3dgs():
    """The first bands as INRIA's code writes them; holds the reference itself in place."""
    x, y, z = direction = np.array([0.36, -0.48, 0.8])
    basis = real_spherical_harmonics(2, direction[None])[0]
    expected = [SH_C0, -0.4886025119 * y, 0.4886025119 * z, -0.4886025119 * x, 1.0925484306 * x * y]
    expected += [-1.0925484306 * y * z, 0.3153915653 * (3 * z * z - 1), -1.0925484306 * x * z]
    expected += [0.5462742152 * (x * x - y * y)]
    np.testing.assert_allclose(basis, expected, atol=1e-9)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_scene_and_camera_turned_together_give_the_same_picture(degree):
    gaussians = random_gaussians(300, degree=degree, seed=8)
    camera = make_camera()
    turn = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
    viewmat = camera.viewmat.copy()
    viewmat[:3, :3] = camera.viewmat[:3, :3] @ turn.T
    turned_camera = Camera(viewmat, camera.K, camera.width, camera.height)
    means = gaussians.means.astype(np.float64) @ turn.T
    covariances = turn @ gaussians.covariances() @ turn.T
    turns = np.broadcast_to(turn, (300, 3, 3))
    before = render_gaussians(gaussians, camera)
    after = rasterise(
        means, covariances, gaussians.opacities, sh=gaussians.sh, sh_rotations=turns, camera=turned_camera
    )
    # The order of two Gaussians, or alpha on either side of 1/255, may flip with the last bit of a float32.
    difference = np.abs(before.rgb - after.rgb)
    assert np.percentile(difference, 95) < 1e-5
    assert psnr_db(after.rgb, before.rgb) > 80


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_sh_rotation_of_one_gaussian_equals_the_turned_function(degree):
    rng = np.random.default_rng(degree)
    sh = rng.normal(0, 0.2, (1, (degree + 1) ** 2, 3))
    camera = make_camera(width=33, height=33)
    for turn in Rotation.random(20, random_state=degree).as_matrix():
        picture = rasterise(
            np.zeros((1, 3)), np.eye(3)[None] * 4, [0.999], sh=sh, sh_rotations=turn[None], camera=camera,
            background=(0, 0, 0),
        )  # fmt: skip
        direction = turn.T @ (-camera.position / np.linalg.norm(camera.position))
        basis = real_spherical_harmonics(degree, direction[None])[0]
        colour = np.maximum(0.5 + np.einsum("k,kc->c", basis, sh[0]), 0)
        np.testing.assert_allclose(picture.rgb[16, 16] / picture.alpha[16, 16], colour, atol=1e-5)


def test_packed_and_full_covariances_and_plain_colours_agree():
    gaussians = random_gaussians(400, degree=0, seed=1)
    camera = make_camera()
    colors = 0.5 + SH_C0 * gaussians.sh[:, 0]
    colors = np.maximum(colors, 0)
    full = gaussians.covariances()
    by_sh = rasterise(gaussians.means, full, gaussians.opacities, sh=gaussians.sh, camera=camera)
    by_colour = rasterise(gaussians.means, packed_covariances(full), gaussians.opacities, colors=colors, camera=camera)
    np.testing.assert_allclose(by_colour.rgb, by_sh.rgb, atol=1e-6)


def test_opaque_pixel_has_the_colour_and_depth_of_the_front_gaussian():
    camera = Camera(np.eye(4), intrinsics(60, 32, 32), 32, 32)
    means = np.array([[0, 0, 3.0], [0, 0, 2.0]])  # the red one in front comes second
    picture = rasterise(
        means, np.eye(3)[None].repeat(2, 0) * 100, [1.0, 1.0], colors=[[0, 0, 1], [1, 0, 0]], camera=camera
    )
    np.testing.assert_allclose(picture.rgb[16, 16], [0.999, 0, 0.000999], atol=1e-5)
    assert picture.depth[16, 16] == 2.0


def test_picture_is_bitwise_equal_for_any_number_of_threads_and_bands(monkeypatch):
    gaussians = random_gaussians(3000, degree=1, seed=2)
    camera = make_camera(width=130, height=110)
    pictures = [render_gaussians(gaussians, camera, rasteriser=Rasteriser(threads)) for threads in (1, 2, 3)]
    monkeypatch.setattr(rasterise_module, "MAX_PAIRS_PER_BAND", 1000)
    pictures.append(render_gaussians(gaussians, camera, rasteriser=Rasteriser(2)))
    for picture in pictures[1:]:
        assert np.array_equal(picture.rgb, pictures[0].rgb)
        assert np.array_equal(picture.alpha, pictures[0].alpha)
        assert np.array_equal(picture.depth, pictures[0].depth)


def test_equal_depths_keep_the_order_of_the_gaussians():
    camera = Camera(np.eye(4), intrinsics(60, 32, 32), 32, 32)
    arguments = np.array([[0, 0, 2.0]] * 3), np.eye(3)[None].repeat(3, 0), [0.9, 0.9, 0.9]
    for threads in (1, 2, 3):
        picture = Rasteriser(threads).render(*arguments, colors=np.eye(3), camera=camera, background=(0, 0, 0))
        red, green, blue = picture.rgb[16, 16]
        assert red > 5 * green > 20 * blue > 0


def test_one_rasteriser_serves_scenes_and_sizes_of_any_order():
    rasteriser = Rasteriser(2)
    for n, width in ((500, 64), (20, 33), (900, 100), (1, 16)):
        gaussians = random_gaussians(n, degree=0, seed=n)
        camera = make_camera(width=width, height=40)
        reused = render_gaussians(gaussians, camera, rasteriser=rasteriser)
        assert np.array_equal(reused.rgb, render_gaussians(gaussians, camera).rgb)


def test_views_equal_single_pictures_and_report_progress():
    gaussians = random_gaussians(500, degree=0, seed=6)
    cameras = [make_camera(azimuth_deg=a) for a in (0, 90, 180, 270, 300)]
    done = []
    views = render_views(gaussians, cameras, background=(0, 0.5, 1), threads=2, on_view=done.append)
    assert done == [1, 2, 3, 4, 5]
    for i, camera in enumerate(cameras):
        picture = render_gaussians(gaussians, camera, background=(0, 0.5, 1))
        assert np.array_equal(views.rgb[i], picture.rgb)
        assert np.array_equal(views.depth[i], picture.depth)


def test_units_of_the_input_do_not_matter():
    """A scene in millimetres or kilometres gives the same picture, the near plane included."""
    gaussians = random_gaussians(800, degree=0, seed=7)
    camera = make_camera(radius=0.6)  # inside the cloud: the near plane cuts
    plain = render_gaussians(gaussians, camera)
    for scale in (1e-6, 1e6):
        viewmat = camera.viewmat.copy()
        viewmat[:3, 3] *= scale
        scaled = Camera(viewmat, camera.K, camera.width, camera.height)
        picture = rasterise(
            gaussians.means * np.float32(scale), gaussians.covariances() * scale**2, gaussians.opacities,
            sh=gaussians.sh, camera=scaled,
        )  # fmt: skip
        assert psnr_db(picture.rgb, plain.rgb) > 80


def test_default_near_follows_the_scale():
    camera = make_camera(radius=1.0)
    means = np.zeros((10, 3), np.float32)
    assert default_near(means, camera) == pytest.approx(0.01)
    assert default_near(means + np.float32(10 * camera.position), camera) == 0  # all behind


@pytest.mark.parametrize("case", ["behind", "transparent", "outside", "none"])
def test_nothing_to_see_gives_the_background(case):
    camera = make_camera()
    n = 0 if case == "none" else 50
    means = np.zeros((n, 3))
    if case == "behind":
        means = means + 2 * camera.position
    if case == "outside":
        means = means + 100 * camera.viewmat[0, :3]
    opacities = np.full(n, 0.003 if case == "transparent" else 0.9)
    picture = rasterise(
        means, np.eye(3)[None].repeat(n, 0) * 1e-4, opacities, colors=np.ones((n, 3)), camera=camera,
        background=(0.2, 0.4, 0.6),
    )  # fmt: skip
    np.testing.assert_array_equal(picture.rgb, np.broadcast_to(np.float32([0.2, 0.4, 0.6]), picture.rgb.shape))
    assert not picture.alpha.any() and not picture.depth.any()


def test_needle_through_the_near_plane_stays_a_needle():
    """Its screen covariance has a determinant that float32 cannot hold; float64 knows the truth."""
    camera = Camera(np.eye(4), intrinsics(60, 64, 64), 64, 64)
    turn = Rotation.from_euler("z", 30, degrees=True).as_matrix()
    covariance = np.float32(turn @ np.diag([9.0, 1e-5, 1e-5]) @ turn.T)[None]
    needle = [[0.0, 0, 0.02]], covariance, [0.9]
    picture = rasterise(*needle, colors=[[0, 0, 0]], camera=camera, near=0.01)
    truth = render(*needle, colors=np.zeros((1, 3)), camera=camera, near=0.01)
    assert 0.05 < truth.alpha.mean() < 0.5
    assert psnr_db(picture.rgb, truth.rgb) > 60


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    width=st.integers(1, 70),
    height=st.integers(1, 70),
    magnitude=st.sampled_from([1e-30, 1e-3, 1.0, 1e4, 1e18, np.inf, np.nan]),
)
def test_no_input_makes_a_picture_with_nan(seed, width, height, magnitude):
    rng = np.random.default_rng(seed)
    n = 40
    means = rng.normal(size=(n, 3))
    covariances = rng.normal(size=(n, 6))  # mostly not positive definite
    opacities = rng.uniform(-0.5, 1.5, n)
    colors = rng.normal(size=(n, 3))
    turns = rng.normal(size=(n, 3, 3))
    with np.errstate(all="ignore"):
        spoiled = [means, covariances, opacities, colors, turns][rng.integers(5)]
        spoiled[rng.random(n) < 0.3] *= magnitude
        camera = Camera(
            look_at(rng.normal(size=3), rng.normal(size=3), [0, 0, 1]), intrinsics(70, width, height), width, height
        )
        for options in ({"colors": colors}, {"sh": rng.normal(size=(n, 4, 3)), "sh_rotations": turns}):
            for antialiased, near in ((False, 0.0), (True, None)):
                picture = rasterise(
                    means, covariances, opacities, camera=camera, antialiased=antialiased, near=near, **options
                )
                assert np.isfinite(picture.rgb).all()
                assert np.isfinite(picture.depth).all()
                assert (picture.alpha >= 0).all() and (picture.alpha <= 1).all()


def test_wrong_arguments_are_named():
    gaussians = random_gaussians(4, degree=0, seed=0)
    camera = make_camera()
    covariances = gaussians.covariances()
    good = {"camera": camera, "sh": gaussians.sh}
    with pytest.raises(ValueError, match=r"covariances: expected shape \(N, 3, 3\) or \(N, 6\), got \(4, 9\)"):
        rasterise(gaussians.means, covariances.reshape(4, 9), gaussians.opacities, **good)
    with pytest.raises(ValueError, match="opacities: expected shape"):
        rasterise(gaussians.means, covariances, gaussians.opacities[:3], **good)
    with pytest.raises(ValueError, match="exactly one of the two, got both"):
        rasterise(gaussians.means, covariances, gaussians.opacities, colors=gaussians.means, **good)
    with pytest.raises(ValueError, match="exactly one of the two, got none"):
        rasterise(gaussians.means, covariances, gaussians.opacities, camera=camera)
    with pytest.raises(ValueError, match="sh: expected 1, 4, 9 or 16"):
        rasterise(gaussians.means, covariances, gaussians.opacities, camera=camera, sh=np.zeros((4, 5, 3)))
    with pytest.raises(ValueError, match="depth: expected 'median' or 'expected'"):
        rasterise(gaussians.means, covariances, gaussians.opacities, depth="mean", **good)
    with pytest.raises(ValueError, match="near: expected a depth of 0 or more"):
        rasterise(gaussians.means, covariances, gaussians.opacities, near=-1, **good)
    with pytest.raises(ValueError, match="labels: expected numbers from 0"):
        render_labels(gaussians, np.array([0, 1, -1, 2]), camera)
    with pytest.raises(ValueError, match="labels: expected integers"):
        render_labels(gaussians, np.zeros(4), camera)
    with pytest.raises(ValueError, match="cameras: expected one picture size"):
        render_views(gaussians, [camera, make_camera(width=8)])
    with pytest.raises(ValueError, match="cameras: expected at least one"):
        render_views(gaussians, [])
    with pytest.raises(ValueError, match="threads: expected at least 1"):
        Rasteriser(0)


def test_deformed_gaussians_render_as_their_covariance():
    """Sigma' = F Sigma F^T of a sheared Gaussian against the brute force."""
    gaussians = random_gaussians(300, degree=0, seed=11)
    shear = np.array([[1.2, 0.5, 0], [0, 0.8, 0.1], [0, 0, 1.1]])
    covariances = shear @ covariance_from_quats_scales(gaussians.quats_wxyz, gaussians.scales) @ shear.T
    means = gaussians.means @ shear.T
    camera = make_camera()
    picture = rasterise(means, covariances, gaussians.opacities, sh=gaussians.sh, camera=camera)
    truth = render(means, covariances, gaussians.opacities, sh=gaussians.sh, camera=camera)
    assert psnr_db(picture.rgb, truth.rgb) > 75
