"""A real HTTP server on 127.0.0.1 that speaks OpenAI's chat completions and checks every request against its schema."""

from __future__ import annotations

import base64
import io
import json
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import jsonschema
from PIL import Image

_TEXT = {
    "type": "object",
    "properties": {"type": {"const": "text"}, "text": {"type": "string", "minLength": 1}},
    "required": ["type", "text"],
    "additionalProperties": False,
}
_PICTURE = {
    "type": "object",
    "properties": {
        "type": {"const": "image_url"},
        "image_url": {
            "type": "object",
            "properties": {
                "url": {"type": "string", "pattern": "^data:image/png;base64,[A-Za-z0-9+/]+=*$"},
                "detail": {"enum": ["low", "high", "auto"]},
            },
            "required": ["url"],
            "additionalProperties": False,
        },
    },
    "required": ["type", "image_url"],
    "additionalProperties": False,
}
REQUEST = {
    "type": "object",
    "properties": {
        "model": {"type": "string", "minLength": 1},
        "messages": {
            "type": "array",
            "prefixItems": [
                {"properties": {"role": {"const": "system"}, "content": {"type": "string", "minLength": 1}}},
                {
                    "properties": {
                        "role": {"const": "user"},
                        "content": {"type": "array", "minItems": 5, "items": {"anyOf": [_TEXT, _PICTURE]}},
                    },
                },
            ],
            "items": False,
            "minItems": 2,
        },
        "temperature": {"type": "number", "minimum": 0, "maximum": 2},
        "max_tokens": {"type": "integer", "minimum": 1},
        "max_completion_tokens": {"type": "integer", "minimum": 1},
        "response_format": {
            "oneOf": [
                {"properties": {"type": {"const": "json_object"}}, "additionalProperties": False},
                {
                    "properties": {
                        "type": {"const": "json_schema"},
                        "json_schema": {
                            "type": "object",
                            "properties": {
                                "name": {"type": "string", "pattern": "^[A-Za-z0-9_-]{1,64}$"},
                                "strict": {"const": True},
                                "schema": {"type": "object"},
                            },
                            "required": ["name", "strict", "schema"],
                            "additionalProperties": False,
                        },
                    },
                    "required": ["type", "json_schema"],
                    "additionalProperties": False,
                },
            ]
        },
        "stream": {"const": False},
    },
    "required": ["model", "messages"],
    "additionalProperties": False,
}
"""What the API takes; anything else fails the test."""


@dataclass
class Reply:
    """What the server does with one request."""

    status: int = 200
    body: Any = None
    headers: dict[str, str] = field(default_factory=dict)
    wait_s: float = 0.0
    play: Callable[[BaseHTTPRequestHandler], None] | None = None


def says(text: Any, **message: Any) -> Reply:
    """A chat completion with this answer; anything but text is sent as JSON."""
    content = text if isinstance(text, str) or text is None else json.dumps(text)
    choice = {"index": 0, "finish_reason": "stop", "message": {"role": "assistant", "content": content, **message}}
    usage = {"prompt_tokens": 1000, "completion_tokens": 200, "total_tokens": 1200}
    return Reply(
        body={"id": "c", "object": "chat.completion", "created": 0, "model": "m", "choices": [choice], "usage": usage}
    )


def fails(status: int, message: str = "no", **headers: str) -> Reply:
    """An error of the API."""
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    return Reply(status, {"error": {"message": message, "type": "error", "code": None}}, named)


def hangs(handler: BaseHTTPRequestHandler) -> None:
    """Say nothing until the client goes away."""
    handler.connection.settimeout(10)
    with suppress(OSError):
        handler.connection.recv(1)
    handler.close_connection = True


def drips(handler: BaseHTTPRequestHandler) -> None:
    """Send a response byte by byte, each sooner than any read would time out."""
    handler.send_response(200)
    handler.send_header("Content-Type", "application/json")
    handler.send_header("Content-Length", "100000")
    handler.end_headers()
    try:
        for _ in range(300):
            handler.wfile.write(b" ")
            handler.wfile.flush()
            time.sleep(0.03)
    except OSError:
        pass
    handler.close_connection = True


def drops(handler: BaseHTTPRequestHandler) -> None:
    """Reset the connection in the middle of the response."""
    handler.send_response(200)
    handler.send_header("Content-Length", "1000")
    handler.end_headers()
    handler.wfile.write(b'{"id": "c", "choi')
    handler.wfile.flush()
    handler.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    handler.close_connection = True


