"""``python -m phys4dgen``: the same as the ``phys4dgen`` command."""

import sys

from phys4dgen.cli import main

sys.exit(main())
