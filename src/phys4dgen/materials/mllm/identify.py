"""Materials of all parts by a multimodal model (Paper: Sec. 3.4): pictures, answers, consensus, checks.

What was sent (the pictures), every answer, the votes and the verdicts lie beside each other in one folder, so that a
person can see why a part is what it is, and run it again without asking.
"""

from __future__ import annotations

import json
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from phys4dgen.errors import RunError
from phys4dgen.formats.atomic import atomic_path
from phys4dgen.materials.mllm.budget import Limits
from phys4dgen.materials.mllm.cache import AnswerCache
from phys4dgen.materials.mllm.check import Checked, check_part
from phys4dgen.materials.mllm.consensus import Origin, PartConsensus, part_consensus
from phys4dgen.materials.mllm.endpoint import Endpoint
from phys4dgen.materials.mllm.reading import PartReading, Reading, SideReading
from phys4dgen.materials.mllm.sampling import Asked, ask
from phys4dgen.materials.mllm.subimages import SubImages
from phys4dgen.progress import SILENT, Progress
from phys4dgen.types import MaterialBook, PartMaterials

__all__ = ["Asking", "Identification", "ask_names", "identify_by_model", "kept_answers"]


@dataclass(frozen=True)
class Asking:
    """How a model is asked.

    Attributes:
        samples: independent answers.
        temperature: of the sampling.
        limits: what may be spent.
        allow_upload: whether pictures may leave this machine.
        offline: use kept answers alone.
        trust: keep the model's materials whatever the checks say.
        origin: what the user knows about the object; None asks the model.
    """

    samples: int = 5
    temperature: float = 0.8
    limits: Limits = field(default_factory=Limits)
    allow_upload: bool = False
    offline: bool = False
    trust: bool = False
    origin: Origin | None = None


@dataclass(frozen=True)
class Identification:
    """What a model said about an object, and what was made of it.

    Attributes:
        book: surface and interior of every part.
        asked: the answers and their cost.
        thing: what the object is.
        height_m: its real height as the answers estimate it, or None.
        agreed: consensus by part name, of the parts that were answered for.
        checked: verdict by part name, likewise.
    """

    book: MaterialBook
    asked: Asked
    thing: str
    height_m: float | None
    agreed: Mapping[str, PartConsensus]
    checked: Mapping[str, Checked]


def ask_names(
    target: Endpoint, images: SubImages, part_names: Sequence[str], asking: Asking, *, folder: Path, progress: Progress
) -> Asked:
    """Ask a model of all parts, without a look at its answers.

    Args:
        target: whom to ask.
        images: what is shown.
        part_names: of the run.
        asking: how often, and at what cost.
        folder: where answers are kept and looked for.
        progress: told what is sent.

    Raises:
        StageError: nothing may be or could be asked, or no answer could be read.
    """
    return ask(
        target,
        images,
        _telling_names(part_names),
        samples=asking.samples,
        temperature=asking.temperature,
        cache=AnswerCache(folder),
        limits=asking.limits,
        allow_upload=asking.allow_upload,
        offline=asking.offline,
        progress=progress,
    )


def identify_by_model(
    target: Endpoint,
    images: SubImages,
    part_names: Sequence[str],
    rules: MaterialBook,
    *,
    asking: Asking,
    folder: Path,
    progress: Progress = SILENT,
) -> Identification:
    """Name the material of every part.

    Args:
        target: the model.
        images: what is sent.
        part_names: names of all parts in the order of their numbers.
        rules: the rule table's materials: the second opinion, and the answer for parts that the model left out.
        asking: how to ask.
        folder: where answers and the summary are kept.
        progress: told what is sent, what it cost, and what was found.

    Raises:
        StageError: nothing may be or could be asked, or no answer could be read.
    """
    asked = ask_names(target, images, part_names, asking, folder=folder, progress=progress)
    _tell(asked, asking, progress)
    agreed: dict[str, PartConsensus] = {}
    checked: dict[str, Checked] = {}
    book: dict[str, PartMaterials] = {}
    for number, name in enumerate(part_names):
        letter = images.letters.get(number)
        consensus = None if letter is None else part_consensus(letter, asked.readings)
        if consensus is None:
            book[name] = _left_out(rules.parts[name], hidden=letter is None)
            continue
        agreed[name] = consensus
        checked[name] = check_part(
            consensus, rules.parts[name], model=target.model, trust=asking.trust, origin=asking.origin
        )
        book[name] = checked[name].materials
        if consensus.shape == "hollow":
            wall = (
                "" if consensus.thickness_m is None else f", with a wall of about {1e3 * consensus.thickness_m:.2g} mm"
            )
            progress.note(f"{target.model}: part '{name}' ({consensus.what_it_is}) is hollow{wall}.")
    heights = [reading.height_m for reading in asked.readings if reading.height_m is not None]
    found = Identification(
        book=MaterialBook(book),
        asked=asked,
        thing=next((reading.thing for reading in asked.readings if reading.thing), ""),
        height_m=statistics.median(heights) if heights else None,
        agreed=agreed,
        checked=checked,
    )
    _write_json(folder / "identification.json", _summary(target, asking, images, part_names, found))
    return found


