"""The Scene: round trip, defaults, and errors that a person can act on."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phys4dgen.errors import SceneError
from phys4dgen.scene import (
    Scene,
    check_part_names,
    dump_scene,
    load_scene,
    refuse_impossible_part_names,
    scene_keys,
)

NAMES = st.from_regex(r"[a-zA-Z_äß葉][a-z0-9_äß葉 -]{0,20}", fullmatch=True).filter(lambda name: name != "all")
NUMBERS = st.floats(-1e3, 1e3, allow_nan=False)
VECTORS = st.tuples(NUMBERS, NUMBERS, NUMBERS)


@st.composite
def scenes(draw):
    parts = draw(
        st.dictionaries(
            NAMES,
            st.fixed_dictionaries(
                {"hold": st.sampled_from(["auto", "fixed", "free"])},
                optional={"material": st.text(min_size=1, max_size=10), "thickness_m": st.floats(1e-6, 0.9)},
            ),
            max_size=3,
        )
    )
    start = draw(st.floats(0, 10))
    return Scene.model_validate(
        {
            "input": "/data/" + draw(st.from_regex(r"[\w .:#'\"-]{1,12}", fullmatch=True)) + ".splat",
            "up": draw(st.sampled_from(["auto", "-y", "+z"]) | VECTORS.filter(lambda v: max(map(abs, v)) > 0.1)),
            "height_m": draw(st.just("auto") | st.floats(1e-6, 1e6)),
            "seed": draw(st.integers(0, 2**32 - 1)),
            "parts": parts,
            "grouping": {"names": draw(st.dictionaries(st.integers(0, 255), NAMES, max_size=1))},
            "forces": tuple(
                {"part": name, "value_ms2": draw(VECTORS), "from_s": start, "to_s": start + 1} for name in parts
            ),
            "output": {
                "frames": draw(st.sampled_from(["ply", "none"])),
                "video": {"height": draw(st.just("auto") | st.just(480))},
            },
        }
    )


@settings(max_examples=60, deadline=None)
@given(scene=scenes())
def test_a_dumped_scene_reads_back_equal(scene, tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "scene.yaml"
    path.write_text(dump_scene(scene), encoding="utf-8")
    assert load_scene(path) == scene


def test_every_default_is_written_out():
    text = dump_scene(Scene(input=Path("a.splat")))
    for path, _, _ in scene_keys(Scene):
        assert f"{path[-1]}:" in text


def test_every_key_says_what_it_means():
    undocumented = [".".join(path) for path, _, text in scene_keys(Scene) if not text]
    assert undocumented == []


def test_paths_are_taken_from_the_folder_of_the_file(tmp_path):
    (tmp_path / "scene.yaml").write_text("input: plant.splat\ngrouping: {labels_file: ../labels.npy}\n")
    scene = load_scene(tmp_path / "scene.yaml")
    assert scene.input == tmp_path / "plant.splat"
    assert scene.grouping.labels_file == tmp_path / "../labels.npy"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("simulation: {gird: 3}", "line 2: 'simulation.gird' is not a key of a scene. Did you mean 'grid'?"),
        (
            "simulation:\n  fps: 24\n  grid: 3",
            "s.yaml line 4: simulation.grid: expected 'auto' or a number of at least 8, got 3.",
        ),
        ("simulation: {grid: 64.5}", "simulation.grid: expected 'auto' or a whole number, got 64.5."),
        ("height_m: yes", "s.yaml line 2: height_m: expected 'auto' or a number, got 'yes'."),
        ("height_m: -1", "height_m: expected 'auto' or a number greater than 0, got -1."),
        ("height_m: .nan", "height_m: expected 'auto' or a finite number, got nan."),
        ("up: [0, 0, 0]", "up: expected a direction, got a vector of length 0."),
        ("motion: {wind: [1, 2]}", "motion.wind: expected 'auto' or three numbers such as [1, 0, 0], got [1, 2]."),
        (f"motion: {{wind: [1, 2, {'9' * 400}]}}", "motion.wind: expected 'auto' or three numbers such as [1, 0, 0]"),
        ("parts: {p: {hold: fxed}}", "expected 'auto', 'fixed', 'rigid' or 'free', got 'fxed'. Did you mean 'fixed'?"),
        ("parts: {pot: {holt: fixed}}", "'parts.pot.holt' is not a key of a scene. Did you mean 'hold'?"),
        ("output: {frames: yes}", "output.frames: expected 'ply' or 'none', got 'yes'."),
        ("forces: [{part: a, to_s: 1}]", "'forces.0.value_ms2' is missing; add it."),
        ("forces: [{value_ms2: [1, 0, 0], from_s: 2, to_s: 1}]", "forces.0: to_s must be later than from_s"),
        ("forces: 3", "forces: expected a list, got 3."),
        ("height_m: 1\nlongest_m: 1", "height_m and longest_m both give the size"),
        ("grouping: {backend: file}", "grouping: backend 'file' needs labels_file"),
        ("materials: {backend: file}", "materials: backend 'file' needs file"),
        ("grouping: {names: {0: pot, 1: pot}}", "every part needs its own name"),
        ("seed: 1\nseed: 2", "s.yaml line 3: the key 'seed' is written twice."),
    ],
)
def test_an_error_names_place_key_expectation_and_value(tmp_path, text, expected):
    path = tmp_path / "s.yaml"
    path.write_text(f"input: a.splat\n{text}\n")
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "3", "- a\n- b", "up: -y"])
def test_a_file_without_an_input_is_refused(tmp_path, text):
    (tmp_path / "s.yaml").write_text(text)
    with pytest.raises(SceneError, match=r"s\.yaml"):
        load_scene(tmp_path / "s.yaml")


def test_a_missing_scene_file_is_one_sentence(tmp_path):
    with pytest.raises(SceneError, match="cannot read"):
        load_scene(tmp_path / "none.yaml")


def test_overrides_replace_values_and_name_their_source():
    scene = Scene(input=Path("a.splat"))
    changed = scene.with_overrides({"simulation.grid": 96, "parts.pot.hold": "fixed", "grouping.names.0": "pot"})
    assert (changed.simulation.grid, changed.parts["pot"].hold, changed.grouping.names) == (96, "fixed", {0: "pot"})
    assert scene.simulation.grid == "auto"
    with pytest.raises(
        SceneError, match=r"^--grid: simulation\.grid: expected 'auto' or a number of at most 512, got 9999\.$"
    ):
        scene.with_overrides({"simulation.grid": 9999}, sources={"simulation.grid": "--grid"})
    with pytest.raises(SceneError, match="what stands before the dot is one value"):
        scene.with_overrides({"simulation.grid.x": 1})


def test_frames_and_their_time():
    scene = Scene(input=Path("a.splat"))
    assert scene.frame_count == 48
    assert scene.frame_time_s == pytest.approx(1 / 24)
    slow_motion = scene.with_overrides({"simulation.frame_time_s": 0.001, "simulation.duration_s": 1.0})
    assert (slow_motion.frame_count, slow_motion.frame_time_s) == (24, 0.001)


def test_a_force_on_a_part_that_does_not_exist_is_refused():
    push = {"value_ms2": [1, 0, 0], "to_s": 1}
    scene = Scene(input=Path("a.splat")).with_overrides({"forces": [push, {**push, "part": "leefs"}]})
    with pytest.raises(SceneError, match=r"^forces\.1\.part: there is no part 'leefs'.*Did you mean 'leaves'\?$"):
        check_part_names(scene, ["pot", "leaves"])
    with pytest.raises(SceneError, match=r"forces\.1\.part.*--part-name"):
        refuse_impossible_part_names(scene)
    check_part_names(scene, ["pot", "leefs"])
    refuse_impossible_part_names(scene.with_overrides({"grouping.names.1": "leefs"}))
    refuse_impossible_part_names(scene.with_overrides({"grouping.labels_file": "labels.npz"}))
    refuse_impossible_part_names(scene.with_overrides({"forces": [{**push, "part": "part_3"}]}))


def test_options_and_names_of_parts_that_do_not_exist_are_refused():
    scene = Scene(input=Path("a.splat"))
    with pytest.raises(SceneError, match=r"parts\.pott: .*Did you mean 'pot'"):
        check_part_names(scene.with_overrides({"parts.pott.hold": "fixed"}), ["pot"])
    with pytest.raises(SceneError, match="no part number 2"):
        check_part_names(scene.with_overrides({"grouping.names.2": "hat"}), ["pot", "leaves"])
