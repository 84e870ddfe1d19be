"""``python -m dmis``."""

import sys

from dmis.cli.commands import main

if __name__ == "__main__":
    sys.exit(main())
