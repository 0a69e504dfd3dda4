"""Materials by a model in a run folder: pictures, ``identify``, edits that stay, speed, and keys nowhere."""

import io
import json
import logging
import time

import numpy as np
import pytest
from PIL import Image

from lollipop import lollipop
from mllm_recordings import answer, part, side, striped_images, striped_view
from mllm_server import fails, says, serving
from phys4dgen.cli import main
from phys4dgen.errors import StageError
from phys4dgen.formats import save_gaussians
from phys4dgen.materials import read_materials
from phys4dgen.materials.mllm import (
    Asking,
    PartView,
    endpoint,
    front_views,
    identify_by_model,
    kept_pictures,
    make_sub_images,
    pictures_digest,
)
from phys4dgen.materials.mllm.subimages import CROP_PX, VIEW_PX, picture_view
from phys4dgen.materials.rules import DEFAULT_SOLID
from phys4dgen.run.generate import continue_run, generate
from phys4dgen.scene import Scene, load_scene
from phys4dgen.types import Frame, MaterialBook, PartMaterials, Parts

pytest.importorskip("openai")

KEY = "sk-live-0b7e55a1c3d94f"
NAMES = ("block", "stick", "ball")


LOLLIPOP = answer(
    part("A", side("wood", 1e10, 450, 0.35), origin="natural"),
    part("B", side("paper", 5e9, 700, 0.2)),
    part("C", side("rubber", 3e6, 1100, 0.48), side("foam", 5e4, 30, 0.1), shape="hollow", thickness_m=0.002),
    thing="a lollipop",
    height_m=0.2,
)


@pytest.fixture(scope="module")
def parts_run(tmp_path_factory):
    """A run up to the materials, by the rule table."""
    gaussians, labels = lollipop()
    folder = tmp_path_factory.mktemp("input")
    save_gaussians(gaussians, folder / "lollipop.ply")
    np.savez(folder / "labels.npz", labels=labels, names=np.array(NAMES))
    scene = Scene(input=folder / "lollipop.ply").with_overrides(
        {
            "up": "z",
            "height_m": 0.2,
            "grouping.labels_file": folder / "labels.npz",
            "simulation.grid": 16,
            "simulation.threads": 1,
            "views.size_px": 64,
        }
    )
    generate(scene, folder / "run", until="materials")
    return folder / "run"


@pytest.fixture
def run(parts_run, tmp_path):
    """A copy of that run."""
    import shutil

    return shutil.copytree(parts_run, tmp_path / "run")


@pytest.fixture(autouse=True)
def _loggers_as_before():
    """``-vv`` sends the log to the stderr of this test alone."""
    logger = logging.getLogger("phys4dgen")
    before = list(logger.handlers)
    yield
    logger.handlers[:] = before


@pytest.fixture
def key(monkeypatch):
    for name in ("OPENAI_API_KEY", "GEMINI_API_KEY", "PHYS4DGEN_MLLM_KEY"):
        monkeypatch.setenv(name, KEY)
    return KEY


def materials(run):
    return read_materials(run / "materials.yaml")


# --------------------------------------------------------------------------------------------------------- pictures


def test_crops_hold_their_part_alone_on_grey():
    view = striped_view(3)
    images = make_sub_images(view, list, 3)
    assert images.letters == {0: "A", 1: "B", 2: "C"}
    for number, letter in images.letters.items():
        crop = np.asarray(Image.open(io.BytesIO(images.crops[letter])))
        own = view.rgb[view.part_map == number][0].astype(int)
        others = [view.rgb[view.part_map == other][0].astype(int) for other in range(3) if other != number]
        pixels = crop.reshape(-1, 3).astype(int)
        assert (np.abs(pixels - own).max(1) < 8).mean() > 0.3
        assert all((np.abs(pixels - other).max(1) < 8).mean() == 0 for other in others)
        assert np.abs(crop[0, 0].astype(int) - 128).max() < 3


