"""Mutated files into every reader: ``python -m benchmarks fuzz [--reader NAME] [--minutes N] [--keep FOLDER]``.

A reader may refuse (an error of phys4dgen, one printable sentence) or return. Any other exception, a warning, a word in
the log of another library, a read that takes more than 5 s, or one that asks for more than 500 MB, is a finding, whose
file is kept. Exit code 1 if there are any. The same seed tries the same files.
"""

from __future__ import annotations

import argparse
import logging
import random
import resource
import sys
import tempfile
import time
import warnings
from collections.abc import Sequence
from pathlib import Path

from benchmarks.fuzz_targets import Target, targets
from phys4dgen.errors import Phys4DGenError
from phys4dgen.materials.mllm.reading import UnreadableAnswerError

SECONDS = 5.0
MEMORY_BYTES = 500_000_000
NUMBERS = (b"-1", b"0", b"1e999", b"nan", b"4294967295", b"99999999999999999999", b"1" * 400, b"")
WORDS = (
    b"\0",
    b"\xff" * 4,
    b"\x00\x00\x00\x80",
    b"\x00\x00\xc0\x7f",
    b"[",
    b"{",
    b"&a ",
    b"*a",
    b"!!",
    b"\n",
    b": ",
    b"'",
)


def main(reader: str | None, *, minutes: float, keep: Path, seed: int) -> int:
    """Fuzz one reader, or all one after the other."""
    known = targets()
    logging.getLogger("phys4dgen").setLevel(logging.CRITICAL)
    logging.getLogger().addHandler(_log_of_others)
    if reader is not None and reader not in known:
        sys.stderr.write(f"there is no reader '{reader}'; there are {', '.join(known)}.\n")
        return 2
    found = 0
    for name in known if reader is None else [reader]:
        found += fuzz(name, known[name], seconds=60 * minutes, keep=keep, seed=seed)
    return 1 if found else 0


def fuzz(name: str, target: Target, *, seconds: float, keep: Path, seed: int) -> int:
    """Try mutations for so long; returns the number of findings."""
    rng = random.Random(f"{name} {seed}")
    ends, tried, refused, kinds = time.monotonic() + seconds, 0, 0, set[str]()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"a{target.suffix}"
        for content in target.seeds:
            path.write_bytes(content)
            target.read(path)  # warm, and proof that the seeds are good
        while time.monotonic() < ends:
            content = mutated(rng, target.seeds)
            path.write_bytes(content)
            problem, was_refused = attempt(target, path)
            tried, refused = tried + 1, refused + was_refused
            if problem and problem not in kinds:
                kinds.add(problem)
                keep.mkdir(parents=True, exist_ok=True)
                kept = keep / f"{name}_{len(kinds)}{target.suffix}"
                kept.write_bytes(content)
                print(f"  {name}: {problem} ({kept})", flush=True)
    print(f"{name:12} {tried:7} files, {refused / max(tried, 1):4.0%} refused, {len(kinds)} findings", flush=True)
    return len(kinds)


class _Listener(logging.Handler):
    """Keeps what would reach a user's terminal beside the one sentence."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.records: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.records.append(f"{record.name}: {record.getMessage()[:120]}")


_log_of_others = _Listener()


def attempt(target: Target, path: Path) -> tuple[str, bool]:
    """What is wrong with how a reader takes a file, and whether it refused it."""
    start = time.monotonic()
    in_use = int(Path("/proc/self/statm").read_text("ascii").split()[0]) * resource.getpagesize()
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (in_use + MEMORY_BYTES, before[1]))
    problem, refused = "", False
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            target.read(path)
    except (Phys4DGenError, UnreadableAnswerError) as error:
        refused = True
        if not str(error).isprintable():
            problem = f"unprintable sentence {str(error)[:200]!r}"
    except Exception as error:  # noqa: BLE001  that is what is looked for
        problem = f"{type(error).__name__}: {str(error)[:160]}"
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
    if _log_of_others.records:
        problem = problem or f"logged {_log_of_others.records[0]}"
        _log_of_others.records.clear()
    if time.monotonic() - start > SECONDS:
        problem = problem or "took more than 5 s"
    return problem, refused


def mutated(rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """One of the seeds with one to six random faults."""
    content = bytearray(rng.choice(seeds))
    for _ in range(rng.choice((1, 1, 2, 3, 6))):
        at = rng.randrange(len(content) + 1)
        length = min(rng.choice((1, 1, 2, 4, 8, 64, 500)), len(content) - at)
        kind = rng.randrange(8)
        if kind == 0:
            for place in range(at, at + length):
                content[place] = rng.randrange(256)
        elif kind == 1 and length:
            content[at] ^= 1 << rng.randrange(8)
        elif kind == 2:
            del content[at : at + length]
        elif kind == 3:
            content[at:at] = content[at : at + length] * rng.choice((1, 2, 30))
        elif kind == 4:
            content[at:at] = rng.choice(WORDS)
        elif kind == 5:
            other = rng.choice(seeds)
            content[at : at + length] = other[rng.randrange(len(other)) :][:length]
        elif kind == 6:
            digits = [i for i, byte in enumerate(content) if 48 <= byte <= 57]
            if digits:
                place = rng.choice(digits)
                content[place : place + 1] = rng.choice(NUMBERS)
        else:
            del content[rng.randrange(len(content) + 1) :]
    return bytes(content)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--reader")
    parser.add_argument("--minutes", type=float, default=0.2)
    parser.add_argument("--keep", type=Path, default=Path(tempfile.gettempdir()) / "phys4dgen_fuzz")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    sys.exit(main(chosen.reader, minutes=chosen.minutes, keep=chosen.keep, seed=chosen.seed))
