"""Install what the model tests need, where that is a CPU build; otherwise say why they will be skipped.

    python scripts/install_models.py requirements-models.lock

On some platforms an index offers torch only as a CUDA build of several gigabytes: nobody wants that for tests.
"""

from __future__ import annotations

import json
import subprocess
import sys

PIP = (sys.executable, "-m", "pip", "--disable-pip-version-check")


def main(lock: str) -> None:
    """Resolve the lock, look at what it would bring, and install it if it is light enough."""
    plan = subprocess.run(
        [*PIP, "install", "--dry-run", "--quiet", "--report", "-", "-r", lock], capture_output=True, text=True
    )
    if plan.returncode != 0:
        reason = (plan.stderr.strip().splitlines() or ["pip failed"])[-1]
        print(f"Tests of learned models will be skipped: {reason}")
        return
    names = [item["metadata"]["name"].lower() for item in json.loads(plan.stdout)["install"]]
    if any(name.startswith(("nvidia", "cuda", "triton")) for name in names):
        print("Tests of learned models will be skipped: torch resolves to a CUDA build here, not to a CPU build.")
        return
    if names:
        subprocess.run([*PIP, "install", "-qq", "-r", lock], check=True)


if __name__ == "__main__":
    main(sys.argv[1])
