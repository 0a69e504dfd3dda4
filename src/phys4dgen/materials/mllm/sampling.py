"""Several independent answers to one question: concurrent, bounded, cached, replayable.

A server that cannot do what is asked is met halfway, each step at most once per sample: JSON by schema, JSON without,
plain text with the schema written into it; ``temperature`` and the name of the token bound are dropped where they are
rejected. The total of requests, tokens and time is bounded whatever a server does.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Coroutine, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from phys4dgen.errors import StageError
from phys4dgen.materials.mllm.budget import Budget, Limits, OverBudgetError, Tokens
from phys4dgen.materials.mllm.cache import AnswerCache, RawAnswer, question_digest
from phys4dgen.materials.mllm.endpoint import DEFAULT_BASE_URL, Endpoint, key_variable
from phys4dgen.materials.mllm.prompt import messages
from phys4dgen.materials.mllm.reading import Reading, UnreadableAnswerError, read_answer
from phys4dgen.materials.mllm.subimages import SubImages
from phys4dgen.materials.mllm.transport import FORMS, Manner, Outcome, open_client, send
from phys4dgen.progress import SILENT, Progress

if TYPE_CHECKING:
    from openai import AsyncOpenAI

__all__ = ["Asked", "ask"]

_HIGH_DETAIL_TOKENS, _LOW_DETAIL_TOKENS = 800, 90
"""What a picture costs about, for the promise that the budget keeps; the server's own count replaces it."""
_CHARS_PER_TOKEN = 4
_FIRST_WAIT_S = 0.5


class _FatalError(Exception):
    """No further request will do better."""


@dataclass(frozen=True)
class Asked:
    """What a model answered.

    Attributes:
        readings: one per sample that could be read, in the order of the samples.
        failures: why each of the others has none, one phrase each.
        from_cache: how many readings were replayed.
        requests: HTTP requests that were made.
        tokens: that they cost.
        notes: how the server had to be asked, one phrase each.
    """

    readings: tuple[Reading, ...]
    failures: tuple[str, ...]
    from_cache: int
    requests: int
    tokens: Tokens
    notes: tuple[str, ...]


def ask(
    target: Endpoint,
    images: SubImages,
    names: Mapping[int, str],
    *,
    samples: int,
    temperature: float,
    cache: AnswerCache,
    limits: Limits,
    allow_upload: bool,
    offline: bool = False,
    progress: Progress = SILENT,
) -> Asked:
    """Ask for the materials of all lettered parts, ``samples`` times.

    Args:
        target: the model.
        images: the pictures.
        names: names of parts by number, where they say something.
        samples: independent answers wanted.
        temperature: of the sampling.
        cache: where answers are kept and looked for.
        limits: what may be spent.
        allow_upload: whether pictures may leave this machine.
        offline: use kept answers alone.
        progress: told what is sent, and what it cost.

    Raises:
        StageError: nothing may be or could be asked, or no answer could be read; says why in one sentence.
    """
    question = messages(images, names)
    digest = question_digest(target, question, temperature)
    letters = list(images.letters.values())
    found: dict[int, Reading] = {}
    for sample in range(samples):
        kept = cache.read(digest, sample)
        reading = None if kept is None else _read(kept.text, letters)
        if isinstance(reading, Reading):
            found[sample] = reading
    missing = [sample for sample in range(samples) if sample not in found]
    from_cache = len(found)
    failures: list[str] = []
    budget, notes = Budget(replace(limits, answer_tokens=_answer_tokens(limits, len(letters)))), []
    if missing:
        _refuse_to_ask(target, allow_upload=allow_upload, offline=offline, missing=len(missing), samples=samples)
        progress.note(
            f"Asking {target.model} at {target.host} {len(missing)} times about {len(letters)} parts; "
            f"{2 + len(letters)} pictures ({images.byte_count / 1e3:.0f} kB) go there."
        )
        sampling = _Sampling(target, images, names, letters, temperature, cache, digest, budget, progress)
        fresh, failures = _run(lambda: sampling.all(missing))
        found |= fresh
        notes = sampling.notes
        progress.note(
            f"{target.model}: {budget.tokens.question:,} tokens of questions and {budget.tokens.answer:,} of answers "
            f"in {budget.requests} requests."
        )
    if not found:
        reasons = "; ".join(dict.fromkeys(failures))
        raise StageError(f"{target.model} at {target.host} named no materials: {reasons}.")
    ordered = tuple(found[sample] for sample in sorted(found))
    return Asked(ordered, tuple(failures), from_cache, budget.requests, budget.tokens, tuple(dict.fromkeys(notes)))


