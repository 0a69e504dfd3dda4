"""Solid voxels and what they become: thick and thin, sheets and rods, bridges, carving, density."""

import numpy as np
import pytest

from phys4dgen.errors import StageError
from phys4dgen.interior import discover_interior
from phys4dgen.interior.bridge import bridge_pieces
from phys4dgen.interior.carve import DepthLimits, carve, solid_share
from phys4dgen.interior.density import accumulated_opacity, density_threshold
from phys4dgen.interior.sites import ribbon_sites, rod_sites, sheet_sites
from phys4dgen.interior.thin import describe_thin_voxels, split_thick_and_thin
from phys4dgen.interior.voxels import VoxelGrid
from phys4dgen.render.cameras import view_cameras
from phys4dgen.types import ROD, SHEET, Frame, Gaussians, Parts, Views, rotation_to_z_up

SIZE = 48
MIDDLE = (SIZE - 1) / 2
X = np.stack(np.meshgrid(*[np.arange(SIZE)] * 3, indexing="ij"), -1) - MIDDLE
GENERAL = np.array([0.37, -0.55, 0.75]) / np.linalg.norm([0.37, -0.55, 0.75])
IN_PLANE_45 = np.array([np.sqrt(0.5), 0, np.sqrt(0.5)])
TILTS = {
    "flat": np.array([0.0, 0, 1]),
    "20 deg": np.array([np.sin(np.radians(20)), 0, np.cos(np.radians(20))]),
    "45 deg": IN_PLANE_45,
    "general": GENERAL,
}


def _ball(radius):
    return np.linalg.norm(X, axis=-1) <= radius


def _disc(normal, *, radius=19.0, thickness=2.0):
    """A round sheet through the middle of the array."""
    height = X @ normal
    return (np.abs(height) < thickness / 2) & (np.linalg.norm(X - height[..., None] * normal, axis=-1) < radius)


def _rod(axis, *, length=36.0, radius=1.3):
    along = X @ axis
    across = np.linalg.norm(X - along[..., None] * axis, axis=-1)
    return (np.abs(along) < length / 2) & (across < radius)


# ------------------------------------------------------------------------------------------------ thick and thin


@pytest.mark.parametrize(
    "name, solid, is_thick",
    [
        ("ball", _ball(8), True),
        ("box with its edges and corners", (np.abs(X) < 8).all(-1), True),
        ("slab of two voxels", _disc(TILTS["flat"]), False),
        ("tilted slab", _disc(GENERAL), False),
        ("rod", _rod(GENERAL), False),
        ("slab of six voxels", _disc(TILTS["flat"], thickness=6.0), True),
    ],
)
def test_bodies_are_thick_and_leaves_and_stems_are_thin(name, solid, is_thick):
    thick, thin = split_thick_and_thin(solid)
    assert not (thick & thin).any()
    assert (thick | thin)[solid].all()
    assert (thick[solid].mean() > 0.99) if is_thick else not thick.any()


def test_a_leaf_on_a_ball_stays_a_leaf():
    ball = np.linalg.norm(X + np.array([12, 0, 0]), axis=-1) < 7
    leaf = (np.abs(X[..., 2]) < 1) & (np.abs(X[..., 1]) < 5) & (X[..., 0] > -8) & (X[..., 0] < 20)
    thick, thin = split_thick_and_thin(ball | leaf)
    assert thick[ball].mean() > 0.99
    assert thin[leaf & (X[..., 0] > 0)].all()


def test_a_slit_between_body_and_skin_is_closed():
    """Carving stops half a voxel under the skin that the Gaussians' density makes: the slit is not the object's."""
    box = (np.abs(X) < 10).all(-1)
    slit = box & (np.abs(X[..., 2] - 7.5) < 0.6)
    thick, thin = split_thick_and_thin(box & ~slit)
    inner = (np.abs(X) < 9).all(-1)
    assert thick[slit & inner].all()
    assert not thin.any()


# ------------------------------------------------------------------------------------------------ thin geometry


