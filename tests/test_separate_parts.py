"""Parts that the scene calls separate: no bridge, no joint, no clamp, a velocity field of their own."""

from __future__ import annotations

import numpy as np
import pytest

from interior_shapes import box
from phys4dgen.export.trajectory import read_trajectory
from phys4dgen.formats import save_gaussians
from phys4dgen.run.generate import generate
from phys4dgen.scene import Scene
from phys4dgen.types import Gaussians

HALF_M = (0.2, 0.2, 0.06)
CELL_M = 0.04


def slabs(gap_m):
    """Two slabs above one another, and the number of the slab of each Gaussian."""
    slab = box(HALF_M).gaussians(0.02)
    upper = slab.means + np.float32([0, 0, 2 * HALF_M[2] + gap_m])
    names = ("quats_wxyz", "scales", "opacities", "sh")
    twice = {name: np.concatenate([getattr(slab, name)] * 2) for name in names}
    labels = np.repeat(np.int32([0, 1]), len(slab))
    return Gaussians(means=np.concatenate([slab.means, upper]), **twice), labels


def filled(folder, gap_m, *, separate):
    """Particles of the slabs, with the bridges that were built."""
    scene, _ = scene_of_slabs(folder, gap_m, separate=separate)
    run = generate(scene, folder / f"filled_{separate}", until="interior")
    with np.load(run.root / "continuum.npz") as found:
        return found["positions"], found["group"], found["volume_m3"], run.report["notes"]


@pytest.mark.parametrize("gap_cells", [0.0, 1.0, 2.0])
def test_separate_parts_are_filled_by_themselves(tmp_path, gap_cells):
    positions, part, volume_m3, notes = filled(tmp_path, gap_cells * CELL_M, separate=True)
    assert sum("(0 bridge voxels)" in note for note in notes) == 2
    for number in (0, 1):
        assert volume_m3[part == number].sum() == pytest.approx(8 * np.prod(HALF_M), rel=0.12)
    lower, upper = (positions[part == number, 2] for number in (0, 1))
    # Particles of the rim, light ones, stand up to half a spacing outside of the faces.
    assert upper.min() - lower.max() == pytest.approx(gap_cells * CELL_M, abs=0.5 * CELL_M)


def scene_of_slabs(folder, gap_m, *, separate):
    """The upper one is pulled up with 4 m/s2."""
    gaussians, labels = slabs(gap_m)
    save_gaussians(gaussians, folder / "slabs.ply")
    np.savez(folder / "labels.npz", labels=labels, names=np.array(["lower", "upper"]))
    scene = Scene.model_validate(
        {
            "input": str(folder / "slabs.ply"),
            "up": "z",
            "height_m": float(np.ptp(gaussians.means[:, 2])),
            "grouping": {"labels_file": str(folder / "labels.npz")},
            "parts": {
                "lower": {"material": "pu_foam", "hold": "free"},
                "upper": {"material": "pu_foam", "separate": separate},
            },
            "motion": {"preset": "rest"},
            "forces": [{"kind": "acceleration", "part": "upper", "value_ms2": [0, 0, 4.0]}],
            "simulation": {"cell_m": CELL_M, "duration_s": 0.1, "fps": 50.0, "damping_ratio": 0.0, "threads": 1},
            "views": {"size_px": 64},
            "output": {"video": {"width": 64}},
        }
    )
    return scene, labels


def moved_m(folder, gap_m, *, separate):
    """How far each slab goes up in four frames."""
    scene, labels = scene_of_slabs(folder, gap_m, separate=separate)
    run = generate(scene, folder / f"run_{separate}", until="simulate")
    positions = read_trajectory(run.root / "trajectory.npz").positions
    way = positions[-1, :, 2] - positions[0, :, 2]
    return way[labels == 0].mean(), way[labels == 1].mean()


@pytest.mark.parametrize("gap_cells", [0.5, 1.0])
def test_a_separate_slab_leaves_the_other_one_where_it_is(tmp_path, gap_cells):
    expected_m = 0.5 * 4.0 * 0.08**2  # the last of five frames is at 0.08 s
    lower, upper = moved_m(tmp_path, gap_cells * CELL_M, separate=True)
    assert upper == pytest.approx(expected_m, rel=0.05)
    assert abs(lower) < 0.02 * expected_m
    lower, upper = moved_m(tmp_path, gap_cells * CELL_M, separate=False)
    assert lower > 0.7 * upper


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_a_separate_slab_rubs_on_the_one_below(tmp_path, friction):
    scene, labels = scene_of_slabs(tmp_path, 0.0, separate=True)
    scene = scene.with_overrides(
        {
            "forces": [{"kind": "acceleration", "part": "upper", "value_ms2": [8.0, 0, 0]}],
            "parts.lower.hold": "fixed",
            "gravity": "on",
            "simulation.friction": friction,
            "simulation.duration_s": 0.2,
        }
    )
    run = generate(scene, tmp_path / "rubbed", until="simulate")
    positions = read_trajectory(run.root / "trajectory.npz").positions
    way = (positions[-1] - positions[0])[labels == 1].mean(0)
    expected_m = 0.5 * (8.0 - friction * 9.81) * 0.18**2
    assert way[0] == pytest.approx(expected_m, rel=0.12)
    assert abs(way[2]) < 0.25 * CELL_M