def _refuse_to_ask(target: Endpoint, *, allow_upload: bool, offline: bool, missing: int, samples: int) -> None:
    if offline:
        raise StageError(
            f"{missing} of {samples} answers of {target.model} are not in the run folder and nothing may be asked "
            "offline; leave out --offline, or ask for fewer samples."
        )
    if not (allow_upload or target.is_local):
        raise StageError(
            f"pictures of the object would leave this machine for {target.host}; allow it with --allow-upload, or "
            "choose a model on this machine with --base-url http://localhost:11434/v1."
        )
    if not target.key and target.base_url.startswith(DEFAULT_BASE_URL):
        raise StageError(f"{target.model} at {target.host} needs a key in the environment variable "
                         f"{key_variable(target)}.")  # fmt: skip


def _answer_tokens(limits: Limits, parts: int) -> int:
    """Tokens that one answer may have: enough for all parts and some thought, within what models write at most."""
    return max(limits.answer_tokens, min(2000 + 800 * parts, 16_000))


def _read(text: str, letters: list[str]) -> Reading | str:
    """The reading of an answer, or why there is none."""
    try:
        return read_answer(text, letters)
    except UnreadableAnswerError as error:
        return f"the answer could not be read: {error}"


@dataclass
class _Sampling:
    """Asks for the samples of one question; ``manner`` is what all of them have learnt about the server."""

    target: Endpoint
    images: SubImages
    names: Mapping[int, str]
    letters: list[str]
    temperature: float
    cache: AnswerCache
    digest: str
    budget: Budget
    progress: Progress

    def __post_init__(self) -> None:
        self.manner = Manner("json_schema", self.temperature)
        self.notes: list[str] = []
        self._done = 0

    async def all(self, samples: list[int]) -> tuple[dict[int, Reading], list[str]]:
        """Readings by sample, and why others have none."""
        found: dict[int, Reading] = {}
        failures: list[str] = []
        slots = asyncio.Semaphore(self.budget.limits.concurrent)
        client = open_client(self.target, self.budget.limits)

        async def one(sample: int) -> None:
            async with slots:
                result = await self._sample(client, sample)
            if isinstance(result, Reading):
                found[sample] = result
            else:
                failures.append(result)
            self._done += 1
            self.progress.update(self._done, len(samples), "answers")

        try:
            async with client, asyncio.timeout(self.budget.left_s):
                fatal = await _all_or_first_fatal([one(sample) for sample in samples])
        except TimeoutError:
            failures.append(f"the time of {self.budget.limits.total_s:g} s for all answers is over")
        else:
            failures = [fatal, *failures] if fatal else failures
        return found, failures

    async def _sample(self, client: AsyncOpenAI, sample: int) -> Reading | str:
        """One answer, or why there is none."""
        tries_left, wait_s, least_form = self.budget.limits.retries, _FIRST_WAIT_S, 0
        while True:
            learnt = self.manner
            manner = replace(learnt, form=FORMS[max(FORMS.index(learnt.form), least_form)])
            try:
                outcome = await self._request(client, manner)
            except OverBudgetError as error:
                return str(error)
            if outcome.kind == "fatal":
                raise _FatalError(outcome.text)
            if outcome.kind == "refused":
                return outcome.text
            if outcome.kind == "rejected":
                if self.manner == learnt and not self._give_way(outcome.text):
                    raise _FatalError(f"the request was rejected ({outcome.text})")
                continue
            if outcome.kind == "answer":
                reading = _read(outcome.text, self.letters)
                if isinstance(reading, Reading):
                    self._keep(sample, outcome, manner)
                    return reading
                problem = reading
                least_form = min(FORMS.index(manner.form) + 1, len(FORMS) - 1)
                if manner.form == "text":
                    tries_left -= 1
            else:
                problem = outcome.text
                pause_s = wait_s if outcome.wait_s is None else outcome.wait_s
                if pause_s > self.budget.limits.wait_s or pause_s >= self.budget.left_s:
                    return f"{problem}; the server asks to wait {pause_s:.0f} s"
                wait_s *= 2
                tries_left -= 1
                if tries_left >= 0:
                    if outcome.kind == "busy":
                        self.budget.hush(pause_s)
                    else:
                        await asyncio.sleep(pause_s)
            if tries_left < 0:
                return problem

    async def _request(self, client: AsyncOpenAI, manner: Manner) -> Outcome:
        question = messages(self.images, self.names, schema_in_text=manner.form != "json_schema")
        estimate = _question_tokens(question)
        promise = await self.budget.begin(estimate)
        question_tokens = answer_tokens = 0
        try:
            outcome = await send(client, self.target, question, manner, self.budget.limits)
            if outcome.kind in ("answer", "refused"):
                said = len(outcome.text) // _CHARS_PER_TOKEN
                question_tokens = estimate if outcome.question_tokens is None else outcome.question_tokens
                answer_tokens = said if outcome.answer_tokens is None else outcome.answer_tokens
            return replace(outcome, question_tokens=question_tokens, answer_tokens=answer_tokens)
        finally:
            self.budget.end(promise, question_tokens, answer_tokens)

    def _give_way(self, said: str) -> bool:
        """Change the manner so that a rejected request may pass; False where nothing is left to give."""
        words = said.lower()
        manner = self.manner
        if "temperature" in words and manner.temperature is not None:
            self.manner = replace(manner, temperature=None)
            self.notes.append("the server refuses a temperature; its own is used")
        elif "max_tokens" in words and manner.token_limit == "max_tokens":
            self.manner = replace(manner, token_limit="max_completion_tokens")
        elif "max_completion_tokens" in words and manner.token_limit is not None:
            self.manner = replace(manner, token_limit=None)
        elif manner.form != FORMS[-1]:
            self.manner = replace(manner, form=FORMS[FORMS.index(manner.form) + 1])
            self.notes.append(f"the server refuses the form {manner.form}; asked by {self.manner.form}")
        else:
            return False
        return True

    def _keep(self, sample: int, outcome: Outcome, manner: Manner) -> None:
        if manner.form != "json_schema":
            self.notes.append(f"an answer came by {manner.form}")
        answer = RawAnswer(
            text=outcome.text,
            form=manner.form,
            temperature=manner.temperature,
            question_tokens=outcome.question_tokens or 0,
            answer_tokens=outcome.answer_tokens or 0,
        )
        try:
            self.cache.write(self.digest, sample, answer)
        except OSError as error:
            self.notes.append(f"an answer could not be kept for later ({error.strerror})")


