"""The client of multimodal models: servers in trouble, and what asking may cost, against a real server on 127.0.0.1.

No real model is called: these tests prove the client, not that any model knows materials.
"""

import time
from dataclasses import replace

import pytest

from mllm_asking import GOOD, KEY, QUICK, asking, refusal
from mllm_recordings import striped_images
from mllm_server import Reply, drips, drops, fails, floods, hangs, says, serving
from phys4dgen.materials.mllm.budget import Limits

pytest.importorskip("openai")


@pytest.fixture
def images():
    return striped_images(2)


@pytest.fixture
def asked(tmp_path, images):
    """Asks a server and returns what came of it."""
    return asking(tmp_path, images)


# ----------------------------------------------------------------------------------- servers that are in trouble


def test_429_waits_as_long_as_it_is_told(asked):
    times = []

    def behave(number, body):
        times.append(time.perf_counter())
        return fails(429, "slow down", Retry_After="0.4") if number == 0 else says(GOOD)

    with serving(behave) as server:
        assert len(asked(server, samples=1).readings) == 1
    assert len(server.requests) == 2
    assert 0.4 <= times[1] - times[0] < 2


def test_429_that_asks_for_an_hour_is_not_waited_for(asked):
    with serving(lambda number, body: fails(429, "slow down", Retry_After="3600")) as server:
        began = time.perf_counter()
        assert "asks to wait 3600 s" in refusal(asked, server)
        assert time.perf_counter() - began < 3
    assert len(server.requests) == 3


def test_an_empty_account_is_not_asked_again(asked):
    with serving(lambda number, body: fails(429, "You exceeded your current quota, check billing")) as server:
        assert "no quota left" in refusal(asked, server)
    assert len(server.requests) <= 3


def test_500s_are_tried_again_and_given_up(asked):
    with serving(lambda number, body: fails(500) if number < 2 else says(GOOD)) as server:
        assert len(asked(server, samples=1).readings) == 1
    assert len(server.requests) == 3
    with serving(lambda number, body: fails(503, "overloaded")) as server:
        assert "HTTP 503: 'overloaded'" in refusal(asked, server, samples=1, limits=replace(QUICK, retries=1))
    assert len(server.requests) == 2


@pytest.mark.parametrize(("play", "words"), [(hangs, "no answer within 0.2 s"), (drips, "no answer within 0.2 s"),
                                              (drops, "connection failed or was dropped"),
                                              (floods, "longer than 4,000,000 bytes")])  # fmt: skip
def test_broken_connections_end_in_a_sentence(asked, play, words):
    limits = replace(QUICK, request_s=10 if play in (floods, drops) else 0.2, retries=1)
    with serving(lambda number, body: Reply(play=play)) as server:
        began = time.perf_counter()
        assert words in refusal(asked, server, samples=2, limits=limits)
        assert time.perf_counter() - began < 6
    assert len(server.requests) <= 4


@pytest.mark.parametrize("play", [hangs, drips, drops])
def test_a_connection_that_breaks_once_is_tried_again(asked, play):
    limits = replace(QUICK, request_s=1.0, retries=5)
    with serving(lambda number, body: Reply(play=play) if number == 0 else says(GOOD)) as server:
        assert len(asked(server, samples=1, limits=limits).readings) == 1


def test_nobody_there(asked):
    with serving(lambda number, body: says(GOOD)) as server:
        pass
    assert "the connection failed" in refusal(asked, server, samples=1, limits=replace(QUICK, retries=0))


@pytest.mark.parametrize("body", [b"", b"<html>502</html>", b"[]", b"null", b'{"choices": []}', b'{"choices": [1]}',
                                  b'{"choices": [{"message": null}]}', b"\xff\xfe"])  # fmt: skip
def test_bodies_that_are_no_chat_completion(asked, body):
    with serving(lambda number, request: Reply(body=body)) as server:
        sentence = refusal(asked, server, samples=1, limits=replace(QUICK, retries=0))
    assert "not that of a chat completion" in sentence or "could not be read" in sentence


