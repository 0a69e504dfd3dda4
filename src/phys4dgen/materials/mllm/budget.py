"""What asking may cost: a bound on requests, tokens and time for one identification, and a limit on the rate."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from dataclasses import dataclass, field

__all__ = ["Budget", "Limits", "OverBudgetError", "Tokens"]


class OverBudgetError(Exception):
    """Nothing more may be asked; the message is a phrase for users."""


@dataclass(frozen=True)
class Limits:
    """Bounds on one identification.

    Attributes:
        requests: HTTP requests in all, retries and steps of the fallback ladder included.
        tokens: tokens in all, of questions and answers.
        answer_tokens: tokens of one answer; answers on many parts may have more.
        total_s: wall-clock time of all.
        request_s: wall-clock time of one request.
        concurrent: requests at the same time.
        per_minute: requests begun in any minute.
        retries: attempts after the first one, per sample.
        wait_s: longest wait that is granted to a server that asks for one.
        response_bytes: longest response that is read.
    """

    requests: int = 20
    tokens: int = 200_000
    answer_tokens: int = 2000
    total_s: float = 180.0
    request_s: float = 90.0
    concurrent: int = 5
    per_minute: int = 60
    retries: int = 3
    wait_s: float = 30.0
    response_bytes: int = 4_000_000


@dataclass
class Tokens:
    """Tokens as the server counts them, or estimated from the lengths where it does not."""

    question: int = 0
    answer: int = 0

    @property
    def total(self) -> int:
        """Both."""
        return self.question + self.answer


@dataclass
class Budget:
    """Spends the limits; one per identification, used from one event loop.

    Attributes:
        limits: what may be spent.
        requests: begun so far.
        tokens: reported so far.
    """

    limits: Limits
    requests: int = 0
    tokens: Tokens = field(default_factory=Tokens)
    _promised: int = 0
    _dearest: int = 0
    _began: float = field(default_factory=time.monotonic)
    _starts: deque[float] = field(default_factory=deque)
    _quiet_until: float = 0.0

    @property
    def left_s(self) -> float:
        """Time that is left."""
        return self._began + self.limits.total_s - time.monotonic()

    async def begin(self, question_tokens: int) -> int:
        """Wait for the turn of a request and promise its tokens.

        Args:
            question_tokens: estimate of the question.

        Returns:
            What was promised, for ``end``.

        Raises:
            OverBudgetError: a bound would be broken.
        """
        await self._turn()
        promise = max(question_tokens, self._dearest) + self.limits.answer_tokens
        if self.requests >= self.limits.requests:
            raise OverBudgetError(f"the bound of {self.limits.requests} requests is reached")
        if self.tokens.total + self._promised + promise > self.limits.tokens:
            raise OverBudgetError(f"the bound of {self.limits.tokens:,} tokens would be broken")
        self.requests += 1
        self._promised += promise
        return promise

    def end(self, promise: int, question: int, answer: int) -> None:
        """A request has ended and cost this many tokens."""
        self._promised -= promise
        self._dearest = max(self._dearest, question)  # the server's count is the better estimate of the next one
        self.tokens.question += question
        self.tokens.answer += answer

    def hush(self, seconds: float) -> None:
        """Begin no request for a while, because the server asked for it."""
        self._quiet_until = max(self._quiet_until, time.monotonic() + seconds)

    async def _turn(self) -> None:
        """Wait until the rate and the server allow one more request."""
        while True:
            now = time.monotonic()
            while self._starts and now - self._starts[0] >= 60:
                self._starts.popleft()
            full = len(self._starts) >= self.limits.per_minute
            wait_s = max(self._quiet_until - now, 60 - (now - self._starts[0]) if full else 0.0)
            if wait_s <= 0:
                self._starts.append(now)
                return
            if wait_s >= self.left_s:
                raise OverBudgetError(f"the next request may begin in {wait_s:.0f} s, later than the time allowed")
            await asyncio.sleep(wait_s)
