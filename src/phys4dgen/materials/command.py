"""Any other program as the identifier of materials, such as VoMP: it reads a run and leaves a materials.yaml.

What earlier stages made lies in the run folder: ``gaussians.ply``, ``groups.npz`` with the parts, ``views/``. The
program is started without a shell, in an empty folder of its own, with a time limit; what it leaves is treated like any
file from outside.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from phys4dgen.errors import MaterialError, StageError
from phys4dgen.materials.materials_yaml import read_materials
from phys4dgen.programs import run_program
from phys4dgen.types import Material, MaterialBook, PartMaterials

__all__ = ["identify_by_command"]


def identify_by_command(
    run: Path,
    part_names: tuple[str, ...],
    rules: MaterialBook,
    argv: Sequence[str],
    *,
    timeout_s: float,
    on_wait: Callable[[float], None] | None = None,
) -> MaterialBook:
    """Run a program that names materials.

    Args:
        run: the run folder.
        part_names: in the order of the part numbers.
        rules: materials of the parts that the program leaves out.
        argv: the program and its arguments; ``{run}`` stands for the run folder, ``{out}`` for the materials.yaml to
            write, ``{parts}`` for the names of the parts, joined by commas.
        timeout_s: it is ended after this time.
        on_wait: called every second with the seconds since the start.

    Raises:
        StageError: it cannot start, fails, takes too long, or leaves no such file inside its folder.
    """
    name = Path(argv[0]).name
    with tempfile.TemporaryDirectory(prefix="phys4dgen-", ignore_cleanup_errors=True) as folder_name:
        folder = Path(folder_name).resolve()
        out = folder / "materials.yaml"
        places = {"{run}": str(run.resolve()), "{out}": str(out), "{parts}": ",".join(part_names)}
        words = [_filled(word, places) for word in argv]
        run_program(words, folder, timeout_s=timeout_s, timeout_key="materials.timeout_s", on_wait=on_wait)
        if not out.is_file():
            raise StageError(
                f"The command '{name}' ended without writing {{out}}; it must leave a materials.yaml there."
            )
        if out.is_symlink() or out.resolve().parent != folder:
            raise StageError(f"The command '{name}' left a link to a file outside its folder; expected materials.yaml.")
        try:
            found = read_materials(out, part_names)
        except MaterialError as error:
            reason = str(error).removeprefix(f"{out} ")
            raise StageError(f"The command '{name}' did not leave materials in {{out}}: {reason}") from error
    return _book(found, part_names, rules, source=f"command:{name}")


def _book(
    found: Mapping[str, PartMaterials], part_names: Sequence[str], rules: MaterialBook, *, source: str
) -> MaterialBook:
    """What the program says, marked as its word; the rules for the rest."""

    def by_program(material: Material) -> Material:
        return replace(material, source=source)

    def by_rules(material: Material) -> Material:
        return replace(
            material, warnings=("the command left this part out, so the rule table decides", *material.warnings)
        )

    book = {}
    for name in part_names:
        mark, materials = (by_program, found[name]) if name in found else (by_rules, rules.parts[name])
        book[name] = PartMaterials(surface=mark(materials.surface), interior=mark(materials.interior))
    return MaterialBook(book)


def _filled(word: str, places: Mapping[str, str]) -> str:
    for key, value in places.items():
        word = word.replace(key, value)
    return word
