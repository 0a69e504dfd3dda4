"""The gsplat adapter on the CPU: gsplat's own projection and spherical harmonics, composited here by brute force."""

import numpy as np
import pytest

from phys4dgen.render.gsplat_backend import GsplatRasteriser
from phys4dgen.render.rasterise import rasterise
from phys4dgen.types import Camera

torch = pytest.importorskip("torch", reason="torch is not installed (extra 'models')")
gsplat = pytest.importorskip("gsplat", reason="gsplat is not installed (extra 'gsplat')", exc_type=ImportError)

WIDTH, HEIGHT = 48, 40
CAMERA = Camera(
    K=np.array([[50.0, 0, 23.0], [0, 52.0, 21.0], [0, 0, 1]]),
    viewmat=np.array([[0.8, 0, -0.6, 0.1], [0, 1, 0, -0.05], [0.6, 0, 0.8, 3.0], [0, 0, 0, 1]]),
    width=WIDTH,
    height=HEIGHT,
)


def dense_rasterization(
    *, means, quats, scales, opacities, colors, viewmats, Ks, width, height, near_plane, covars, render_mode,
    rasterize_mode, packed,
):  # fmt: skip
    """gsplat.rasterization with gsplat's projection and no tiles."""
    from gsplat.cuda._torch_impl import _fully_fused_projection

    radii, means2d, depths, conics, compensations = _fully_fused_projection(
        means, covars, viewmats, Ks, width, height, near_plane=near_plane, calc_compensations=True
    )
    assert (radii > 0).all()
    weight = opacities * compensations[0] if rasterize_mode == "antialiased" else opacities
    order = torch.argsort(depths[0])
    y, x = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    through = torch.ones(height, width)
    picture = torch.zeros(height, width, 4)
    for i in order:
        dx, dy = x - means2d[0, i, 0], y - means2d[0, i, 1]
        a, b, c = conics[0, i]
        alpha = (weight[i] * torch.exp(-0.5 * (a * dx * dx + c * dy * dy) - b * dx * dy)).clamp_max(0.999)
        alpha = torch.where(alpha < 1 / 255, 0.0, alpha)
        channels = torch.cat([colors[0, i], depths[0, i : i + 1]])
        picture += (alpha * through)[..., None] * channels
        through = through * (1 - alpha)
    coverage = 1 - through
    picture[..., 3] /= coverage.clamp_min(1e-10)
    return picture[None], coverage[None, ..., None], {}


@pytest.fixture
def on_cpu(monkeypatch):
    from gsplat.cuda._torch_impl import _spherical_harmonics

    def spherical_harmonics(degree, directions, coefficients):
        return _spherical_harmonics(degree, torch.nn.functional.normalize(directions, dim=-1), coefficients)

    monkeypatch.setattr(gsplat, "rasterization", dense_rasterization)
    monkeypatch.setattr(gsplat, "spherical_harmonics", spherical_harmonics)


@pytest.fixture(scope="module")
def scene():
    rng = np.random.default_rng(3)
    n = 60
    factor = rng.normal(0, 0.12, (n, 3, 3))
    turns, _ = np.linalg.qr(rng.normal(size=(n, 3, 3)))
    turns *= np.sign(np.linalg.det(turns))[:, None, None]
    return {
        "means": rng.normal(0, 0.4, (n, 3)),
        "covariances": factor @ factor.transpose(0, 2, 1) + 1e-4 * np.eye(3),
        "opacities": rng.uniform(0.2, 0.9, n),
        "sh": rng.normal(0, 0.3, (n, 16, 3)),
        "turns": turns,
    }


@pytest.mark.parametrize("antialiased", [False, True])
@pytest.mark.parametrize("turned", [False, True])
def test_the_adapter_draws_what_the_cpu_renderer_draws(scene, on_cpu, antialiased, turned):
    arguments = {
        "camera": CAMERA,
        "sh": scene["sh"],
        "sh_rotations": scene["turns"] if turned else None,
        "background": (0.2, 0.4, 0.6),
        "antialiased": antialiased,
    }
    shape = scene["means"], scene["covariances"], scene["opacities"]
    ours = rasterise(*shape, depth="expected", **arguments)
    theirs = GsplatRasteriser("cpu").render(*shape, **arguments)
    # Gaussians that end at 1/255 in one and just before it in the other differ by half a grey level.
    np.testing.assert_allclose(theirs.rgb, ours.rgb, atol=6e-3)
    assert np.abs(theirs.rgb - ours.rgb).mean() < 2e-4
    np.testing.assert_allclose(theirs.alpha, ours.alpha, atol=6e-3)
    seen = ours.alpha > 0.5
    np.testing.assert_allclose(theirs.depth[seen], ours.depth[seen], rtol=5e-3)


def test_colours_are_drawn_as_they_are(scene, on_cpu):
    colors = np.abs(scene["sh"][:, 0])
    shape = scene["means"], scene["covariances"], scene["opacities"]
    ours = rasterise(*shape, camera=CAMERA, colors=colors)
    theirs = GsplatRasteriser("cpu").render(*shape, camera=CAMERA, colors=colors)
    np.testing.assert_allclose(theirs.rgb, ours.rgb, atol=6e-3)
    with pytest.raises(ValueError, match="exactly one of the two, got both"):
        GsplatRasteriser("cpu").render(*shape, camera=CAMERA, colors=colors, sh=scene["sh"])