def test_pictures_are_bounded_and_bare(tmp_path):
    photo = Image.fromarray(np.random.default_rng(0).integers(0, 255, (900, 1600, 3), np.uint8))
    exif = Image.Exif()
    exif[0x010F], exif[0x8825] = "a camera", {2: (52.0, 31.0, 0.0)}
    photo.save(tmp_path / "photo.jpg", exif=exif, comment=b"home")
    rgb = np.asarray(Image.open(tmp_path / "photo.jpg"))
    part_map = np.zeros(rgb.shape[:2], np.int32)
    images = make_sub_images(PartView(rgb, part_map), list, 1)
    for png, limit in ((images.canonical, VIEW_PX), (images.overlay, VIEW_PX), (images.crops["A"], CROP_PX)):
        picture = Image.open(io.BytesIO(png))
        assert max(picture.size) <= limit
        assert picture.info == {}
        assert len(picture.getexif()) == 0
        assert [png[i : i + 4] for i in range(len(png)) if png[i : i + 4] in (b"eXIf", b"tEXt", b"iTXt")] == []


def test_a_part_that_the_front_hides_is_cropped_from_elsewhere():
    front = striped_view(2)
    back = PartView(front.rgb, np.where(front.part_map >= 0, 2, -1).astype(np.int32))
    images = make_sub_images(front, lambda: [back], 4)
    assert set(images.crops) == {"A", "B", "C"}
    assert images.letters == {0: "A", 1: "B", 2: "C"}
    assert images.unseen == (3,)


def test_at_most_26_parts_are_asked_for():
    images = striped_images(30)
    assert len(images.crops) == 26
    assert len(images.unseen) == 4


def test_the_front_view_of_a_splat_shows_its_parts():
    gaussians, labels = lollipop()
    front, others = front_views(gaussians, Parts(labels, NAMES, "file"), Frame(np.eye(3), 1.0), size_px=256)
    rows = [np.flatnonzero((front.part_map == number).any(1)).mean() for number in range(3)]
    assert rows[2] < rows[1] < rows[0]  # the ball on top
    assert (front.part_map >= 0).mean() > 0.02
    assert len(others()) == 8


def test_the_users_picture_is_the_canonical_view_where_there_is_one():
    from phys4dgen.render.cameras import orbit_camera

    gaussians, labels = lollipop()
    camera = orbit_camera(
        azimuth_deg=0, elevation_deg=0, target=[0, 0, 0.1], rotation=np.eye(3), radius=0.35, fovy_deg=49.1, width=96,
        height=96,
    )  # fmt: skip
    picture = np.full((96, 96, 4), 0.25, np.float32)
    picture[..., 3] = 1
    picture[:48, :, 3] = 0
    view = picture_view(gaussians, Parts(labels, NAMES, "file"), picture, camera)
    assert (view.part_map[:48] == -1).all()
    assert {0, 1} <= set(np.unique(view.part_map[48:]))
    assert (view.rgb[:48] == 255).all()
    assert (view.rgb[48:] == 64).all()


def test_pictures_are_drawn_once_and_anew_when_they_were_touched(tmp_path):
    drawn = []

    def draw():
        drawn.append(1)
        return striped_images(3)

    labels = np.arange(6, dtype=np.int32)
    digest = pictures_digest((labels, None))
    first = kept_pictures(tmp_path, digest, draw)
    again = kept_pictures(tmp_path, digest, draw)
    assert len(drawn) == 1
    assert (again.canonical, again.overlay, again.crops) == (first.canonical, first.overlay, first.crops)
    assert (again.letters, again.unseen) == (first.letters, first.unseen)
    (tmp_path / "sent_part_B.png").write_bytes(first.crops["A"])
    assert kept_pictures(tmp_path, digest, draw).crops == first.crops
    kept_pictures(tmp_path, pictures_digest((labels[::-1], None)), draw)
    for damage in ("", "[]", '{"digest": "' + digest + '", "letters": {"../x": 0}, "unseen": [], "files": {}}'):
        (tmp_path / "sent.json").write_text(damage)
        assert kept_pictures(tmp_path, digest, draw).crops == first.crops
    assert len(drawn) == 6


# ----------------------------------------------------------------------------------------------------- run folders


