"""Meshes of others: even samples, the right colours in the right places, and damaged files in one sentence."""

import json
import logging
import struct

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage
from scipy.spatial import KDTree

trimesh = pytest.importorskip("trimesh", reason="reading meshes needs trimesh (extra 'mesh')")

from phys4dgen.errors import FormatError, StageError  # noqa: E402
from phys4dgen.formats import load_gaussians  # noqa: E402
from phys4dgen.reconstruct.mesh import files  # noqa: E402
from phys4dgen.reconstruct.mesh.bounds import FilesBeside  # noqa: E402
from phys4dgen.reconstruct.mesh.colors import linear_to_srgb, srgb_to_linear  # noqa: E402
from phys4dgen.reconstruct.mesh.files import is_mesh, read_surfaces  # noqa: E402
from phys4dgen.reconstruct.mesh.gaussians import FLATNESS, gaussians_from_mesh, gaussians_on_surfaces  # noqa: E402
from phys4dgen.reconstruct.mesh.sampling import even_samples  # noqa: E402
from phys4dgen.reconstruct.mesh.surface import Surface  # noqa: E402
from phys4dgen.render.cameras import view_cameras  # noqa: E402
from phys4dgen.render.views import render_views  # noqa: E402
from phys4dgen.run.generate import generate  # noqa: E402
from phys4dgen.scene import Scene  # noqa: E402
from phys4dgen.types import rotation_from_quats  # noqa: E402


def ball(subdivisions=4):
    return trimesh.creation.icosphere(subdivisions=subdivisions)


