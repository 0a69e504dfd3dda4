"""Questions to a misbehaving server on 127.0.0.1, and the sentence that they end in."""

import pytest

from mllm_recordings import answer, part, side
from phys4dgen.errors import StageError
from phys4dgen.materials.mllm.budget import Limits
from phys4dgen.materials.mllm.cache import AnswerCache
from phys4dgen.materials.mllm.endpoint import endpoint
from phys4dgen.materials.mllm.sampling import ask

KEY = "sk-test-4f9a7c21d8"
QUICK = Limits(total_s=30, request_s=15, wait_s=1.0, retries=2)
RUBBER = side("rubber", 2e6, 1100, 0.48)
GOOD = answer(part("A", RUBBER), part("B", RUBBER), thing="a ball")


def asking(folder, images):
    """What asks a server about ``images`` and keeps its answers in ``folder``."""

    def run(server, *, samples=3, limits=QUICK, model="gpt-4o", **options):
        target = endpoint(model, server.url, environment={"PHYS4DGEN_MLLM_KEY": KEY})
        return ask(
            target, images, {0: "pot"}, samples=samples, temperature=0.8, cache=AnswerCache(folder / "answers"),
            limits=limits, allow_upload=False, **options,
        )  # fmt: skip

    return run


def refusal(asked, server, **options):
    """The sentence that asking ends in; it never holds the key and never spans lines."""
    with pytest.raises(StageError) as caught:
        asked(server, **options)
    sentence = str(caught.value)
    assert KEY not in sentence
    assert "\n" not in sentence
    assert len(sentence) < 600
    assert caught.value.__cause__ is None
    return sentence
