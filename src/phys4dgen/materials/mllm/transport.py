"""One HTTP request to an OpenAI-compatible endpoint, and what its outcome means.

The ``openai`` package does the protocol (``chat.completions.parse``); its own retries and redirects are off: retries
are counted in ``sampling``, and a redirect would carry the pictures to another machine. Responses are bounded while
they arrive. What a server says is made harmless, and free of the key, before it goes anywhere.
"""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from phys4dgen.errors import StageError
from phys4dgen.materials.mllm.budget import Limits
from phys4dgen.materials.mllm.endpoint import Endpoint
from phys4dgen.materials.mllm.schema import Answer
from phys4dgen.materials.mllm.text import harmless

if TYPE_CHECKING:
    from openai import AsyncOpenAI

__all__ = ["FORMS", "Form", "Manner", "Outcome", "open_client", "send"]

Form = Literal["json_schema", "json_object", "text"]
FORMS: tuple[Form, ...] = ("json_schema", "json_object", "text")
"""How the shape of the answer is asked for, from the strictest to what every server understands."""


@dataclass(frozen=True)
class Manner:
    """How a server wants to be asked; it starts as OpenAI's documentation says and gives way to refusals.

    Attributes:
        form: how the shape of the answer is asked for.
        temperature: None leaves it out (reasoning models refuse it).
        token_limit: name of the parameter that bounds the answer; None leaves it out.
    """

    form: Form
    temperature: float | None
    token_limit: Literal["max_tokens", "max_completion_tokens"] | None = "max_tokens"


@dataclass(frozen=True)
class Outcome:
    """What came of one request.

    Attributes:
        kind: answer; refused (by the model); rejected (a parameter, HTTP 400); fatal (no other request will do
            better); busy (try later); broken (try again).
        text: the answer, or a phrase on what went wrong.
        wait_s: how long a busy server asks to wait, if it says.
        question_tokens: as reported, else None.
        answer_tokens: as reported, else None.
    """

    kind: Literal["answer", "refused", "rejected", "fatal", "busy", "broken"]
    text: str
    wait_s: float | None = None
    question_tokens: int | None = None
    answer_tokens: int | None = None


class _TooLongError(Exception):
    """A response is longer than allowed."""


def open_client(target: Endpoint, limits: Limits) -> AsyncOpenAI:
    """A client for an endpoint; close it in the event loop that used it.

    Raises:
        StageError: the extra is not installed.
    """
    try:
        import httpx2
        from openai import AsyncOpenAI, DefaultAsyncHttpxClient
    except ImportError as error:
        raise StageError(
            "materials by a model need the openai package; install it with: pip install 'phys4dgen[mllm]'."
        ) from error

    class Bounded(httpx2.AsyncByteStream):
        """A response body that stops where it gets too long."""

        def __init__(self, inner: Any) -> None:
            self._inner = inner

        async def __aiter__(self) -> AsyncIterator[bytes]:
            count = 0
            async for chunk in self._inner:
                count += len(chunk)
                if count > limits.response_bytes:
                    raise _TooLongError
                yield chunk

        async def aclose(self) -> None:
            await self._inner.aclose()

    async def bound(response: httpx2.Response) -> None:
        if response.headers.get("content-encoding", "identity").lower() != "identity":
            raise _TooLongError  # not asked for; a small packed body may hide a huge one
        response.stream = Bounded(response.stream)

    http = DefaultAsyncHttpxClient(
        follow_redirects=False,
        trust_env=not target.is_local,
        headers={"accept-encoding": "identity"},
        event_hooks={"response": [bound]},
    )
    client = AsyncOpenAI(
        api_key=target.key or "none",
        base_url=target.base_url,
        max_retries=0,
        timeout=limits.request_s,
        http_client=http,
    )
    _ = client.chat.completions.with_raw_response  # imported now, not inside the time of the first request
    return client