def test_a_redirect_is_not_followed(asked):
    with serving(lambda number, body: says(GOOD)) as other:
        where = f"{other.url}/chat/completions"
        with serving(lambda number, body: Reply(307, {}, {"Location": where})) as server:
            assert "HTTP 307" in refusal(asked, server, samples=1)
    assert other.requests == []


def test_a_packed_response_is_not_unpacked(asked):
    reply = replace(says(GOOD), headers={"Content-Encoding": "gzip"})
    with serving(lambda number, body: reply) as server:
        assert "packed" in refusal(asked, server, samples=1)


@pytest.mark.parametrize("word", ["temperature", "max_tokens", "response_format", "all three"])
def test_parameters_that_a_server_rejects_are_left_out(asked, word):
    refused = ("temperature", "max_tokens", "response_format") if word == "all three" else (word,)

    def behave(number, body):
        for name in refused:
            if name in body:
                return fails(400, f"Unsupported parameter: '{name}' is not supported with this model.")
        return says(GOOD)

    with serving(behave) as server:
        found = asked(server, samples=5, limits=replace(QUICK, requests=60))
    assert len(found.readings) == 5
    last = server.requests[-1]
    assert not any(name in last for name in refused)
    if "max_tokens" in refused:
        assert last["max_completion_tokens"] > 0
    if "temperature" in refused:
        assert "temperature" in " ".join(found.notes)


def test_any_other_rejection_ends_in_the_servers_words(asked):
    with serving(lambda number, body: fails(400, "This model does not support images.")) as server:
        assert "This model does not support images." in refusal(asked, server, samples=2)
    assert len(server.requests) < 12


@pytest.mark.parametrize(("status", "words"), [(401, "key was not accepted"), (403, "key was not accepted"),
                                                (404, "no model 'gpt-4o'"), (418, "HTTP 418")])  # fmt: skip
def test_errors_that_no_retry_helps(asked, status, words):
    with serving(lambda number, body: fails(status, f"Incorrect API key provided: {KEY}")) as server:
        sentence = refusal(asked, server, samples=2)
    assert words in sentence
    assert "[key]" in sentence
    assert len(server.requests) <= 2


# ------------------------------------------------------------------------------------------------ what it costs


def test_requests_are_bounded_in_all(asked):
    with serving(lambda number, body: fails(500)) as server:
        assert "bound of 4 requests" in refusal(asked, server, samples=5, limits=replace(QUICK, requests=4))
    assert len(server.requests) == 4


def test_tokens_are_bounded_in_all(asked):
    def behave(number, body):
        reply = says(GOOD)
        reply.body["usage"] = {"prompt_tokens": 30_000, "completion_tokens": 500}
        return reply

    limits = replace(QUICK, tokens=70_000, concurrent=1)
    with serving(behave) as server:
        found = asked(server, samples=5, limits=limits)
    assert len(found.readings) == len(server.requests) == 2
    assert found.tokens.total == 61_000 <= limits.tokens
    assert "70,000 tokens" in found.failures[0]


def test_time_is_bounded_in_all(asked):
    limits = Limits(total_s=0.8, request_s=60, retries=10)
    with serving(lambda number, body: Reply(play=hangs)) as server:
        began = time.perf_counter()
        assert "time of 0.8 s" in refusal(asked, server, limits=limits)
        assert time.perf_counter() - began < 4


def test_the_rate_is_bounded(asked):
    limits = replace(QUICK, per_minute=3, total_s=2)
    with serving(lambda number, body: says(GOOD)) as server:
        found = asked(server, samples=5, limits=limits)
    assert len(found.readings) == len(server.requests) == 3
    assert "later than the time allowed" in found.failures[0]


def test_it_works_inside_a_running_event_loop(asked):
    import asyncio

    async def notebook():
        with serving(lambda number, body: says(GOOD)) as server:
            return asked(server)

    assert len(asyncio.run(notebook()).readings) == 3