def square(image=None, *, repeat=1.0, **material):
    """Two triangles over [0, 1]^2 in the plane z = 0, the texture upright on them."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    visual = trimesh.visual.TextureVisuals(
        uv=corners[:, :2] * repeat,
        material=trimesh.visual.material.PBRMaterial(baseColorTexture=image, **material),
    )
    return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], visual=visual, process=False)


def quarters(size=64):
    """Red above left, green above right, blue below left, white below right."""
    picture = np.zeros((size, size, 4), np.uint8)
    picture[..., 3] = 255
    half = size // 2
    picture[:half, :half, 0] = picture[:half, half:, 1] = picture[half:, :half, 2] = 255
    picture[half:, half:] = 255
    return Image.fromarray(picture)


def at(gaussians, point, radius=0.1):
    """Mean colour of the Gaussians round a point."""
    near = np.linalg.norm(gaussians.means - point, axis=1) < radius
    assert near.any()
    return gaussians.base_colors[near].mean(0)


def test_samples_are_evenly_spread():
    triangles = np.asarray(ball().triangles)
    samples = even_samples(triangles, 4000)
    assert len(samples.points) == pytest.approx(4000, rel=0.08)
    nearest = KDTree(samples.points).query(samples.points, k=2)[0][:, 1]
    assert nearest.min() > 0.7 * samples.spacing
    dense = even_samples(triangles, 60_000, seed=1).points
    farthest = KDTree(samples.points).query(dense)[0].max()
    assert farthest < 1.35 * samples.spacing  # points drawn at random leave gaps of twice that
    area = 0.5 * np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    assert samples.spacing == pytest.approx(np.sqrt(area.sum() / len(samples.points)))
    rebuilt = np.einsum("nk,nkd->nd", samples.weights, triangles[samples.faces])
    np.testing.assert_allclose(rebuilt, samples.points)


def test_both_sides_of_a_thin_wall_are_sampled():
    box = trimesh.creation.box((1, 1, 1e-4))
    samples = even_samples(np.asarray(box.triangles), 2000)
    above = samples.normals[:, 2] > 0.5
    assert above.mean() == pytest.approx(0.5, abs=0.05)


def test_triangles_of_any_size_get_their_share():
    small = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    triangles = np.stack([small, 3 * small + 10, np.zeros((3, 3))])
    samples = even_samples(triangles, 3000)
    counts = np.bincount(samples.faces, minlength=3)
    assert counts[2] == 0
    assert counts[1] / counts[0] == pytest.approx(9, rel=0.15)
    with pytest.raises(ValueError, match="without area"):
        even_samples(np.zeros((2, 3, 3)), 10)


def test_a_texture_lies_the_right_way_round(tmp_path):
    for name in ("square.glb", "square.obj"):
        square(quarters()).export(tmp_path / name)
        made = gaussians_from_mesh(tmp_path / name, count=2000)
        for point, color in (
            ((0.25, 0.75, 0), (1, 0, 0)),
            ((0.75, 0.75, 0), (0, 1, 0)),
            ((0.25, 0.25, 0), (0, 0, 1)),
            ((0.75, 0.25, 0), (1, 1, 1)),
        ):
            np.testing.assert_allclose(at(made, point), color, atol=0.02)


def test_a_texture_repeats_and_is_averaged_where_it_is_finer_than_the_gaussians():
    stripes = np.zeros((64, 64, 4), np.float32)
    stripes[:, ::2, 0] = 1
    stripes[..., 3] = 1
    flat = np.array([[[0.0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0.0, 0, 0], [1, 1, 0], [0, 1, 0]]])
    plain = Surface(flat, np.ones((2, 3, 4), np.float32), flat[..., :2] * 4, stripes)
    made = gaussians_on_surfaces([plain], count=1000)
    np.testing.assert_allclose(made.base_colors[:, 0], 0.5, atol=0.02)
    wide = Surface(flat, plain.corner_rgba, flat[..., :2] * 4, np.asarray(quarters(8), np.float32) / np.float32(255))
    repeated = gaussians_on_surfaces([wide], count=20_000)
    for x, y in ((0.0625, 0.1875), (0.5625, 0.9375)):  # the red quarter of two of the sixteen copies
        np.testing.assert_allclose(at(repeated, (x, y, 0), 0.03), (1, 0, 0), atol=0.05)


def test_colors_of_vertices_and_faces(tmp_path):
    mesh = ball(3)
    mesh.visual.vertex_colors = np.rint((mesh.vertices + 1) / 2 * 255).astype(np.uint8)
    for name in ("ball.ply", "ball.obj", "ball.glb"):
        mesh.export(tmp_path / name)
        made = gaussians_from_mesh(tmp_path / name, count=2000)
        expected = (made.means + 1) / 2
        assert np.abs(made.base_colors - expected).max() < 0.08, name
    box = trimesh.creation.box()
    box.visual.face_colors = np.where(box.face_normals[:, 2:] > 0.5, [[255, 0, 0, 255]], [[0, 0, 255, 255]])
    box.export(tmp_path / "box.ply")
    made = gaussians_from_mesh(tmp_path / "box.ply", count=2000)
    top = made.means[:, 2] > 0.49999
    np.testing.assert_allclose(made.base_colors[top], np.tile([1, 0, 0], (top.sum(), 1)), atol=1e-3)
    np.testing.assert_allclose(made.base_colors[~top], np.tile([0, 0, 1], ((~top).sum(), 1)), atol=1e-3)


def with_header(path, edit):
    """The binary glTF with its JSON edited."""
    data = path.read_bytes()
    length = int.from_bytes(data[12:16], "little")
    header = json.loads(data[20 : 20 + length])
    edit(header)
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    path.write_bytes(
        b"glTF"
        + struct.pack("<II", 2, 20 + len(text) + len(rest))
        + struct.pack("<I", len(text))
        + b"JSON"
        + text
        + rest
    )


def test_gltf_colors_are_linear_unless_trimesh_wrote_them(tmp_path):
    mesh = ball(2)
    grey = np.tile(np.array([[64, 64, 64, 255]], np.uint8), (len(mesh.vertices), 1))
    grey[0] = 65  # not of one colour throughout, so not shaded
    mesh.visual.vertex_colors = grey
    mesh.export(tmp_path / "a.glb")
    by_trimesh = gaussians_from_mesh(tmp_path / "a.glb", count=1500)
    assert np.median(by_trimesh.base_colors) == pytest.approx(64 / 255, abs=0.01)
    with_header(tmp_path / "a.glb", lambda header: header.update(asset={"version": "2.0", "generator": "other"}))
    by_others = gaussians_from_mesh(tmp_path / "a.glb", count=1500)
    assert np.median(by_others.base_colors) == pytest.approx(float(linear_to_srgb(np.array(64 / 255))), abs=0.01)


def test_srgb_there_and_back():
    values = np.linspace(0, 1, 100)
    np.testing.assert_allclose(linear_to_srgb(srgb_to_linear(values)), values, atol=1e-6)


def test_holes_of_a_mask_get_no_gaussians_and_glass_is_thin(tmp_path):
    picture = quarters()
    alpha = np.full((64, 64), 255, np.uint8)
    alpha[:32, :32] = 60
    picture.putalpha(Image.fromarray(alpha))
    square(picture, alphaMode="MASK").export(tmp_path / "mask.glb")
    masked = gaussians_from_mesh(tmp_path / "mask.glb", count=2000)
    cornerwise = np.abs(masked.means[:, :2] - [0.25, 0.75]).max(1)
    assert cornerwise.min() > 0.2  # at the rim the texture repeats, and its other side is opaque
    assert masked.opacities.min() > 0.97
    square(picture, alphaMode="BLEND").export(tmp_path / "blend.glb")
    blended = gaussians_from_mesh(tmp_path / "blend.glb", count=2000)
    glass = np.abs(blended.means[:, :2] - [0.25, 0.75]).max(1) < 0.2
    np.testing.assert_allclose(blended.opacities[glass], 0.98 * 60 / 255, atol=0.02)
    square(picture).export(tmp_path / "opaque.glb")
    assert gaussians_from_mesh(tmp_path / "opaque.glb", count=2000).opacities.min() > 0.97


def test_discs_lie_in_the_surface_and_a_plain_mesh_is_shaded_from_above(tmp_path):
    ball().export(tmp_path / "ball.stl")
    made = gaussians_from_mesh(tmp_path / "ball.stl", count=3000)
    normals = rotation_from_quats(made.quats_wxyz)[:, :, 2]
    np.testing.assert_allclose((normals * made.means).sum(1), np.linalg.norm(made.means, axis=1), atol=0.01)
    np.testing.assert_allclose(made.scales[:, 2], FLATNESS * made.scales[:, 0], rtol=1e-5)
    np.testing.assert_array_equal(made.scales[:, 0], made.scales[:, 1])
    upper = made.base_colors[(made.means[:, 1] > 0.8)].mean()
    lower = made.base_colors[(made.means[:, 1] < -0.8)].mean()
    assert upper > lower + 0.2
    inverted = ball()
    inverted.invert()
    inverted.export(tmp_path / "inverted.stl")
    turned = gaussians_from_mesh(tmp_path / "inverted.stl", count=3000)
    assert turned.base_colors[turned.means[:, 1] > 0.8].mean() == pytest.approx(upper, abs=0.03)


def test_the_wall_is_closed_from_all_sides(tmp_path):
    box = trimesh.creation.box((1, 0.6, 0.4))
    box.export(tmp_path / "box.stl")
    made = gaussians_from_mesh(tmp_path / "box.stl", count=20_000)
    lower, upper = made.robust_bounds()
    cameras = view_cameras("object", lower=lower, upper=upper, rotation=np.eye(3), size_px=128)[::4]
    for alpha in render_views(made, cameras).alpha:
        inside = ndimage.binary_erosion(ndimage.binary_closing(alpha > 0.5, iterations=3), iterations=2)
        assert ((alpha < 0.95) & inside).sum() <= 0.002 * inside.sum()


def test_every_place_of_a_mesh_in_the_scene_counts(tmp_path):
    scene = trimesh.Scene()
    scene.add_geometry(ball(2), geom_name="ball")
    twice = trimesh.transformations.scale_and_translate(2.0, (5, 0, 0))
    scene.graph.update(frame_to="second", matrix=twice, geometry="ball")
    scene.export(tmp_path / "scene.glb")
    made = gaussians_from_mesh(tmp_path / "scene.glb", count=5000)
    second = made.means[:, 0] > 2
    assert second.mean() == pytest.approx(0.8, abs=0.03)
    np.testing.assert_allclose(np.linalg.norm(made.means[second] - [5, 0, 0], axis=1), 2, atol=0.15)


def test_ply_files_are_told_apart(tmp_path, random_gaussians):
    from phys4dgen.formats import save_gaussians

    ball(1).export(tmp_path / "mesh.ply")
    save_gaussians(random_gaussians(5), tmp_path / "splat.ply")
    trimesh.PointCloud(np.zeros((3, 3))).export(tmp_path / "points.ply")
    assert is_mesh(tmp_path / "mesh.ply")
    assert not is_mesh(tmp_path / "splat.ply")
    assert not is_mesh(tmp_path / "points.ply")
    assert not is_mesh(tmp_path / "absent.ply")
    assert is_mesh("a.GLB")
    with pytest.raises(FormatError, match="trained or converted"):
        load_gaussians(tmp_path / "points.ply")
    with pytest.raises(FormatError, match=r"is a mesh.*phys4dgen generate"):
        load_gaussians_of_suffix(tmp_path, ".glb")


def load_gaussians_of_suffix(folder, suffix):
    (folder / f"a{suffix}").write_bytes(b"glTF")
    return load_gaussians(folder / f"a{suffix}")


def cut(data):
    return data[: len(data) * 2 // 3]


def promise(header):
    header["accessors"].append({"componentType": 5126, "type": "VEC3", "count": 2**36})


def repeat_accessors(header):
    header["accessors"] *= 500


def elsewhere(header):
    header["accessors"][0]["bufferView"] = 99


def bad_count(header):
    header["accessors"][0]["count"] = -1


def no_scene(header):
    header["meshes"] = 3


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (promise, "promises .* bytes"),
        (repeat_accessors, "promises .* bytes"),
        (bad_count, "header is damaged"),
        (elsewhere, "cannot read it as a mesh"),
        (no_scene, "cannot read it as a mesh"),
    ],
)
def test_damaged_gltf_headers(tmp_path, edit, message):
    ball(2).export(tmp_path / "a.glb")
    with_header(tmp_path / "a.glb", edit)
    with pytest.raises(FormatError, match=message) as raised:
        gaussians_from_mesh(tmp_path / "a.glb", count=1000)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("suffix", [".glb", ".ply", ".stl"])
def test_files_that_are_cut_off(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    ball(2).export(path)
    path.write_bytes(cut(path.read_bytes()))
    with pytest.raises(FormatError, match="cannot read it as a mesh") as raised:
        gaussians_from_mesh(path, count=1000)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.glb", b""),
        ("b.glb", b"garbage" * 10),
        ("c.obj", b"v 0 0 0\nv 1 0 0\nf 1 2 9\n"),
        ("d.obj", b"v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n"),
        ("e.obj", b"v 0 0 0\nv 1e300 0 0\nv 0 1 0\nf 1 2 3\n"),
        ("f.obj", b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"),
        ("g.obj", b"# nothing\n"),
        ("j.obj", b"v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n"),
        ("h.stl", b"solid nothing\nendsolid nothing\n"),
        ("i.ply", b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
         b"element face 900000000\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"),
    ],
)  # fmt: skip
def test_what_is_no_mesh_ends_in_one_sentence(tmp_path, name, data):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(FormatError) as raised:
        gaussians_from_mesh(tmp_path / name, count=1000)
    assert name in str(raised.value)
    assert "\n" not in str(raised.value)


def test_files_outside_the_folder_of_the_mesh_are_not_read(tmp_path):
    (tmp_path / "secret.png").write_bytes(b"x")
    folder = tmp_path / "mesh"
    folder.mkdir()
    (folder / "near.png").write_bytes(b"y")
    (folder / "passwords.txt").write_bytes(b"z")
    beside = FilesBeside(folder)
    assert beside["near.png"] == b"y"
    assert list(beside) == ["near.png"]
    for name in ("../secret.png", str(tmp_path / "secret.png"), "passwords.txt", "absent.png"):
        with pytest.raises(KeyError):
            beside[name]


def test_many_triangles_are_refused_before_they_are_kept(tmp_path, monkeypatch):
    ball(2).export(tmp_path / "a.stl")
    monkeypatch.setattr(files, "MAX_TRIANGLES", 300)
    with pytest.raises(FormatError, match="more than 300 triangles"):
        read_surfaces(tmp_path / "a.stl")


def test_a_damaged_mesh_is_one_sentence_and_nothing_in_the_log_of_others(tmp_path, capfd):
    """What trimesh logs on its way would reach the terminal: Python writes what no handler takes."""
    text = ball(1).export(file_type="stl_ascii").replace("facet normal 0", "facet normal x", 1)
    (tmp_path / "a.stl").write_text(text)
    handlers, logging.getLogger().handlers = logging.getLogger().handlers, []
    try:
        assert read_surfaces(tmp_path / "a.stl")  # the normals are not needed
    finally:
        logging.getLogger().handlers = handlers
    assert capfd.readouterr() == ("", "")


def test_without_trimesh_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "trimesh_is_installed", lambda: False)
    with pytest.raises(StageError, match=r"phys4dgen\[mesh\]"):
        gaussians_from_mesh(tmp_path / "a.stl", count=1000)


def test_generate_takes_a_mesh_and_goes_on_from_its_folder(tmp_path):
    square(quarters()).export(tmp_path / "flat.glb")
    thick = trimesh.creation.box((1, 2, 1))
    thick.export(tmp_path / "box.glb")
    scene = Scene(input=tmp_path / "box.glb").with_overrides({"reconstruct.mesh_gaussians": 1500, "views.size_px": 64})
    run = generate(scene, tmp_path / "run", until="reconstruct")
    facts = json.loads((run.root / "reconstruct" / "source.json").read_text())
    assert facts == {"backend": "mesh, its surface sampled", "up": [0.0, 1.0, 0.0]}
    assert len(load_gaussians(run.root / "gaussians.ply")) == pytest.approx(1500, rel=0.1)
    again = generate(scene, tmp_path / "run", until="views")
    assert not any("guess" in warning for warning in again.report["warnings"])
    assert (again.root / "views" / "cameras.json").is_file()
