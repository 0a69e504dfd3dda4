"""Answers kept by content: the same question to the same model is never paid for twice and can be replayed offline."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from phys4dgen.formats.atomic import atomic_path
from phys4dgen.materials.mllm.endpoint import Endpoint
from phys4dgen.materials.mllm.prompt import PROMPT_VERSION
from phys4dgen.materials.mllm.reading import MAX_ANSWER_CHARS

__all__ = ["AnswerCache", "RawAnswer", "question_digest"]


@dataclass(frozen=True)
class RawAnswer:
    """The text of one answer.

    Attributes:
        text: as the model wrote it, without the key should a server have echoed it.
        form: how its shape was asked for: json_schema, json_object or text.
        temperature: that was sent, None where the server refused it.
        question_tokens: as reported or estimated.
        answer_tokens: as reported or estimated.
    """

    text: str
    form: str
    temperature: float | None
    question_tokens: int
    answer_tokens: int


def question_digest(target: Endpoint, messages: Sequence[Mapping[str, Any]], temperature: float) -> str:
    """SHA-256 of everything that an answer follows from, pictures included; the key is not among it."""
    facts = {
        "model": target.model,
        "base_url": target.base_url,
        "prompt": PROMPT_VERSION,
        "temperature": temperature,
        "messages": messages,
    }
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode("utf-8")).hexdigest()


@dataclass(frozen=True)
class AnswerCache:
    """A folder with one JSON file per answer, named by the question and the number of the sample."""

    folder: Path

    def read(self, question: str, sample: int) -> RawAnswer | None:
        """The answer, or None where there is none or its file is damaged."""
        path = self._path(question, sample)
        try:
            if path.stat().st_size > 8 * MAX_ANSWER_CHARS:
                return None
            row = json.loads(path.read_text("utf-8"))
            temperature = row["temperature"]
            return RawAnswer(
                text=str(row["text"]),
                form=str(row["form"]),
                temperature=None if temperature is None else float(temperature),
                question_tokens=int(row["question_tokens"]),
                answer_tokens=int(row["answer_tokens"]),
            )
        except (OSError, ValueError, OverflowError, KeyError, TypeError, RecursionError):
            return None

    def write(self, question: str, sample: int, answer: RawAnswer) -> None:
        """Keep an answer, whole or not at all."""
        path = self._path(question, sample)
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(path) as temporary:
            temporary.write_text(json.dumps(asdict(answer), indent=1) + "\n", encoding="utf-8")

    def _path(self, question: str, sample: int) -> Path:
        return self.folder / f"{question[:32]}_{sample:03d}.json"
