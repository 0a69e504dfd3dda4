"""A stamp of this package's own code, so that a changed phys4dgen does not take over results of an older one.

The version number alone would do for releases, but not for a checkout that is being worked on; and one stamp for all
code would make every edit redo every stage. So each stage has the stamp of the files that it runs
(docs/decisions/0010-reuse-by-content.md). Reading them takes a few milliseconds.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

__all__ = ["code_stamp"]

_PACKAGE = Path(__file__).parents[1]


@cache
def code_stamp(places: tuple[str, ...]) -> str:
    """Digest of names and contents of the Python and data files at ``places``.

    Args:
        places: files and folders, relative to the package; folders count with all that is in them.
    """
    digest = hashlib.sha256()
    for path in sorted({file for place in places for file in _files(_PACKAGE / place)}):
        content = path.read_bytes()
        digest.update(f"{path.relative_to(_PACKAGE).as_posix()} {len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest()


def _files(place: Path) -> Iterator[Path]:
    if place.is_dir():
        yield from (path for path in place.rglob("*") if path.suffix in (".py", ".yaml"))
    else:
        yield place
