"""Addresses of servers in a scene: refused where they hold a secret, and never repeated in an error."""

from __future__ import annotations

from urllib.parse import urlsplit

__all__ = ["checked_address"]


def checked_address(text: str) -> str:
    """The address of an API, without a slash at its end.

    Raises:
        ValueError: it is no http address, or holds what may be secret (user, password, query); the text does not
            repeat it.
    """
    address = text.strip().rstrip("/")
    unusable = ValueError("expected an address such as http://localhost:11434/v1")
    try:
        parts = urlsplit(address)
        is_address = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
    except ValueError:
        raise unusable from None
    if not is_address:
        raise unusable
    if "@" in parts.netloc or parts.query or parts.fragment:
        raise ValueError(
            "expected an address without user, password or query; a key belongs into the environment, as "
            "docs/materials-from-a-model.md says"
        )
    return address