def floods(handler: BaseHTTPRequestHandler) -> None:
    """Send more than anybody wants."""
    handler.send_response(200)
    handler.send_header("Content-Type", "application/json")
    handler.end_headers()
    try:
        for _ in range(2000):
            handler.wfile.write(b" " * 65536)
    except OSError:
        pass
    handler.close_connection = True


class Server:
    """The server; ``behave`` decides on each request, given its number from 0 and its body."""

    def __init__(self, behave: Callable[[int, dict[str, Any]], Reply]) -> None:
        self.behave = behave
        self.requests: list[dict[str, Any]] = []
        self.keys: list[str] = []
        self.problems: list[str] = []
        self.at_once = self.most_at_once = 0
        self._lock = threading.Lock()
        server = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def log_message(self, *_: Any) -> None:
                pass

            def do_POST(self) -> None:
                server._answer(self)

        class Quiet(ThreadingHTTPServer):
            daemon_threads = True

            def handle_error(self, *_: Any) -> None:
                """A client that goes away is part of the play."""

        self._http = Quiet(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self._http.server_port}/v1"

    def _answer(self, handler: BaseHTTPRequestHandler) -> None:
        raw = handler.rfile.read(int(handler.headers["Content-Length"]))
        with self._lock:
            number = len(self.requests)
            body = json.loads(raw)
            self.requests.append(body)
            self.keys.append(handler.headers.get("Authorization", ""))
            self.at_once += 1
            self.most_at_once = max(self.most_at_once, self.at_once)
        try:
            self._check(handler.path, body)
            reply = self.behave(number, body)
            time.sleep(reply.wait_s)
        finally:
            with self._lock:
                self.at_once -= 1
        if reply.play is not None:
            reply.play(handler)
            return
        data = reply.body if isinstance(reply.body, bytes) else json.dumps(reply.body).encode()
        handler.send_response(reply.status)
        handler.send_header("Content-Type", "application/json")
        for name, value in reply.headers.items():
            handler.send_header(name, value)
        handler.send_header("Content-Length", str(len(data)))
        handler.end_headers()
        handler.wfile.write(data)

    def _check(self, path: str, body: dict[str, Any]) -> None:
        """Note everything in which a request differs from what the API takes."""
        if path != "/v1/chat/completions":
            self.problems.append(f"path {path}")
        for error in jsonschema.Draft202012Validator(REQUEST).iter_errors(body):
            self.problems.append(f"{list(error.path)}: {error.message[:300]}")
        form = body.get("response_format", {})
        if form.get("type") == "json_schema":
            schema = form["json_schema"]["schema"]
            jsonschema.Draft202012Validator.check_schema(schema)
            self.problems += [f"schema: {problem}" for problem in strictness(schema)]
        for block in body["messages"][1]["content"]:
            if block["type"] == "image_url":
                png = base64.b64decode(block["image_url"]["url"].split(",")[1])
                with Image.open(io.BytesIO(png)) as image:
                    if image.format != "PNG" or max(image.size) > 768 or image.info or len(png) > 3_000_000:
                        self.problems.append(f"picture {image.format} {image.size} {image.info} {len(png)}")
                    image.load()


def strictness(schema: Any) -> Iterator[str]:
    """Where a schema breaks the rules of OpenAI's strict mode."""
    if isinstance(schema, dict):
        if schema.get("type") == "object":
            if schema.get("additionalProperties") is not False:
                yield "additionalProperties has to be false"
            if sorted(schema.get("required", [])) != sorted(schema.get("properties", {})):
                yield "every property has to be required"
        for word in ("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum", "default", "pattern"):
            if word in schema and not isinstance(schema[word], dict):
                yield f"{word} is not for strict schemas"
        for value in schema.values():
            yield from strictness(value)
    elif isinstance(schema, list):
        for value in schema:
            yield from strictness(value)


@contextmanager
def serving(behave: Callable[[int, dict[str, Any]], Reply]) -> Iterator[Server]:
    """A running server; at the end no request may have broken the API's rules."""
    server = Server(behave)
    thread = threading.Thread(target=server._http.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
    thread.start()
    try:
        yield server
        assert server.problems == []
    finally:
        server._http.shutdown()
        server._http.server_close()
