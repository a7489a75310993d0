"""``python -m render``, or ``python -m torchsphere_render`` in an installation: the command line."""

from __future__ import annotations

import sys

from .cli import main

if __name__ == "__main__":
    sys.exit(main())
