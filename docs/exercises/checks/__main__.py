"""``python docs/exercises/checks N FILE.py`` checks a solution; this folder and an installed dmis are all it needs."""

import sys

from exercises import main

if __name__ == "__main__":
    sys.exit(main())
