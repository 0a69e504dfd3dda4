"""Which model is asked, where, and with which key; keys stay in the environment and in the request's header."""

from __future__ import annotations

import ipaddress
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from urllib.parse import urlsplit

from phys4dgen.errors import SceneError
from phys4dgen.scene.address import checked_address

__all__ = ["DEFAULT_BASE_URL", "DEFAULT_MODEL", "KEY_VARIABLES", "Endpoint", "endpoint"]

DEFAULT_MODEL = "gpt-4o"
"""The paper's."""
DEFAULT_BASE_URL = "https://api.openai.com/v1"
_KEY_VARIABLES = {"api.openai.com": "OPENAI_API_KEY", "generativelanguage.googleapis.com": "GEMINI_API_KEY"}
OTHER_KEY_VARIABLE = "PHYS4DGEN_MLLM_KEY"
"""Environment variable with the key of any other server."""
KEY_VARIABLES = {name: host for host, name in _KEY_VARIABLES.items()} | {OTHER_KEY_VARIABLE: "any other server"}
"""Whose key an environment variable holds."""
_SHORTEST_SECRET = 8
"""Shorter keys are what people give servers that want none ("x", "EMPTY"): to replace them would spoil answers."""
_MODEL = re.compile(r"[\w][\w./:@-]{0,127}")


@dataclass(frozen=True)
class Endpoint:
    """An OpenAI-compatible endpoint and a model behind it.

    Attributes:
        model: id of the model.
        base_url: of the API, without user, password and query.
        key: secret; empty where a server on this machine needs none.
    """

    model: str
    base_url: str
    key: str = field(default="", repr=False)

    @property
    def host(self) -> str:
        """Name of the machine that is asked, with its port."""
        return urlsplit(self.base_url).netloc

    @property
    def is_local(self) -> bool:
        """Whether it is this machine, so that pictures do not leave it."""
        return _is_local(urlsplit(self.base_url).hostname or "")

    def without_key(self, text: str) -> str:
        """The text with the key, should it stand in there, replaced."""
        return text.replace(self.key, "[key]") if len(self.key) >= _SHORTEST_SECRET else text


def endpoint(
    model: str = DEFAULT_MODEL, base_url: str = DEFAULT_BASE_URL, *, environment: Mapping[str, str] | None = None
) -> Endpoint:
    """The endpoint of these settings, with the key that belongs to its host.

    ``OPENAI_API_KEY`` is sent to api.openai.com alone, ``GEMINI_API_KEY`` to Google's alone, and
    ``PHYS4DGEN_MLLM_KEY`` to any other host; no setting can send a key elsewhere.

    Args:
        model: id of the model.
        base_url: of the API.
        environment: where keys are looked up; the process's own by default.

    Raises:
        SceneError: the settings make no endpoint, or hold a key themselves.
    """
    environment = os.environ if environment is None else environment
    if not _MODEL.fullmatch(model):
        raise SceneError("materials.model: expected the id of a model, such as gpt-4o or gemma3:12b.")
    try:
        address = checked_address(base_url)
    except ValueError as error:
        raise SceneError(f"materials.base_url: {error}.") from None
    parts = urlsplit(address)
    host = parts.hostname or ""
    variable = _KEY_VARIABLES.get(host, OTHER_KEY_VARIABLE)
    key = environment.get(variable, "").strip()
    if key and parts.scheme == "http" and not _is_local(host):
        raise SceneError(f"materials.base_url: a key is not sent without encryption to {host}; use https.")
    return Endpoint(model, address, key)


def key_variable(target: Endpoint) -> str:
    """Name of the environment variable that holds the key of an endpoint."""
    return _KEY_VARIABLES.get(urlsplit(target.base_url).hostname or "", OTHER_KEY_VARIABLE)


def _is_local(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