@pytest.mark.parametrize("tilt", TILTS)
def test_the_normal_of_a_sheet_is_found(tilt):
    normal = TILTS[tilt]
    voxels = describe_thin_voxels(_disc(normal))
    at = voxels.index - MIDDLE
    inner = np.linalg.norm(at, axis=1) < 15
    assert (voxels.kind[inner] == SHEET).all()
    angle = np.degrees(np.arccos(np.clip(np.abs(voxels.direction[inner] @ normal), 0, 1)))
    assert np.quantile(angle, 0.99) < 5
    assert np.abs((voxels.middle[inner] - MIDDLE) @ normal).max() < 0.3


@pytest.mark.parametrize("tilt", TILTS)
def test_the_axis_of_a_rod_is_found(tilt):
    axis = TILTS[tilt]
    voxels = describe_thin_voxels(_rod(axis))
    inner = np.abs((voxels.index - MIDDLE) @ axis) < 12
    assert (voxels.kind[inner] == ROD).all()
    angle = np.degrees(np.arccos(np.clip(np.abs(voxels.direction[inner] @ axis), 0, 1)))
    assert np.quantile(angle, 0.99) < 8


def test_a_sheet_does_not_borrow_the_shape_of_the_next_one():
    """Two parallel sheets with two voxels of air between them: neighbourhoods are walked through the solid."""
    flat, far = _disc(TILTS["flat"]), X[..., 2] > 1
    both = flat | np.roll(flat, 4, axis=2)
    alone, beside = describe_thin_voxels(flat), describe_thin_voxels(both)
    first = ~far[tuple(beside.index.T)]
    np.testing.assert_allclose(beside.middle[first], alone.middle, atol=1e-9)
    np.testing.assert_array_equal(beside.kind[first], alone.kind)


def test_nothing_thin_is_no_voxels():
    nothing = np.zeros((8, 8, 8), bool)
    voxels = describe_thin_voxels(nothing)
    assert len(voxels.index) == 0
    assert len(sheet_sites(voxels, nothing)) == 0
    assert len(rod_sites(voxels, nothing)[0]) == 0


# ------------------------------------------------------------------------------------------------ sites


@pytest.mark.parametrize("tilt", TILTS)
def test_sites_of_a_sheet_carry_its_area(tilt):
    normal, radius = TILTS[tilt], 14.0
    sites = sheet_sites(describe_thin_voxels(_disc(normal)), np.zeros((SIZE,) * 3, bool))
    at = sites.position - MIDDLE
    height = at @ normal
    inner = np.linalg.norm(at - height[:, None] * normal, axis=1) < radius
    np.testing.assert_allclose(sites.extent[inner].sum(), np.pi * radius**2, rtol=0.05)
    assert np.abs(height[inner]).max() < 0.6
    assert np.median(np.abs(height[inner])) < 0.2


@pytest.mark.parametrize("tilt", TILTS)
def test_sites_of_a_sheet_face_one_way_and_have_the_other_colour_beside_them(tilt):
    sites = sheet_sites(describe_thin_voxels(_disc(TILTS[tilt])), np.zeros((SIZE,) * 3, bool))
    assert np.unique(np.sign(sites.direction @ TILTS[tilt])).size == 1
    column = np.delete(sites.position, np.abs(TILTS[tilt]).argmax(), axis=1)
    one, other = np.nonzero(np.abs(np.abs(column[:, None] - column).sum(2) - 1) < 1e-9)
    assert len(one) > 2 * len(sites)
    turns = sites.is_odd[one] != sites.is_odd[other]
    assert turns.mean() > 0.9 if tilt == "45 deg" else turns.all()  # there, columns along two axes meet
    assert sites.is_odd.mean() == pytest.approx(0.5, abs=0.03)


@pytest.mark.parametrize("tilt", TILTS)
def test_sites_of_a_rod_carry_its_length(tilt):
    axis = TILTS[tilt]
    sites, section = rod_sites(describe_thin_voxels(_rod(axis)), np.zeros((SIZE,) * 3, bool))
    at = sites.position - MIDDLE
    along = at @ axis
    inner = np.abs(along) < 12
    np.testing.assert_allclose(sites.extent[inner].sum(), 24, rtol=0.08)
    across = np.linalg.norm(at - along[:, None] * axis, axis=1)[inner]
    assert across.max() < 0.5
    voxels = (_rod(axis) & (np.abs(X @ axis) < 12)).sum()
    np.testing.assert_allclose(section[inner].mean(), voxels / 24, rtol=0.10)


