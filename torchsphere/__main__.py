"""``python -m torchsphere``: the command line."""

import sys

from torchsphere.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
