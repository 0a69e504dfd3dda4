"""The object in a captured scene: it alone moves, and the rest is the same bytes in every frame."""

import json

import numpy as np
import pytest
from PIL import Image

from lollipop import lollipop
from phys4dgen.cli import main
from phys4dgen.errors import FormatError, SceneError
from phys4dgen.export.trajectory import read_trajectory
from phys4dgen.formats import load_gaussians, save_gaussians
from phys4dgen.run.generate import generate
from phys4dgen.scene import Scene
from phys4dgen.stages.selection import surroundings_of
from phys4dgen.types import Gaussians
from phys4dgen.zoo.catalogue import bundled


def room_round(thing, *, up, walls=3.0, count=3000):
    """Floor under an object and three walls round it, shuffled among its Gaussians; returns all, and which are it."""
    rng = np.random.default_rng(11)
    lower, upper = thing.robust_bounds()
    size, middle = float((upper - lower).max()), (lower + upper) / 2
    up = np.asarray(up, float)
    side, back = np.eye(3)[np.flatnonzero(up == 0)]
    floor = middle - up * float(np.abs(up) @ (upper - lower)) / 2 - 0.01 * size * up
    a, b = rng.uniform(-walls / 2, walls / 2, (2, count, 1)) * size
    sheets = [
        floor + a * side + b * back,
        floor + (walls / 2 * size) * back + a * side + (b + walls / 2 * size) * up,
        floor + (walls / 2 * size) * side + a * back + (b + walls / 2 * size) * up,
    ]
    n = 3 * count
    quats = rng.normal(size=(n, 4))
    room = Gaussians(
        means=np.concatenate(sheets),
        quats_wxyz=quats / np.linalg.norm(quats, axis=1, keepdims=True),
        scales=np.exp(rng.normal(np.log(0.03 * size), 0.2, (n, 3))),
        opacities=rng.uniform(0.5, 0.95, n),
        sh=np.zeros((n, thing.sh.shape[1], 3)) + np.r_[np.ones(1), np.zeros(thing.sh.shape[1] - 1)][:, None] * 0.8,
    )
    joined = Gaussians(**{name: np.concatenate([getattr(thing, name), getattr(room, name)]) for name in vars(thing)})
    order = rng.permutation(len(joined))
    return joined.subset(order), order < len(thing)


def box_round(thing):
    """As text for --select-box; the floor lies just below it."""
    margin = 0.004 * float(np.ptp(thing.means, axis=0).max())
    lower, upper = thing.means.min(0) - margin, thing.means.max(0) + margin
    return ",".join(f"{value:.6g}" for value in (*lower, *upper))


QUICK = {
    "simulation.grid": 16,
    "simulation.duration_s": 0.25,
    "simulation.max_substeps": 60,
    "simulation.chunks": 1,
    "motion.preset": "sway",
    "motion.acceleration_ms2": 8.0,
    "views.size_px": 64,
    "output.video.width": 96,
}


def assert_only_the_object_moves(run, is_object, *, least):
    """Arrays and bytes of the rest are those of the input in every frame."""
    whole = load_gaussians(run.root / "gaussians.ply")
    trajectory = read_trajectory(run.root / "trajectory.npz")
    assert trajectory.positions.shape[1] == len(whole) == len(is_object)
    assert (trajectory.positions[:, ~is_object] == whole.means[~is_object]).all()
    assert (trajectory.deformation_gradients[:, ~is_object] == np.eye(3)).all()
    moved = np.linalg.norm(trajectory.positions[-1] - trajectory.positions[0], axis=1)[is_object]
    assert np.percentile(moved, 95) > least
    first = None
    for path in sorted((run.root / "frames").glob("*.ply")):
        body = path.read_bytes()[-len(whole) * 4 * (17 + 3 * (whole.sh.shape[1] - 1)) :]
        rows = np.frombuffer(body, np.uint8).reshape(len(whole), -1)
        first = rows[~is_object] if first is None else first
        np.testing.assert_array_equal(rows[~is_object], first, err_msg=path.name)
        assert (rows[is_object] != np.frombuffer(body, np.uint8).reshape(len(whole), -1)[is_object][:1]).any()
    labels = np.load(run.root / "groups.npz")["labels"]
    np.testing.assert_array_equal(labels >= 0, is_object)
    assert run.report["counts"]["selected"] == is_object.sum()
    with Image.open(run.root / "views" / "selection.png") as picture:
        assert picture.size == (1536, 384)