def test_ribbons_keep_area_and_second_moment():
    rods, _ = rod_sites(describe_thin_voxels(_rod(TILTS["flat"])), np.zeros((SIZE,) * 3, bool))
    width, across = np.full(len(rods), 3.0), np.tile([0.0, 1.0, 0], (len(rods), 1))
    sheets = ribbon_sites(rods, width, across)
    left, right = sheets.is_odd.reshape(2, -1)
    assert (left != right).all()
    assert (np.diff(left[np.argsort(rods.position[:, 2])].astype(int)) != 0).all()  # squares and diamonds by turns
    np.testing.assert_allclose(sheets.extent.sum(), 3.0 * rods.extent.sum(), rtol=1e-12)
    np.testing.assert_allclose(np.abs(sheets.direction[:, 0]), 1, atol=1e-2)  # across the blade and its axis
    from_middle = sheets.position[:, 1] - np.tile(rods.position[:, 1], 2)
    np.testing.assert_allclose((sheets.extent * from_middle**2).sum() / sheets.extent.sum(), 3.0**2 / 12, rtol=1e-9)


def test_sites_know_bridges():
    sheet = _disc(TILTS["flat"])
    bridges = sheet & (X[..., 0] > 10)
    sites = sheet_sites(describe_thin_voxels(sheet), bridges)
    np.testing.assert_array_equal(sites.is_bridge, sites.position[:, 0] - MIDDLE > 10)


# ------------------------------------------------------------------------------------------------ bridges


def _two_slabs(gap):
    solid = np.zeros((40, 12, 6), bool)
    solid[2:14, 2:10, 2:4] = True
    solid[14 + gap : 22 + gap, 2:10, 2:4] = True
    return solid


def test_a_gap_of_five_voxels_is_bridged():
    solid = _two_slabs(5)
    bridged, bridges, report = bridge_pieces(solid)
    assert (bridged == (solid | bridges)).all()
    assert not (bridges & solid).any()
    assert bridges.any(axis=(1, 2))[14:19].all()
    assert (report.pieces_before, report.pieces_after, report.share_in_largest) == (2, 1, 1.0)
    assert report.bridge_voxels == bridges.sum() >= 5


def test_a_gap_of_twelve_voxels_is_not():
    solid = _two_slabs(12)
    bridged, bridges, report = bridge_pieces(solid)
    np.testing.assert_array_equal(bridged, solid)
    assert not bridges.any()
    assert (report.pieces_before, report.pieces_after, report.bridge_voxels) == (2, 2, 0)
    assert report.share_in_largest == pytest.approx(12 / 20)
    assert bridge_pieces(solid, max_gap_voxels=14)[2].pieces_after == 1


def test_pieces_join_over_each_other():
    """The far piece is out of the largest one's reach, but not of the piece between them."""
    solid = np.zeros((40, 12, 6), bool)
    for start, stop in ((2, 14), (19, 23), (28, 33)):
        solid[start:stop, 2:10, 2:4] = True
    _, _, report = bridge_pieces(solid)
    assert (report.pieces_before, report.pieces_after) == (3, 1)


def test_crumbs_are_dropped():
    solid = _two_slabs(5)
    crumbs = solid.copy()
    crumbs[36, 5, 3:5] = True
    crumbs[10, 6, 0] = False
    np.testing.assert_array_equal(bridge_pieces(crumbs)[0], bridge_pieces(solid)[0])
    assert bridge_pieces(crumbs)[2].pieces_before == 2
    assert bridge_pieces(crumbs, min_piece_voxels=2)[2].pieces_before == 3


def test_no_solid_is_no_piece():
    nothing, _, report = bridge_pieces(np.zeros((5, 5, 5), bool))
    assert not nothing.any()
    assert (report.pieces_before, report.pieces_after, report.share_in_largest) == (0, 0, 0.0)


# ------------------------------------------------------------------------------------------------ carving

RADIUS = 0.4
CENTER = np.array([0.3, -0.2, 1.1])  # input axes