def test_identify_writes_what_the_model_says(run, key, capsys):
    with serving(lambda number, body: says(LOLLIPOP)) as server:
        words = ["identify", str(run), "--base-url", server.url, "--model", "test-model", "--samples", "3", "--stats"]
        assert main(words) == 0
    assert len(server.requests) == 3
    found = materials(run)
    ball = found["ball"]
    assert (ball.surface.name, ball.interior.name) == ("natural_rubber", "pu_foam")
    assert ball.surface.source == "mllm:test-model"
    assert ball.surface.evidence == "3 of 3 answers; E spread 0 decades"
    assert "range" in (run / "materials.yaml").read_text()
    said = capsys.readouterr()
    assert "3,000 tokens of questions and 600 of answers in 3 requests" in said.err
    assert "is hollow, with a wall of about 2 mm" in said.err
    assert said.out.split() == [str(run / "materials.yaml"), str(run / "reliability.md")]
    assert "| wood / 100 % | paper / 100 % | rubber / 100 % |" in (run / "reliability.md").read_text()
    summary = json.loads((run / "answers" / "identification.json").read_text())
    assert summary["object"] == "a lollipop"
    assert summary["parts"]["ball"]["consensus"]["surface"]["votes"] == 3
    sent = sorted(path.name for path in (run / "answers").glob("sent_*.png"))
    assert sent == ["sent_object.png", "sent_part_A.png", "sent_part_B.png", "sent_part_C.png", "sent_parts.png"]
    # Nobody is asked again, neither by the next stage nor by the same command without a network.
    continue_run(run, since="simulate", until="materials")
    assert main([*words[:-1], "--offline", "-q"]) == 0
    assert materials(run) == found


def test_what_a_person_edited_survives(run):
    path = run / "materials.yaml"
    edited = path.read_text().replace("  block:\n", "  block:\n    surface: steel\n  old:\n", 1)
    head, tail = edited.split("  old:\n")
    path.write_text(head + "  stick:\n" + tail.split("  stick:\n", 1)[1])
    with serving(lambda number, body: says(LOLLIPOP)) as server:
        assert main(["identify", str(run), "--base-url", server.url, "-q"]) == 0
    found = materials(run)
    assert (found["block"].surface.name, found["block"].surface.source) == ("steel", "user")
    assert found["stick"].surface.name == "paper"
    assert found["stick"].surface.source.startswith("mllm:")


def test_a_failing_model_leaves_the_run_as_it_was(run, capsys):
    before = materials(run)
    with serving(lambda number, body: fails(401, "bad key")) as server:
        assert main(["identify", str(run), "--base-url", server.url]) == 1
    assert "key was not accepted" in capsys.readouterr().err
    assert materials(run) == before


def test_auto_falls_back_to_the_rule_table_and_says_so(run):
    scene = load_scene(run / "scene.yaml")
    assert (scene.materials.backend, scene.materials.allow_upload) == ("auto", False)
    with serving(lambda number, body: says(None, refusal="no")) as server:
        assert main(["simulate", str(run), "--until", "materials", "--allow-upload", "-q",
                     "--materials.base-url", server.url, "--materials.samples", "2"]) == 0  # fmt: skip
    assert len(server.requests) == 2
    warnings = json.loads((run / "report.json").read_text())["warnings"]
    assert any(warning.startswith("The rule table names the materials, because gpt-4o at") for warning in warnings)
    assert not any(entry.surface.source.startswith("mllm") for entry in materials(run).values())


def test_pictures_do_not_leave_without_consent(run, capsys, key):
    assert main(["identify", str(run)]) == 1
    assert "allow it with --allow-upload" in capsys.readouterr().err


def test_models_are_compared_and_the_materials_stay(run):
    before = (run / "materials.yaml").read_bytes()

    def behave(number, body):
        stiff = body["model"] == "stiff"
        return says(answer(*(part(letter, side("rubber", 1e7 if stiff else 1e6, 1100, 0.48)) for letter in "ABC")))

    with serving(behave) as server:
        words = ["identify", str(run), "--base-url", server.url, "--samples", "2", "-q"]
        assert main([*words, "--compare", f"soft,stiff@{server.url}"]) == 0
        assert main([*words, "--compare", "soft"]) == 2
    table = (run / "comparison.md").read_text()
    assert "| Model | Answers | block | stick | ball |" in table
    assert "| soft | 2 | 6.000 (rubber) |" in table
    assert f"| stiff@{server.url} | 2 | 7.000 (rubber) |" in table
    assert (run / "materials.yaml").read_bytes() == before


