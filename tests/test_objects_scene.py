"""The key ``objects`` of a scene: what it may say, what is refused with which sentence, and the scene of each."""

import pytest

from phys4dgen.errors import RunError, SceneError
from phys4dgen.run.demo import prepare_example
from phys4dgen.run.generate import generate
from phys4dgen.scene import (
    PartOptions,
    Scene,
    check_part_names,
    dump_scene,
    load_scene,
    options_by_part,
    parts_meant,
    refuse_impossible_part_names,
    scene_of_object,
)

NAMES = ("cup/wall", "cup/handle", "ball/part_0")
TWO = "objects:\n  cup: {input: cup.ply, up: y}\n  ball: {input: in/ball.ply, position_m: [0, 0, 0.3]}\n"


def scene_of(tmp_path, text):
    path = tmp_path / "s.yaml"
    path.write_text(text)
    return load_scene(path)


def test_a_scene_of_objects_reads_back_as_written_with_paths_from_its_folder(tmp_path):
    told = TWO + "parts:\n  cup/handle: {hold: fixed}\n  ball: {material: steel}\nmotion: {preset: melt, part: ball}\n"
    scene = scene_of(tmp_path, told)
    assert scene.input is None
    assert scene.objects["ball"].input == tmp_path / "in/ball.ply"
    assert scene.objects["ball"].position_m == (0, 0, 0.3)
    assert scene_of(tmp_path, dump_scene(scene)) == scene


def test_every_key_of_an_object_is_a_flag(tmp_path):
    scene = scene_of(tmp_path, TWO).with_overrides({"objects.ball.velocity_ms": "3,0,0", "objects.cup.height_m": 0.1})
    assert scene.objects["ball"].velocity_ms == (3, 0, 0)
    assert scene.objects["cup"].height_m == 0.1


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("seed: 1", "'input' is missing; add it, or objects"),
        ("input: a.ply\n" + TWO, "input and objects are both given"),
        (TWO + "  cup: {input: b.ply}\n", "s.yaml line 4: the key 'cup' is written twice."),
        (TWO + "  Cup: {input: b.ply}\n", "is written twice, in large and in small letters"),
        (TWO + "  all: {input: b.ply}\n", "'all' means every part and cannot name an object"),
        (TWO + "  a/b: {input: b.ply}\n", "s.yaml line 4: objects.a/b"),
        (TWO + "  ../../x: {input: b.ply}\n", "s.yaml line 4: objects.../../x"),
        (TWO + "  dish: {position_m: [0, 0, 1]}\n", "s.yaml line 4: 'objects.dish.input' is missing; add it."),
        (TWO + "  dish: {input: d.ply, position_m: [0, .nan, 0]}\n", "s.yaml line 4: objects.dish.position_m"),
        (TWO + "  dish: {input: d.ply, rotation_deg: [0, .inf, 0]}\n", "objects.dish.rotation_deg"),
        (TWO + "  dish: {input: d.ply, velocity_ms: 3}\n", "expected three numbers such as [1, 0, 0], got 3."),
        (TWO + "  dish: {input: d.ply, positon_m: [0, 0, 0]}\n", "Did you mean 'position_m'?"),
        (TWO + "  dish: {input: d.ply, grouping: {partz: 3}}\n", "Did you mean 'parts'?"),
        (TWO + "  dish: {input: d.ply, height_m: 1, longest_m: 1}\n", "height_m and longest_m both give the size"),
        (TWO + "height_m: 1", "height_m is of one object; say it below objects.NAME"),
        (TWO + "select: {sphere: [0, 0, 0, 1]}", "select is of one object"),
        (TWO + "grouping: {names: {0: pot}}", "grouping.names is of one object"),
        (TWO + "simulation: {scale: paper}", "simulation.scale: paper is for one object"),
        (TWO + "simulation: {grid: 20, cell_m: 0.1}", "grid and cell_m both say how large a cell is"),
        (TWO + "motion: {preset: twist}", "motion.part: say which object, or which part of one, is turned"),
        ("objects: [{name: a, input: a.ply}]", "objects: expected a mapping"),
        ("objects: {}", "'input' is missing; add it, or objects"),
    ],
)
def test_what_cannot_be_is_refused_with_place_and_way_out(tmp_path, text, expected):
    with pytest.raises(SceneError) as caught:
        scene_of(tmp_path, text)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("forces: [{part: bal/part_0, value_ms2: [1, 0, 0]}]", "forces.0.part: there is no object 'bal'; the objects"),
        (
            "parts: {handle: {hold: fixed}}",
            "there is no object 'handle'; the objects are cup, ball, and",
        ),
        ("parts: {cup/handel: {hold: fixed}}", "parts.cup/handel: there is no part 'cup/handel'"),
        ("boundaries: [{kind: pin, part: dish}]", "boundaries.0.part: there is no object 'dish'"),
        ("interior: {hollow: {cup/rim: 0.01}}", "interior.hollow.cup/rim: there is no part 'cup/rim'"),
    ],
)
def test_names_that_no_part_can_get_are_refused_early(tmp_path, text, expected):
    with pytest.raises(SceneError) as caught:
        refuse_impossible_part_names(scene_of(tmp_path, TWO + text))
    assert expected in str(caught.value)


