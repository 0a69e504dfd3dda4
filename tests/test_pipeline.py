"""The whole job on the bundled flower: a complete run folder, resumed to the same arrays, and true masses."""

import json
import time

import numpy as np
import pytest

from phys4dgen.export.trajectory import read_trajectory
from phys4dgen.formats import load_gaussians, save_gaussians
from phys4dgen.interior import discover_interior
from phys4dgen.progress import SILENT
from phys4dgen.render.cameras import view_cameras
from phys4dgen.render.rasterise import Rasteriser, packed_covariances
from phys4dgen.render.views import render_views
from phys4dgen.run.generate import generate
from phys4dgen.scene import Scene, load_scene
from phys4dgen.stages.asset import load
from phys4dgen.stages.film import film
from phys4dgen.stages.motion import Motion
from phys4dgen.stages.motion_facts import MotionFacts
from phys4dgen.stages.reconstruct import reconstruct
from phys4dgen.types import Frame, Gaussians, Parts, rotation_to_z_up
from phys4dgen.yaml12 import read_yaml
from phys4dgen.zoo.flower_shapes import WALL_M
from phys4dgen.zoo.potted_flower import potted_flower

FRAMES = 12
CONTRACT = (
    "scene.yaml",
    "gaussians.ply",
    "views/cameras.json",
    "parts.png",
    "groups.npz",
    "continuum.npz",
    "materials.yaml",
    "trajectory.npz",
    "motion.json",
    "video.mp4",
    "preview.png",
    "contact_sheet.png",
    "report.json",
    "log.jsonl",
)
MOVING = ("petals", "heart")
STILL = ("pot", "soil")


@pytest.fixture(scope="module")
def flower():
    return potted_flower()


@pytest.fixture(scope="module")
def scene(flower, tmp_path_factory):
    """The demo on a fourth of the Gaussians, each twice as wide, on a coarse grid: a run in seconds."""
    some = np.arange(0, len(flower.gaussians), 4)
    part = flower.gaussians.subset(some)
    thinned = Gaussians(part.means, part.quats_wxyz, part.scales * np.float32([2, 2, 1]), part.opacities, part.sh)
    folder = tmp_path_factory.mktemp("input")
    save_gaussians(thinned, folder / "flower.ply")
    np.savez(folder / "labels.npz", labels=flower.labels[some], names=np.array(flower.part_names))
    return Scene.model_validate({"input": folder / "flower.ply", **flower.default_scene}).with_overrides(
        {
            "grouping.labels_file": folder / "labels.npz",
            "simulation.grid": 24,
            "simulation.duration_s": 0.5,
            "simulation.fps": 24.0,
            "simulation.max_substeps": 200,
            "simulation.chunks": 1,
            "views.size_px": 64,
            "output.video.width": 128,
        }
    )


@pytest.fixture(scope="module")
def run(scene, tmp_path_factory):
    """An undisturbed run."""
    return generate(scene, tmp_path_factory.mktemp("undisturbed") / "run")


@pytest.fixture(scope="module")
def still(scene):
    """The input."""
    return load_gaussians(scene.input)


# ------------------------------------------------------------------------------------------------ the run folder


def test_the_run_folder_is_complete(run, scene, still):
    assert [name for name in CONTRACT if not (run.root / name).is_file()] == []
    frames = sorted(path.name for path in (run.root / "frames").iterdir())
    assert frames == [f"frame_{k:04d}.ply" for k in range(FRAMES)]
    leftovers = [path.name for path in run.root.rglob("*partial*")]
    assert leftovers == []
    with np.load(run.root / "groups.npz") as groups:
        assert groups["labels"].shape == (len(still),)
        assert groups["names"].tolist() == list(scene.grouping.names.values())
    with np.load(run.root / "continuum.npz") as particles:
        assert {"positions", "group", "is_interior", "volume_m3", "gaussian_index"} <= set(particles.files)
    assert all(json.loads(line) for line in (run.root / "log.jsonl").read_text("utf-8").splitlines())


def test_the_scene_file_says_what_was_chosen_and_can_be_given_back(run, scene):
    kept = load_scene(run.root / "scene.yaml")
    chosen = run.report["motion"]
    assert chosen["preset"] == "sway"
    assert kept.motion.acceleration_ms2 == pytest.approx(chosen["gust_ms2"])
    assert chosen["gust_ms2"] > 0
    assert kept.input == scene.input
    assert kept.simulation.grid == 24


