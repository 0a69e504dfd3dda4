"""Configurations of PhysGaussian: cameras, spellings, what is refused, and the command."""

import json
import shutil

import pytest

from phys4dgen.cli import main
from phys4dgen.errors import SceneError
from phys4dgen.physgaussian.configuration import read_configuration
from phys4dgen.physgaussian.importing import import_physgaussian
from physgaussian_importing import importing_into, mentions
from physgaussian_scenes import CONFIGURATIONS, write_model


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    folder = tmp_path_factory.mktemp("model")
    write_model(folder)
    return folder


@pytest.fixture
def run(model, tmp_path):
    """Imports a configuration, by name or as a dictionary."""
    return importing_into(tmp_path, model)


def test_cameras(run):
    leaf = run("leaf")
    video = leaf.scene.output.video
    # azimuth 0 is the direction (1, 1, 0), 135 deg in ours, and it turns clockwise seen from above
    assert video.orbit_deg == pytest.approx(29)
    assert video.azimuth_deg == pytest.approx(135 - 20 + 29 / 2)
    assert video.elevation_deg == pytest.approx(15)
    assert mentions(leaf, "init_radius", "delta_e")
    coin = run("coin").scene.output.video  # camera 1 stands at +x
    assert coin.azimuth_deg == pytest.approx(90, abs=1)
    assert coin.elevation_deg == pytest.approx(0, abs=1)
    assert mentions(run({**CONFIGURATIONS["coin"], "default_camera_index": 7}), "no camera 7")


def test_spellings(run, tmp_path):
    config = {**CONFIGURATIONS["ball"], "init_azimuth": 30, "default_camera_index": -1}
    config["particle_filling"] = {"max_particles_per_cell": 8}
    corrected, compat = run(config), run(config, "compat")
    assert corrected.scene.output.video.azimuth_deg != compat.scene.output.video.azimuth_deg
    assert mentions(corrected, "init_azimuth:", "ignores this key; this import takes it")
    assert mentions(compat, "init_azimuth:", "so does this import")
    assert mentions(corrected, "particle_filling.max_particles_per_cell")
    path = tmp_path / "config.json"
    assert read_configuration(path, mode="corrected").values.particle_filling.max_partciels_per_cell == 8
    assert read_configuration(path, mode="compat").values.particle_filling.max_partciels_per_cell == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frictio_angle": 3}, "Did you mean 'friction_angle'"),
        ({"particle_filling": {"densty_threshold": 3}}, "densty_threshold"),
        ({"boundary_conditions": [{"type": "surface_colider"}]}, "Did you mean 'surface_collider'"),
        ({"boundary_conditions": [{"point": [1, 1, 1]}]}, "expected a type"),
        ({"boundary_conditions": [{"type": ["cuboid"]}]}, "expected a type"),
        ({"boundary_conditions": [{"type": "cuboid", "point": [1, 1, 1], "size": [1, 1, 1]}]}, "velocity"),
        ({"boundary_conditions": [{"type": "bounding_box", "pont": 1}]}, "pont"),
        ({"material": "jely"}, "Did you mean 'jelly'"),
        ({"nu": 0.7}, "nu"),
        ({"E": "stiff"}, "E"),
        ({"rotation_degree": [90]}, "go together"),
        ({"sim_area": [1, -1, 0, 1, 0, 1]}, "sim_area"),
        ({"sim_area": [5, 6, 5, 6, 5, 6]}, "no Gaussian of"),
        ({"frame_dt": 1e-5}, "shorter than substep_dt"),
        ({"n_grid": 6, "boundary_conditions": [{"type": "bounding_box"}]}, "no room between its walls"),
        ({"density": 1e5}, "density"),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_sentence(run, change, message):
    with pytest.raises(SceneError, match=message) as raised:
        run({**CONFIGURATIONS["ball"], **change})
    assert "\n" not in str(raised.value)


def test_a_ratio_of_one_half(run):
    incompressible = {**CONFIGURATIONS["ball"], "nu": 0.5}
    assert mentions(run(incompressible), "nu: 0.5")
    with pytest.raises(SceneError, match="divides by zero"):
        run(incompressible, "compat")


def test_broken_files(model, tmp_path):
    path = tmp_path / "a.json"
    for text, message in (
        ('{"smooth": ,}', "line 1: not JSON"),
        ("[1]", "expected a JSON object"),
        ("[" * 99999, "not JSON"),
    ):
        path.write_text(text)
        with pytest.raises(SceneError, match=message):
            import_physgaussian(path, model, tmp_path / "a.yaml")
    with pytest.raises(SceneError, match="no such file"):
        import_physgaussian(tmp_path / "absent.json", model, tmp_path / "a.yaml")
    path.write_text("{}")
    (tmp_path / "empty").mkdir()
    with pytest.raises(SceneError, match="iteration_N"):
        import_physgaussian(path, tmp_path / "empty", tmp_path / "a.yaml")


def test_the_command(model, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(model, tmp_path / "model")
    (tmp_path / "leaf.json").write_text(json.dumps(CONFIGURATIONS["leaf"]))
    words = ["import-physgaussian", "leaf.json", "model", "-o", "leaf.yaml"]
    assert main(words) == 0
    said = capsys.readouterr()
    assert said.out.splitlines() == ["leaf.yaml", "leaf_object.ply", "leaf_materials.yaml"]
    assert "covariance" in said.err
    assert main(words) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert main([*words, "--mode", "compat", "--overwrite"]) == 0
    assert main(["import-physgaussian", "leaf.json", "model"]) == 2
    assert main(["import-physgausian", "leaf.json"]) == 2
    assert "Did you mean 'import-physgaussian'" in capsys.readouterr().err