async def send(
    client: AsyncOpenAI, target: Endpoint, messages: list[dict[str, Any]], manner: Manner, limits: Limits
) -> Outcome:
    """Send one request and judge what comes back; raises nothing that a server can cause."""
    import openai

    options: dict[str, Any] = {"model": target.model, "messages": messages}
    if manner.temperature is not None:
        options["temperature"] = manner.temperature
    if manner.token_limit is not None:
        options[manner.token_limit] = limits.answer_tokens
    raw = client.chat.completions.with_raw_response
    try:
        async with asyncio.timeout(limits.request_s):
            if manner.form == "json_schema":
                response = await raw.parse(response_format=Answer, **options)
            elif manner.form == "json_object":
                response = await raw.create(response_format={"type": "json_object"}, **options)
            else:
                response = await raw.create(**options)
            body = response.http_response.text
    except openai.APIStatusError as error:
        return _refusal_of_server(error.response, target)
    except (openai.APITimeoutError, TimeoutError):
        return Outcome("broken", f"no answer within {limits.request_s:g} s")
    except openai.APIConnectionError as error:
        if isinstance(error.__cause__, _TooLongError):
            return Outcome("fatal", f"its response is packed or longer than {limits.response_bytes:,} bytes")
        return Outcome("broken", "the connection failed or was dropped")
    except _TooLongError:
        return Outcome("fatal", f"its response is packed or longer than {limits.response_bytes:,} bytes")
    except (openai.OpenAIError, UnicodeError) as error:
        return Outcome("broken", f"its response could not be read ({type(error).__name__})")
    return _answer_in(body, target, limits)


def _answer_in(body: str, target: Endpoint, limits: Limits) -> Outcome:
    """The text of the answer in the body of a response."""
    try:
        tree = json.loads(body)
        choice = tree["choices"][0]
        message = choice["message"]
        content, refusal = message.get("content"), message.get("refusal")
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, RecursionError):
        return Outcome("broken", "its response is not that of a chat completion")
    usage = tree.get("usage") if isinstance(tree.get("usage"), dict) else {}
    spent = {"question_tokens": _count(usage, "prompt_tokens"), "answer_tokens": _count(usage, "completion_tokens")}
    if refusal:
        said = harmless(target.without_key(str(refusal)), limit=120)
        return Outcome("refused", f"the model refused: '{said}'", **spent)
    if not isinstance(content, str) or not content.strip():
        return Outcome("refused", "the model answered nothing", **spent)
    if choice.get("finish_reason") == "length":
        return Outcome("refused", f"the answer was cut off at {limits.answer_tokens:,} tokens", **spent)
    if choice.get("finish_reason") == "content_filter":
        return Outcome("refused", "the provider's content filter withheld the answer", **spent)
    return Outcome("answer", target.without_key(content), **spent)


def _count(usage: Mapping[str, Any], key: str) -> int | None:
    value = usage.get(key)
    return value if isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 10**9 else None


def _refusal_of_server(response: Any, target: Endpoint) -> Outcome:
    """What an HTTP status other than 200 means."""
    status = int(response.status_code)
    said = _said(response, target)
    phrase = f"HTTP {status}" + (f": '{said}'" if said else "")
    if status in (401, 403):
        return Outcome("fatal", f"the key was not accepted ({phrase})")
    if status == 404:
        return Outcome("fatal", f"there is no model '{target.model}' or no such address ({phrase})")
    if status in (400, 422):
        return Outcome("rejected", phrase)
    if status == 429:
        if "quota" in said.lower() or "billing" in said.lower():
            return Outcome("fatal", f"the account has no quota left ({phrase})")
        return Outcome("busy", phrase, wait_s=_retry_after_s(response.headers))
    if status >= 500 or status in (408, 409):
        return Outcome("broken", phrase, wait_s=_retry_after_s(response.headers))
    return Outcome("fatal", phrase)


def _said(response: Any, target: Endpoint) -> str:
    """The server's own words, short, harmless and without the key."""
    try:
        tree = json.loads(response.text)
        error = tree.get("error", tree) if isinstance(tree, dict) else tree
        words = error.get("message", "") if isinstance(error, dict) else error
    except (ValueError, RecursionError):
        words = ""
    except Exception:  # noqa: BLE001  the body may be anything, also one that was never read
        words = ""
    return harmless(target.without_key(str(words)), limit=160)


def _retry_after_s(headers: Mapping[str, str]) -> float | None:
    """Seconds that ``Retry-After`` asks for; dates are left to the client's own patience."""
    try:
        seconds = float(headers.get("retry-after", ""))
    except ValueError:
        return None
    return seconds if math.isfinite(seconds) and seconds >= 0 else None