def test_a_name_means_a_part_an_object_or_all(tmp_path):
    assert parts_meant("cup/handle", NAMES) == ("cup/handle",)
    assert parts_meant("cup", NAMES) == ("cup/wall", "cup/handle")
    assert parts_meant("all", NAMES) == NAMES
    assert parts_meant("wall", NAMES) == ()
    scene = scene_of(tmp_path, TWO + "forces: [{part: cup, value_ms2: [1, 0, 0]}]\nparts: {cup/wall: {hold: rigid}}")
    check_part_names(scene, NAMES)
    with pytest.raises(SceneError, match="there is no part 'cup/wall'; the parts of these objects are ball/part_0"):
        check_part_names(scene, ("ball/part_0", "cup/handle"))


def test_options_of_an_object_hold_where_its_parts_say_no_more(tmp_path):
    scene = scene_of(
        tmp_path,
        TWO + "parts:\n  all: {material: steel}\n  cup: {material: ceramic, thickness_m: 0.004}\n"
        "  cup/handle: {hold: fixed, material: softwood}\n",
    )
    assert options_by_part(scene, NAMES) == {
        "cup/wall": PartOptions(material="ceramic", thickness_m=0.004),
        "cup/handle": PartOptions(hold="fixed", material="softwood", thickness_m=0.004),
        "ball/part_0": PartOptions(material="steel"),
    }
    cup, ball = scene_of_object(scene, "cup"), scene_of_object(scene, "ball", cell_m=0.01)
    assert options_by_part(cup, ("wall", "handle")) == {
        "wall": PartOptions(material="ceramic", thickness_m=0.004),
        "handle": PartOptions(hold="fixed", material="softwood", thickness_m=0.004),
    }
    assert options_by_part(ball, ("part_0",)) == {"part_0": PartOptions(material="steel")}


def test_the_scene_of_an_object_has_what_it_says_itself_and_else_what_the_scene_says(tmp_path):
    scene = scene_of(
        tmp_path,
        "objects:\n  cup: {input: cup.ply, up: y, grouping: {parts: 3}}\n  ball: {input: b.ply, longest_m: 0.2}\n"
        "grouping: {parts: 5}\nseed: 7\ninterior: {hollow: {cup/part_0: 0.01, ball/part_1: 0.02}, label_grid: 16}\n"
        "materials: {file: materials.yaml}\nmotion: {preset: drop}\n",
    )
    cup, ball = scene_of_object(scene, "cup"), scene_of_object(scene, "ball", cell_m=0.01)
    assert (cup.input, cup.up, cup.grouping.parts, cup.seed) == (tmp_path / "cup.ply", "y", 3, 7)
    assert (ball.longest_m, ball.grouping.parts, ball.simulation.cell_m) == (0.2, 5, 0.01)
    assert (cup.interior.hollow, ball.interior.hollow) == ({"part_0": 0.01}, {"part_1": 0.02})
    assert (cup.interior.label_grid, cup.materials.file, cup.motion.preset) == (16, None, "auto")
    assert not cup.objects


def test_all_parts_of_a_single_object_may_have_options(tmp_path):
    scene = scene_of(tmp_path, "input: a.ply\nparts: {all: {material: steel}, lid: {hold: fixed}}\n")
    assert options_by_part(scene, ("pot", "lid")) == {
        "pot": PartOptions(material="steel"),
        "lid": PartOptions(hold="fixed", material="steel"),
    }


def test_a_missing_file_is_named_before_anything_is_made(tmp_path):
    with pytest.raises(RunError, match=r"ball\.ply: cannot read the file: No such file"):
        generate(Scene.model_validate({"objects": {"b": {"input": "ball.ply"}}}), tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_bundled_objects_bring_size_parts_and_materials(tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text(
        "objects:\n  a: {input: hammer, position_m: [0, 0, 1]}\n  b: {input: hammer, height_m: 0.1}\n"
        "parts:\n  b/handle: {material: balsa}\n"
    )
    scene = prepare_example(tmp_path / "run", path)
    a, b = scene.objects["a"], scene.objects["b"]
    assert a.input == b.input
    assert a.input.is_file()
    assert (b.height_m, a.up, a.position_m) == (0.1, "+y", (0, 0, 1))
    assert scene.parts["a/head"].material == scene.parts["b/head"].material == "steel"
    assert (scene.parts["a/handle"].material, scene.parts["b/handle"].material) == ("hardwood", "balsa")
    assert {options.hold for options in scene.parts.values()} == {"auto"}
    path.write_text("objects:\n  a: {input: hamer}\n")
    with pytest.raises(SceneError, match=r"'hamer'\. Did you mean 'hammer'"):
        prepare_example(tmp_path / "other", path)
    path.write_text("objects:\n  a: 3\n")
    with pytest.raises(SceneError, match=r"s.yaml line 2: objects.a: expected a mapping, got 3"):
        prepare_example(tmp_path / "other", path)