@pytest.fixture(scope="module")
def sphere():
    """Views of a ball in an input whose up is -y, from analytic alpha and depth."""
    rotation = rotation_to_z_up(np.array([0, -1.0, 0]))
    center_up = rotation @ CENTER
    cameras = view_cameras("carve", lower=center_up - RADIUS, upper=center_up + RADIUS, rotation=rotation, size_px=128)
    alpha, depth = np.zeros((2, len(cameras), 128, 128), np.float32)
    v, u = np.mgrid[:128, :128] + 0.5
    for k, camera in enumerate(cameras):
        ray = np.stack([(u - camera.K[0, 2]) / camera.K[0, 0], (v - camera.K[1, 2]) / camera.K[1, 1], np.ones_like(u)])
        middle = camera.viewmat[:3, :3] @ CENTER + camera.viewmat[:3, 3]
        a, b, c = (ray**2).sum(0), np.tensordot(middle, ray, 1), middle @ middle - RADIUS**2
        root = b * b - a * c
        hit = root > 0
        alpha[k] = hit
        depth[k][hit] = ((b - np.sqrt(np.where(hit, root, 0))) / a)[hit]  # z of the nearer hit
    views = Views(cameras, np.zeros((len(cameras), 128, 128, 3), np.float32), alpha, depth)
    return views, rotation, center_up


def test_a_ball_is_carved_with_its_volume(sphere):
    views, rotation, center_up = sphere
    side = RADIUS / 12
    grid = VoxelGrid.around(center_up - 1.1 * RADIUS, center_up + 1.1 * RADIUS, side, padding=2)
    solid = carve(grid, DepthLimits(views, dilate=True), rotation)
    index = np.argwhere(solid)
    share = solid_share(grid, index, DepthLimits(views, dilate=False).contains, rotation)
    volume = 4 / 3 * np.pi * RADIUS**3
    np.testing.assert_allclose(share.sum() * side**3, volume, rtol=0.05)
    distance = np.linalg.norm(grid.centers(index) - center_up, axis=1)
    assert distance.max() < RADIUS + 1.5 * side
    everywhere = np.linalg.norm(grid.all_centers() - center_up, axis=1).reshape(grid.shape)
    assert solid[everywhere < RADIUS - 0.5 * side].all()  # the tolerance keeps every voxel that is inside
    np.testing.assert_array_equal(share[distance < RADIUS - 1.5 * side], 1)


def test_the_surface_that_one_view_sees_is_kept_with_half_a_voxel(sphere):
    """In front of the ball, along the line of sight: no less, or many views eat it away; no more, or it grows fat."""
    views, rotation, center_up = sphere
    one = Views(views.cameras[:1], views.rgb[:1], views.alpha[:1], views.depth[:1])
    toward = rotation @ views.cameras[0].position - center_up
    toward /= np.linalg.norm(toward)
    side = RADIUS / 4
    surfaces = []
    for step in np.linspace(0, 1, 21):  # one column of voxels, shifted through one voxel
        grid = VoxelGrid(center_up + (RADIUS + step * side) * toward - side / 2, side, (1, 1, 1))
        if carve(grid, DepthLimits(one, dilate=True), rotation).all():
            surfaces.append(step)
    assert max(surfaces) == pytest.approx(0.5, abs=0.1)


def test_what_no_picture_shows_is_not_carved_away(sphere):
    """A voxel outside of a picture, or behind its camera, is not judged by it."""
    views, rotation, center_up = sphere
    one = Views(views.cameras[:1], views.rgb[:1], views.alpha[:1], views.depth[:1])
    camera_up = rotation @ views.cameras[0].position
    behind = camera_up + 2 * (camera_up - center_up)
    grid = VoxelGrid(behind - 0.05, 0.05, (2, 2, 2))
    assert carve(grid, DepthLimits(one, dilate=True), rotation).all()


# ------------------------------------------------------------------------------------------------ density


def _gaussians(means, *, scales, opacity=0.9, quats=None):
    n = len(means)
    return Gaussians(
        means=np.asarray(means, np.float32),
        quats_wxyz=np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)) if quats is None else quats.astype(np.float32),
        scales=np.broadcast_to(np.asarray(scales, np.float32), (n, 3)).copy(),
        opacities=np.full(n, opacity, np.float32),
        sh=np.zeros((n, 1, 3), np.float32),
    )