def test_frame_0_is_the_input_to_the_bit(run, still):
    for path in (run.root / "gaussians.ply", run.root / "frames" / "frame_0000.ply"):
        first = load_gaussians(path)
        for name in ("means", "scales", "opacities", "sh"):
            np.testing.assert_array_equal(getattr(first, name), getattr(still, name), err_msg=name)
        # Reading normalises quaternions, which may turn the last bit of one that is normal already.
        np.testing.assert_allclose(first.quats_wxyz, still.quats_wxyz, rtol=0, atol=1.2e-7)
    trajectory = read_trajectory(run.root / "trajectory.npz")
    np.testing.assert_array_equal(trajectory.positions[0], still.means)
    np.testing.assert_array_equal(trajectory.deformation_gradients[0], np.tile(np.eye(3), (len(still), 1, 1)))
    np.testing.assert_allclose(trajectory.times_s, np.arange(FRAMES) / 24)


def test_every_frame_keeps_number_and_order(run, still):
    """What does not move with a Gaussian names it: opacity and base colour."""
    for k in range(FRAMES):
        frame = load_gaussians(run.root / "frames" / f"frame_{k:04d}.ply")
        assert frame.sh_degree == still.sh_degree
        np.testing.assert_array_equal(frame.opacities, still.opacities)
        np.testing.assert_array_equal(frame.sh[:, 0], still.sh[:, 0])
        assert np.isfinite(frame.means).all()


def test_the_pot_stands_and_the_flower_moves(run, scene, still):
    trajectory = read_trajectory(run.root / "trajectory.npz")
    height = np.ptp(still.means[:, 1])
    moved = np.linalg.norm(trajectory.positions - still.means, axis=2).max(0) / height
    with np.load(run.root / "groups.npz") as groups:
        labels, names = groups["labels"], groups["names"].tolist()
    for part in STILL:
        assert moved[labels == names.index(part)].max() < 1e-6, part
    for part in MOVING:
        assert np.median(moved[labels == names.index(part)]) > 0.02, part
    free = ~np.isin(labels, [names.index(part) for part in STILL])
    assert np.percentile(moved[free], 99) == pytest.approx(scene.motion.amplitude_rel, rel=0.3)  # as the probe aimed
    # The flower head moves as a whole: with the wind, not in all directions.
    head = np.isin(labels, [names.index(part) for part in MOVING])
    blown = (trajectory.positions[4] - still.means)[head]
    assert np.linalg.norm(blown.mean(0)) > 0.7 * np.linalg.norm(blown, axis=1).mean()


def test_the_report_gives_masses_in_grams_and_thicknesses(run, scene):
    materials = read_yaml(run.root / "materials.yaml")
    with np.load(run.root / "continuum.npz") as particles:
        group, volume_m3 = particles["group"], particles["volume_m3"]
        thickness_m = particles["thickness_m"]
    parts = {part["name"]: part for part in run.report["parts"]}
    assert list(parts) == list(scene.grouping.names.values())
    for number, (name, part) in enumerate(parts.items()):
        mine = group == number
        assert part["particles"] == mine.sum()
        assert part["volume_cm3"] == pytest.approx(1e6 * volume_m3[mine].sum(), rel=1e-6)
        assert part["mass_g"] == pytest.approx(1e-3 * part["volume_cm3"] * part["surface"]["density_kgm3"], rel=1e-6)
        assert run.report["simulation"]["part_mass_g"][name] == pytest.approx(part["mass_g"], rel=1e-6)
    assert part["surface"]["name"] in str(materials)
    leaves = group == list(parts).index("leaves")
    assert parts["leaves"]["thickness_mm"] == pytest.approx(1e3 * np.nanmedian(thickness_m[leaves]), rel=1e-3)
    assert 0.5 < parts["leaves"]["thickness_mm"] < 2.5
    assert parts["soil"]["thickness_mm"] is None
    assert run.report["completed_until"] == "render"
    history = run.report["history"]
    assert {len(series) for series in history.values()} == {FRAMES}
    assert history["substeps"][0] == 0
    assert max(history["energy_kinetic_j"]) > 0


# ------------------------------------------------------------------------------------------------ once and again


def test_the_same_again_returns_at_once_and_changes_nothing(run, scene):
    before = {path: path.stat().st_mtime_ns for path in run.root.rglob("*") if path.suffix in (".npz", ".ply", ".mp4")}
    started = time.perf_counter()
    again = generate(scene, run.root)
    assert time.perf_counter() - started < 2
    assert again.report == run.report
    assert {path: path.stat().st_mtime_ns for path in before} == before