async def _all_or_first_fatal(work: list[Coroutine[Any, Any, None]]) -> str:
    """Wait for all; the phrase of a fatal error, which ends the others, or an empty one."""
    fatal = ""
    try:
        async with asyncio.TaskGroup() as group:
            for piece in work:
                group.create_task(piece)
    except* _FatalError as errors:
        first: BaseException = errors
        while isinstance(first, BaseExceptionGroup):
            first = first.exceptions[0]
        fatal = str(first)
    return fatal


def _question_tokens(question: list[dict[str, Any]]) -> int:
    """About how many tokens a question has."""
    count = 0
    for message in question:
        blocks = message["content"] if isinstance(message["content"], list) else [{"text": message["content"]}]
        for block in blocks:
            if "image_url" in block:
                count += _HIGH_DETAIL_TOKENS if block["image_url"]["detail"] == "high" else _LOW_DETAIL_TOKENS
            else:
                count += len(block["text"]) // _CHARS_PER_TOKEN
    return count


def _run(begin: Callable[[], Any]) -> Any:
    """Run a coroutine to its end, also from inside a running event loop (a notebook), where it gets its own thread."""
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return asyncio.run(begin())
    result: Future[Any] = Future()

    def work() -> None:
        try:
            result.set_result(asyncio.run(begin()))
        except BaseException as error:  # noqa: BLE001  handed to the caller's thread
            result.set_exception(error)

    threading.Thread(target=work, name="identify", daemon=True).start()
    return result.result()
