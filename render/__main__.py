"""``python -m render`` is the command line."""

from __future__ import annotations

import sys

from render.cli import main

if __name__ == "__main__":
    sys.exit(main())
