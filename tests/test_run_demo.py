"""The demo's input: files that any other run could use."""

import numpy as np
import pytest

from phys4dgen.errors import RunError, SceneError
from phys4dgen.formats import load_gaussians
from phys4dgen.grouping.from_file import parts_from_file
from phys4dgen.materials.library import find_entry
from phys4dgen.run.demo import prepare_demo, prepare_example
from phys4dgen.run.folder import RunFolder
from phys4dgen.run.stages import scene_settings
from phys4dgen.scene import check_part_names, dump_scene, load_scene


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """A run folder with the demo's input in it, and its scene."""
    folder = tmp_path_factory.mktemp("demo") / "run"
    return folder, prepare_demo(folder)


def test_the_demo_is_an_ordinary_scene_with_labels(prepared, tmp_path):
    _, scene = prepared
    gaussians = load_gaussians(scene.input)
    assert scene.grouping.labels_file is not None
    parts = parts_from_file(scene.grouping.labels_file, gaussian_count=len(gaussians))
    check_part_names(scene, parts.names)
    assert {options.hold for options in scene.parts.values()} == {"fixed", "free"}
    for options in scene.parts.values():
        assert options.material is None or find_entry(options.material) is not None
    (tmp_path / "scene.yaml").write_text(dump_scene(scene))
    assert load_scene(tmp_path / "scene.yaml") == scene


def test_the_demo_is_the_same_every_time_and_its_folder_can_be_claimed(prepared):
    folder, scene = prepared
    settings = scene_settings(scene)
    means = load_gaussians(scene.input).means
    with RunFolder(folder).claim():
        pass
    assert scene_settings(prepare_demo(folder)) == settings
    np.testing.assert_array_equal(load_gaussians(scene.input).means, means)


def test_a_folder_of_other_files_stays_as_it_is(tmp_path):
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(RunError, match=r"thesis\.tex"):
        prepare_demo(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_a_scene_file_about_a_bundled_object_wins_over_its_defaults(tmp_path):
    (tmp_path / "scene.yaml").write_text(
        "input: hammer\nparts:\n  handle: {material: balsa}\nsimulation: {duration_s: 0.5}\n"
    )
    scene = prepare_example(tmp_path / "run", tmp_path / "scene.yaml")
    assert len(load_gaussians(scene.input)) > 0
    assert scene.parts["handle"].material == "balsa"
    assert scene.parts["handle"].hold == "free"
    assert scene.parts["head"].material == "steel"
    assert (scene.simulation.duration_s, scene.motion.preset) == (0.5, "drop")
    for text, problem in (
        ("input: hamer", "Did you mean 'hammer'"),
        ("seed: 1", "name of a bundled object"),
        ("input: hammer\nmotoin: {preset: drop}", r"line 2.*Did you mean 'motion'"),
    ):
        (tmp_path / "scene.yaml").write_text(text)
        with pytest.raises(SceneError, match=problem):
            prepare_example(tmp_path / "run", tmp_path / "scene.yaml")
