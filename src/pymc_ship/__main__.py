"""The command ``pymc-ship`` as ``python -m pymc_ship``."""

import sys

from pymc_ship.cli.main import main

if __name__ == "__main__":  # worker processes import this file, too
    sys.exit(main())