def test_a_run_that_was_interrupted_ends_with_the_same_arrays(run, scene, tmp_path):
    """Stopped after the interior and after the simulation."""
    stopped = generate(scene, tmp_path / "run", until="interior")
    assert stopped.report["completed_until"] == "interior"
    assert not (stopped.root / "trajectory.npz").exists()
    generate(scene, tmp_path / "run", until="simulate")
    finished = generate(scene, tmp_path / "run")
    for name in ("groups.npz", "continuum.npz", "trajectory.npz"):
        with np.load(run.root / name) as expected, np.load(finished.root / name) as found:
            assert set(expected.files) == set(found.files)
            for key in expected.files:
                np.testing.assert_array_equal(found[key], expected[key], err_msg=f"{name}: {key}")
    for k in range(FRAMES):
        name = f"frames/frame_{k:04d}.ply"
        assert (finished.root / name).read_bytes() == (run.root / name).read_bytes(), name
    assert finished.report["motion"] == run.report["motion"]
    assert finished.report["parts"] == run.report["parts"]


def test_a_frame_from_disk_looks_like_the_frame_in_memory(run, scene):
    """> 50 dB, in spite of scales and quaternions in place of covariances and of turned colours as coefficients."""
    asset = load(scene, reconstruct(scene, SILENT), SILENT)
    trajectory = read_trajectory(run.root / "trajectory.npz")

    def frames():
        yield from zip(trajectory.positions, trajectory.deformation_gradients, strict=True)

    facts = MotionFacts("sway", "pot, soil")
    wanted = scene.with_overrides({"output.video.width": 200})
    shot = film(wanted, asset, Motion(trajectory.times_s, frames, facts), SILENT)
    rasteriser = Rasteriser()
    for frame in shot.frames():
        disk = load_gaussians(run.root / "frames" / f"frame_{frame.index:04d}.ply")
        picture = rasteriser.render(
            disk.means,
            packed_covariances(disk.covariances()),
            disk.opacities,
            camera=shot.cameras[frame.index],
            sh=disk.sh,
        )
        error = np.clip(picture.rgb, 0, 1) - frame.image / 255
        assert -10 * np.log10((error**2).mean() + 1e-12) > 50, frame.index
        assert frame.image.std() > 20  # there is something to be seen


# ------------------------------------------------------------------------------------------------ true masses


@pytest.fixture(scope="module")
def interior(flower):
    """The inside of the whole flower on the default grid."""
    rotation = rotation_to_z_up(flower.up)
    lower, upper = flower.gaussians.robust_bounds(rotation=rotation)
    cameras = view_cameras("carve", lower=lower, upper=upper, rotation=rotation, size_px=640)
    return discover_interior(
        flower.gaussians,
        render_views(flower.gaussians, cameras),
        Parts(flower.labels, flower.part_names, "truth"),
        frame=Frame(rotation, flower.metres_per_unit),
        cell=float((upper - lower).max()) / 64,
        wall_m={flower.part_names.index("pot"): WALL_M},
    )


@pytest.fixture(scope="module")
def found_volumes(flower, interior):
    """Volume over true volume of every part, and the share of its particles whose thickness was measured."""
    particles = interior.continuum
    volume_m3 = np.bincount(particles.part, particles.volume_m3, len(flower.part_names))
    measured = np.bincount(particles.part, particles.thickness_measured, len(flower.part_names))
    count = np.bincount(particles.part, minlength=len(flower.part_names))
    return {
        name: (volume_m3[number] / flower.truth[name].volume_m3, measured[number] / count[number])
        for number, name in enumerate(flower.part_names)
    }


def test_the_flower_is_one_connected_body(interior):
    assert interior.bridges.share_in_largest >= 0.995
    assert interior.loose_particles == 0  # its leaves hang on its stem


@pytest.mark.parametrize("part", ["soil", "stem", "leaves", "petals"])
def test_part_masses_are_true(found_volumes, part):
    assert found_volumes[part][0] == pytest.approx(1, abs=0.15)


@pytest.mark.parametrize("part", ["leaves", "petals"])
def test_the_thickness_of_leaves_and_petals_is_measured(found_volumes, part):
    assert found_volumes[part][1] > 0.9