def test_opacity_is_accumulated_as_a_sum_over_gaussians():
    """Against the plain sum over all Gaussians and voxels in float64."""
    rng = np.random.default_rng(3)
    quats = rng.normal(size=(40, 4))
    quats /= np.linalg.norm(quats, axis=1, keepdims=True)
    gaussians = _gaussians(
        rng.uniform(0.1, 0.9, (40, 3)), scales=rng.uniform(0.01, 0.05, (40, 3)), opacity=0.7, quats=quats
    )
    rotation = rotation_to_z_up(np.array([0.3, -0.8, 0.4]))
    corners = rotation @ np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)]).T
    grid = VoxelGrid.around(corners.min(1), corners.max(1), 0.06, padding=1)
    found = accumulated_opacity(gaussians, grid, rotation)

    covariance = rotation @ gaussians.covariances() @ rotation.T
    floored = covariance + np.eye(3) * (0.35 * grid.side) ** 2
    loss = (np.linalg.det(covariance) / np.linalg.det(floored)) ** (1 / 6)
    apart = grid.all_centers()[:, None] - gaussians.means.astype(float) @ rotation.T
    q = np.einsum("vna,nab,vnb->vn", apart, np.linalg.inv(floored), apart)
    expected = (np.where(q < 9, np.exp(-0.5 * q), 0) * 0.7 * loss).sum(1).reshape(grid.shape)
    np.testing.assert_allclose(found, expected, atol=2e-3 * expected.max())


@pytest.mark.parametrize("normal_axis", [0, 2])
def test_a_leaf_thinner_than_a_voxel_leaves_no_hole(normal_axis):
    """Flat Gaussians between two planes of voxel centres are found all the same, on both sides."""
    along = (np.arange(60) + 0.5) * 0.5
    plane = np.stack(np.meshgrid(along, along, indexing="ij"), -1).reshape(-1, 2)
    means = np.insert(plane, normal_axis, 15.0, axis=1)
    scales = np.insert([0.4, 0.4], normal_axis, 0.02)
    gaussians = _gaussians(means, scales=scales)
    grid = VoxelGrid(np.zeros(3), 1.0, (30, 30, 30))
    solid = accumulated_opacity(gaussians, grid, np.eye(3)) > density_threshold(gaussians, grid, np.eye(3))
    planes = np.moveaxis(solid, normal_axis, 0)
    assert planes[14:16].all()
    assert not planes[:13].any() and not planes[17:].any()


def test_the_threshold_follows_how_densely_a_capture_is_drawn():
    grid = VoxelGrid(np.zeros(3), 1.0, (10, 10, 10))
    corner = np.stack(np.meshgrid(*[np.arange(10)] * 3, indexing="ij"), -1).reshape(-1, 3) + 0.5

    def threshold(per_voxel, opacity=0.9):
        return density_threshold(
            _gaussians(np.repeat(corner, per_voxel, 0), scales=0.2, opacity=opacity), grid, np.eye(3)
        )

    assert threshold(1) == threshold(2) == pytest.approx(0.3)
    assert threshold(5) == threshold(8) == pytest.approx(0.6)
    assert 0.3 < threshold(3) < threshold(4) < 0.6
    assert threshold(3, opacity=0.05) == threshold(3)  # a capture of faint Gaussians only is still a capture
    outside = _gaussians([[99.0, 0, 0]], scales=0.2)
    assert density_threshold(outside, grid, np.eye(3)) == pytest.approx(0.3)


def test_an_object_without_substance_is_refused_in_one_sentence(sphere):
    views, rotation, _ = sphere
    empty = Views(views.cameras, views.rgb, np.zeros_like(views.alpha), np.zeros_like(views.depth))
    haze = _gaussians(np.random.default_rng(0).normal(CENTER, 0.2, (500, 3)), scales=0.01, opacity=0.01)
    parts = Parts(np.zeros(500, np.int32), ("haze",), "test")
    with pytest.raises(StageError, match="no solid was found") as caught:
        discover_interior(haze, empty, parts, frame=Frame(rotation, 0.3), cell=0.05)
    assert "\n" not in str(caught.value)