@pytest.mark.parametrize("words", [["--grid", "32"], ["--sampels", "3"], ["--samples", "0"], ["--stats", "3"],
                                   ["--base-url", "http://u:secret@host/v1"]])  # fmt: skip
def test_wrong_flags_are_told(run, words, capsys):
    assert main(["identify", str(run), *words]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "secret" not in said


# ------------------------------------------------------------------------------------------------------- six parts


def six(tmp_path, server, **options):
    rules = MaterialBook({f"part_{i}": PartMaterials(DEFAULT_SOLID, DEFAULT_SOLID) for i in range(6)})
    return identify_by_model(
        endpoint("m", server.url, environment={}), striped_images(6), tuple(rules.parts), rules,
        asking=Asking(**options), folder=tmp_path / "answers",
    )  # fmt: skip


SIX = answer(*(part(letter, side("rubber", 2e6, 1100, 0.48)) for letter in "ABCDEF"))


def test_six_parts_from_kept_answers_take_less_than_two_seconds(tmp_path):
    with serving(lambda number, body: says(SIX)) as server:
        first = six(tmp_path, server)
        began = time.perf_counter()
        again = six(tmp_path, server, offline=True)
        assert time.perf_counter() - began < 2
    assert again.book == first.book
    assert len(again.agreed) == 6


def test_six_parts_at_one_second_an_answer_take_less_than_four(tmp_path):
    def slow(number, body):
        time.sleep(1.0)
        return says(SIX)

    with serving(slow) as server:
        began = time.perf_counter()
        found = six(tmp_path, server)
        took_s = time.perf_counter() - began
    assert took_s < 4
    assert len(found.asked.readings) == 5


def test_a_part_that_no_answer_describes_is_left_to_the_rules(tmp_path):
    some = answer(*(part(letter, side("rubber", 2e6, 1100, 0.48)) for letter in "ABCDE"))
    with serving(lambda number, body: says(some)) as server:
        found = six(tmp_path, server, samples=2)
    last = found.book.parts["part_5"].surface
    assert last.name == "default_solid"
    assert last.warnings[0] == "no answer describes this part, so the rule table decides"


# ------------------------------------------------------------------------------------------------------------- keys


@pytest.mark.parametrize("outcome", ["good", "refused", "wrong key", "echo"])
def test_a_key_appears_in_no_file_and_no_output(run, key, capfd, caplog, outcome):
    echo = answer(*(part(letter, side("rubber", 2e6, 1100, 0.48), reason=f"{key}", what_it_is=key) for letter in "ABC"))

    def behave(number, body):
        if outcome == "wrong key":
            return fails(401, f"Incorrect API key provided: {key}. Authorization: Bearer {key}")
        if outcome == "refused":
            return says(None, refusal=f"I will not. Your key is {key}")
        return says(echo if outcome == "echo" else LOLLIPOP)

    with serving(behave) as server, caplog.at_level(logging.DEBUG):
        code = main(["identify", str(run), "-vv", "--stats", "--base-url", server.url, "--samples", "2"])
    assert code == (0 if outcome in ("good", "echo") else 1)
    assert server.keys[0] == f"Bearer {key}"  # it did go where it belongs
    said = capfd.readouterr()
    for text in (said.out, said.err, caplog.text):
        assert key not in text
    for path in run.parent.rglob("*"):
        if path.is_file():
            assert key.encode() not in path.read_bytes(), path


def test_a_key_in_the_scene_is_not_echoed(run, capsys):
    assert main(["identify", str(run), "--materials.api-key", KEY]) == 2
    assert KEY not in capsys.readouterr().err


def test_the_extra_is_named_where_it_is_missing(tmp_path, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "openai", None)
    with serving(lambda number, body: says(SIX)) as server, pytest.raises(StageError, match=r"phys4dgen\[mllm\]"):
        six(tmp_path, server)


def test_nothing_heavy_is_imported_for_kept_answers():
    import subprocess
    import sys

    code = "import sys, phys4dgen.materials.mllm; print([m for m in ('openai', 'httpx2', 'numba') if m in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
