"""Programs of others as identifiers of materials, well and badly behaved."""

from __future__ import annotations

import sys
import time

import pytest

from phys4dgen.errors import SceneError, StageError
from phys4dgen.materials import material
from phys4dgen.materials.command import identify_by_command
from phys4dgen.scene import Scene
from phys4dgen.types import MaterialBook, PartMaterials

PARTS = ("pot", "leaves")
RULES = MaterialBook({name: PartMaterials(material("felt"), material("felt")) for name in PARTS})


def run(tmp_path, script, *, timeout_s=30.0, **options):
    (tmp_path / "groups.npz").write_bytes(b"parts")
    program = f"import sys, os, pathlib, time; run, out, parts = sys.argv[1:4]; {script}"
    argv = [sys.executable, "-c", program, "{run}", "{out}", "{parts}"]
    return identify_by_command(tmp_path, PARTS, RULES, argv, timeout_s=timeout_s, **options)


def writes(text):
    return f"pathlib.Path(out).write_text({text!r})"


def test_a_program_that_names_materials_of_some_parts(tmp_path):
    text = "parts: {pot: {surface: {name: ceramic, youngs_modulus_pa: 5.0e10}, interior: garden_soil}}"
    checks = "assert parts == 'pot,leaves' and open(run + '/groups.npz').read() == 'parts'"
    book = run(tmp_path, f"{checks}; {writes(text)}")
    pot, leaves = book.parts["pot"], book.parts["leaves"]
    assert (pot.surface.name, pot.surface.youngs_modulus_pa) == ("ceramic", 5e10)
    assert pot.interior.name == "garden_soil"
    assert pot.surface.source == pot.interior.source == f"command:{sys.executable.rsplit('/')[-1]}"  # never the user
    assert leaves.surface.name == "felt"
    assert leaves.surface.warnings[0].startswith("the command left this part out")


@pytest.mark.parametrize(
    ("script", "message"),
    [
        ("sys.exit('no memory')", "failed with exit code 1; it said: no memory"),
        ("pass", "ended without writing"),
        (writes("parts: {lid: {surface: felt}}"), "did not leave materials in {out}: line 1: there is no part 'lid'"),
        (writes("parts: {pot: {surface: {name: ceramic, youngs_modulus_pa: -1}}}"), "expected youngs_modulus_pa"),
        (writes("import os; os.system('reboot')"), "did not leave materials"),
        ("pathlib.Path(out).write_text('x' * 10_000_000)", "did not leave materials"),
        ("os.symlink('/etc/hostname', out)", "outside its folder"),
    ],
)
def test_a_program_that_misbehaves_ends_in_one_sentence(tmp_path, script, message):
    with pytest.raises(StageError) as raised:
        run(tmp_path, script)
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_program_that_hangs_is_ended_and_progress_is_told(tmp_path):
    start, told = time.monotonic(), []
    with pytest.raises(StageError, match=r"ended after 2 s.*materials\.timeout_s"):
        run(tmp_path, "os.fork(); time.sleep(60)", timeout_s=2.0, on_wait=told.append)
    assert time.monotonic() - start < 20
    assert len(told) >= 2
    assert told == sorted(told)


def test_ctrl_c_ends_the_program(tmp_path):
    def interrupt(_passed_s):
        if (tmp_path / "begun").exists():
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(tmp_path, "pathlib.Path(run, 'begun').touch(); time.sleep(60)", on_wait=interrupt)


def test_the_scene_asks_for_both_program_and_backend():
    argv = ["vomp", "{run}", "{out}"]
    scene = Scene(input="a.ply").with_overrides({"materials.backend": "command", "materials.argv": argv})
    assert scene.materials.argv == tuple(argv)
    with pytest.raises(SceneError, match="needs argv"):
        Scene(input="a.ply").with_overrides({"materials.backend": "command"})
    with pytest.raises(SceneError, match="choose 'command'"):
        Scene(input="a.ply").with_overrides({"materials.argv": argv})