@pytest.fixture(scope="module")
def lollipop_room(tmp_path_factory):
    """A lollipop in a room, on disk, its labels, and what is the lollipop."""
    thing, labels = lollipop()
    whole, is_object = room_round(thing, up=[0, 0, 1])
    folder = tmp_path_factory.mktemp("room")
    save_gaussians(whole, folder / "room.ply")
    order = np.full(len(whole), -1, np.int32)
    order[is_object] = labels[_order_of(whole, thing, is_object)]
    np.savez(folder / "labels.npz", labels=order, names=np.array(["block", "stick", "ball"]))
    return folder, thing, is_object


def _order_of(whole, thing, is_object):
    """Which Gaussian of ``thing`` stands in each row of ``whole`` that is it."""
    place = {mean.tobytes(): number for number, mean in enumerate(thing.means)}
    return np.array([place[mean.tobytes()] for mean in whole.means[is_object]])


@pytest.fixture(scope="module")
def lollipop_run(lollipop_room):
    folder, thing, _ = lollipop_room
    scene = Scene(input=folder / "room.ply").with_overrides(
        {
            **QUICK,
            "up": "z",
            "height_m": 0.2,
            "select.box": box_round(thing),
            "grouping.labels_file": str(folder / "labels.npz"),
            "parts.block.hold": "fixed",
        }
    )
    return generate(scene, folder / "run")


def test_only_the_lollipop_moves(lollipop_run, lollipop_room):
    assert_only_the_object_moves(lollipop_run, lollipop_room[2], least=1e-3)
    assert [part["name"] for part in lollipop_run.report["parts"]] == ["block", "stick", "ball"]
    assert lollipop_run.report["metres_per_unit"] == pytest.approx(
        1, rel=0.1
    )  # 0.2 m are the lollipop's, not the room's


def test_the_rest_can_be_hidden(lollipop_run, lollipop_room):
    _, _, is_object = lollipop_room
    scene = Scene.model_validate(lollipop_run_scene(lollipop_run)).with_overrides({"select.rest": "hide"})
    run = generate(scene, lollipop_run.root.with_name("hidden"))
    frame = load_gaussians(run.root / "frames" / "frame_0003.ply")
    assert (frame.opacities[~is_object] < 1e-3).all()
    assert (frame.opacities[is_object] > 0.5).all()
    with Image.open(run.root / "preview.png") as hidden, Image.open(lollipop_run.root / "preview.png") as static:
        assert np.asarray(hidden).mean() > np.asarray(static).mean() + 5  # white paper instead of walls


def lollipop_run_scene(run):
    from phys4dgen.run.generate import scene_of_run

    return scene_of_run(run.root).model_dump()


@pytest.mark.parametrize("name", ["plant.splat", "potted_flower"])
def test_a_plant_in_a_room(name, request, tmp_path):
    if name == "plant.splat":
        thing = load_gaussians(request.getfixturevalue("shared_data") / "splats" / name)
        up, flag = [0, -1, 0], "-y"
    else:
        flower = bundled(name)
        thing, up, flag = flower.gaussians.subset(slice(None, None, 4)), flower.up.round(), "z"
    whole, is_object = room_round(thing, up=up, count=2000)
    box = box_round(thing)
    save_gaussians(whole, tmp_path / "room.ply")
    low, high = np.array([float(word) for word in box.split(",")]).reshape(2, 3)
    is_object = ((whole.means >= low) & (whole.means <= high)).all(1)
    assert is_object.sum() < len(thing) + 200
    scene = Scene(input=tmp_path / "room.ply").with_overrides(
        {**QUICK, "up": flag, "height_m": 0.35, "select.box": box, "grouping.backend": "none"}
    )
    run = generate(scene, tmp_path / "run")
    assert_only_the_object_moves(run, is_object, least=1e-3 * float(np.ptp(thing.means, axis=0).max()))


