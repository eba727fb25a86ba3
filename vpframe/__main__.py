"""`python -m vpframe`: the command line."""

import sys

from vpframe.app.cli import main

if __name__ == "__main__":
    sys.exit(main())
