"""Labels that somebody has changed in ``groups.npz`` itself: told from made ones, and never overwritten."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from phys4dgen.run.folder import RunFolder
from phys4dgen.types import Parts

__all__ = ["digest_of_parts", "spare_edited_groups"]


def digest_of_parts(parts: Parts) -> str:
    """Digest of labels and names, which ``groups.npz`` holds as ``made_as``."""
    digest = hashlib.sha256(np.ascontiguousarray(parts.labels, np.int32).tobytes())
    digest.update("\n".join(parts.names).encode())
    return digest.hexdigest()


def spare_edited_groups(run: RunFolder) -> Path | None:
    """Move a ``groups.npz`` that was edited by hand aside; where it is now, or None where nobody edited one."""
    if not run.groups_npz.is_file():
        return None
    with np.load(run.groups_npz, allow_pickle=False) as arrays:
        labels = arrays["labels"]
        parts = Parts(labels[labels >= 0], tuple(str(name) for name in arrays["names"]), "file")
        untouched = "made_as" in arrays and str(arrays["made_as"]) == digest_of_parts(parts)
    if untouched:
        return None
    number = 1
    while (kept := run.groups_npz.with_name(f"groups_edited_{number}.npz")).exists():
        number += 1
    run.groups_npz.replace(kept)
    return kept