def _telling_names(part_names: Sequence[str]) -> dict[int, str]:
    """Names by part number, without those that were only numbered (part_0)."""
    return {number: name for number, name in enumerate(part_names) if not name.startswith("part_")}


def kept_answers(summary: Mapping[str, Any]) -> tuple[str, list[Reading], dict[str, str]]:
    """The model, its answers and the letters of the parts, from what ``identification.json`` holds.

    Raises:
        RunError: it holds something else.
    """
    try:
        rows = summary["parts"]
        letters = {name: str(row["letter"]) for name, row in rows.items()}
        count = max(len(row["answers"]) for row in rows.values())
        readings = [
            Reading(
                thing=summary["object"],
                height_m=None,
                parts={row["letter"]: _part_reading(row["answers"][k]) for row in rows.values() if row["answers"][k]},
                notes=(),
            )
            for k in range(count)
        ]
    except (KeyError, TypeError, IndexError, ValueError, AttributeError) as error:
        raise RunError(
            "identification.json: expected the answers of a model, got a damaged file; run 'phys4dgen identify' again."
        ) from error
    return str(summary["model"]), readings, letters


def _part_reading(row: Mapping[str, Any]) -> PartReading:
    return PartReading(**{**row, "surface": SideReading(**row["surface"]), "interior": SideReading(**row["interior"])})


def _tell(asked: Asked, asking: Asking, progress: Progress) -> None:
    if asked.from_cache:
        progress.note(f"{asked.from_cache} of {asking.samples} answers were replayed from the run folder.")
    for note in asked.notes:
        progress.note(f"Asking: {note}.")
    if asked.failures:
        reasons = "; ".join(dict.fromkeys(asked.failures))
        progress.warn(f"Only {len(asked.readings)} of {asking.samples} answers could be used: {reasons}.")
    notes = dict.fromkeys(note for reading in asked.readings for note in reading.notes)
    for note in list(notes)[:10]:
        progress.note(f"Answers: {note}.")


def _left_out(materials: PartMaterials, *, hidden: bool) -> PartMaterials:
    """The rule table's materials for a part without an answer."""
    why = "no view shows enough of this part to ask for it" if hidden else "no answer describes this part"

    def with_reason(material: Any) -> Any:
        return replace(material, warnings=(f"{why}, so the rule table decides", *material.warnings))

    return PartMaterials(surface=with_reason(materials.surface), interior=with_reason(materials.interior))


def _summary(
    target: Endpoint, asking: Asking, images: SubImages, part_names: Sequence[str], found: Identification
) -> dict[str, Any]:
    letters = {part_names[number]: letter for number, letter in images.letters.items()}
    return {
        "model": target.model,
        "base_url": target.base_url,
        "samples": asking.samples,
        "temperature": asking.temperature,
        "object": found.thing,
        "height_m": found.height_m,
        "tokens": asdict(found.asked.tokens),
        "requests": found.asked.requests,
        "answers_from_cache": found.asked.from_cache,
        "failures": list(found.asked.failures),
        "parts": {
            name: {
                "letter": letters[name],
                "decided_by": found.checked[name].decided_by,
                "second_opinion": found.checked[name].second_opinion,
                "origin_used": found.checked[name].origin,
                "consensus": asdict(consensus),
                "answers": [_answer(reading, letters[name]) for reading in found.asked.readings],
            }
            for name, consensus in found.agreed.items()
        },
    }


def _answer(reading: Reading, letter: str) -> dict[str, Any] | None:
    part = reading.parts.get(letter)
    return None if part is None else asdict(part)


def _write_json(path: Path, value: Any) -> None:
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(value, indent=1, allow_nan=False) + "\n", encoding="utf-8")
