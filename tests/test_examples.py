"""The scene files that the project ships: every one is a scene, and the parts that it names are there."""

from pathlib import Path

import pytest

from phys4dgen.run.demo import prepare_example
from phys4dgen.scene import load_scene
from phys4dgen.scene.part_names import check_part_names, refuse_impossible_part_names
from phys4dgen.zoo.catalogue import bundled

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.yaml")), ids=lambda path: path.stem)
def test_scenes_of_bundled_objects_name_parts_that_are_there(path, tmp_path, kept_objects):
    scene = prepare_example(tmp_path / "run", path)
    refuse_impossible_part_names(scene)
    inputs = {name: placed.input for name, placed in scene.objects.items()} or {"": scene.input}
    names = [
        f"{name}/{part}" if name else part
        for name, splat in inputs.items()
        for part in kept_objects[Path(splat).stem].part_names
    ]
    check_part_names(scene, names)


@pytest.mark.parametrize("path", sorted((EXAMPLES / "files").glob("*.yaml")), ids=lambda path: path.stem)
def test_scenes_of_files_name_parts_that_can_be_there(path):
    refuse_impossible_part_names(load_scene(path))


@pytest.fixture(scope="module")
def kept_objects():
    """Bundled objects by name; each is built once."""
    built = {}

    def once(name, *, seed):
        if name not in built:
            built[name] = bundled(name, seed=seed)
        return built[name]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("phys4dgen.run.demo.bundled", once)
        yield built
