"""Run every benchmark of this folder, each in a fresh process.

    python -m benchmarks            # all of them
    python -m benchmarks render     # benchmarks/render.py alone
    python -m benchmarks fuzz --reader ply --minutes 10     # flags are passed on

Exit code 1 when one of them failed or missed its limit.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).parent


def main(words: list[str]) -> int:
    """Run the chosen benchmarks, or all."""
    first_flag = next((place for place, word in enumerate(words) if word.startswith("-")), len(words))
    chosen, flags = words[:first_flag], words[first_flag:]
    known = sorted(path.stem for path in FOLDER.glob("*.py") if not path.stem.startswith("_"))
    unknown = set(chosen) - set(known)
    if unknown:
        sys.stderr.write(f"there is no benchmark '{min(unknown)}'; there are {', '.join(known)}.\n")
        return 2
    failed = []
    for name in chosen or known:
        print(f"== {name}", flush=True)
        if subprocess.run([sys.executable, str(FOLDER / f"{name}.py"), *flags], check=False).returncode != 0:
            failed.append(name)
    print(f"== failed or too slow: {', '.join(failed)}" if failed else "== all within their limits")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