def test_box_sphere_and_labels_choose_together(lollipop_room):
    folder, _, is_object = lollipop_room
    scene, whole = Scene(input=folder / "room.ply"), load_gaussians(folder / "room.ply")
    assert surroundings_of(scene, whole) is None

    def rows(**wanted):
        return surroundings_of(scene.with_overrides({f"select.{key}": value for key, value in wanted.items()}), whole)

    labels_file = str(folder / "labels.npz")
    all_labels = rows(labels_file=labels_file, labels="0,1,2")
    np.testing.assert_array_equal(all_labels.object_rows, np.flatnonzero(is_object))
    by_name = rows(labels_file=labels_file, labels=["ball"])
    assert len(by_name.object_rows) == 500
    inside = rows(sphere="0,0,0.17,0.05")
    assert 400 < len(inside.object_rows) < 700
    both = rows(sphere="0,0,0.17,0.05", labels_file=labels_file, labels=["stick"])
    assert set(both.object_rows) < set(inside.object_rows)
    means = whole.means[rows(box=[-1, -1, 0.1, 1, 1, 0.3]).object_rows]
    assert means[:, 2].min() >= 0.1
    assert means[:, 2].max() <= 0.3


@pytest.mark.parametrize(
    ("wanted", "says"),
    [
        ({"box": "0,0,0,1,1"}, "6 numbers such as"),
        ({"box": "0,0,0,1,-1,1"}, "y0 < y1"),
        ({"sphere": "0,0,0,0"}, "radius greater than 0"),
        ({"labels": "ball"}, "belong together"),
        ({"rest": "delete"}, "'static' or 'hide'"),
        ({"box": "50,50,50,51,51,51"}, "0 of 10500 Gaussians are selected"),
    ],
)
def test_what_is_wrong_is_said(lollipop_room, wanted, says):
    folder, _, _ = lollipop_room
    whole = load_gaussians(folder / "room.ply")
    with pytest.raises(SceneError, match=says):
        surroundings_of(
            Scene(input=folder / "room.ply").with_overrides({f"select.{key}": value for key, value in wanted.items()}),
            whole,
        )


def test_labels_that_do_not_fit_are_named(lollipop_room, tmp_path):
    folder, _, _ = lollipop_room
    whole = load_gaussians(folder / "room.ply")
    scene = Scene(input=folder / "room.ply").with_overrides(
        {"select.labels_file": str(folder / "labels.npz"), "select.labels": ["bal"]}
    )
    with pytest.raises(SceneError, match=r"no label 'bal'.*Did you mean 'ball'"):
        surroundings_of(scene, whole)
    np.save(tmp_path / "short.npy", np.zeros(7, np.int32))
    short = scene.with_overrides({"select.labels_file": str(tmp_path / "short.npy"), "select.labels": [0]})
    with pytest.raises(FormatError, match="one whole number for each of the input's 10500"):
        surroundings_of(short, whole)


def test_inspect_tells_what_a_box_holds(lollipop_room, capsys):
    folder, thing, is_object = lollipop_room
    words = ["inspect", str(folder / "room.ply"), "--json", "--select-box", box_round(thing)]
    assert main([*words, "--picture", str(folder / "seen.png")]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["selected"]["count"] == is_object.sum()
    assert len(facts["bounds"]["quantiles"]["x"]) == 7
    np.testing.assert_allclose(facts["selected"]["robust_extent"], np.ptp(thing.means, axis=0), rtol=0.2)
    with Image.open(folder / "seen.png") as picture:
        assert picture.size == (1536, 384)
