"""Run every benchmark of this folder, each in a fresh process.

    python -m benchmarks            # all of them
    python -m benchmarks render     # benchmarks/render.py alone

Exit code 1 when one of them failed or missed its limit.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).parent


def main(chosen: list[str]) -> int:
    """Run the chosen benchmarks, or all."""
    known = sorted(path.stem for path in FOLDER.glob("*.py") if not path.stem.startswith("_"))
    unknown = set(chosen) - set(known)
    if unknown:
        sys.stderr.write(f"there is no benchmark '{min(unknown)}'; there are {', '.join(known)}.\n")
        return 2
    failed = []
    for name in chosen or known:
        print(f"== {name}", flush=True)
        if subprocess.run([sys.executable, str(FOLDER / f"{name}.py")], check=False).returncode != 0:
            failed.append(name)
    print(f"== failed or too slow: {', '.join(failed)}" if failed else "== all within their limits")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
