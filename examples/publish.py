"""
The tables that a script prints, put into pages
===============================================

    python examples/publish.py "docs/reproduction.md: table 4.1" examples/thesis/plot_table_4_1.py --full

runs a script with its arguments, and puts the tables that it prints, in their order, between the marks of this name of
these pages. The scripts of the gallery print tables; they know of no pages, because they also are notebooks.
"""

import re
import subprocess
import sys
from datetime import date
from pathlib import Path

from common import ROOT, machine, replace_table

TABLE = re.compile(r"((?:^\|.*\n)+)(.*)\n", re.M)
"""A Markdown table, and the line behind it, which may be empty."""

words = sys.argv[1:]
script = next((k for k, word in enumerate(words) if word.endswith(".py")), len(words))
places, command = words[:script], words[script:]
if not places or not command or not all(": " in place for place in places):
    sys.exit('give "PAGE: MARK" for each table, then the script and its arguments')
done = subprocess.run([sys.executable, *command], stdout=subprocess.PIPE, text=True, check=False)
print(done.stdout, end="")
if done.returncode:
    sys.exit(done.returncode)
tables = TABLE.findall(done.stdout)
if len(tables) != len(places):
    sys.exit(f"{command[0]} must print {len(places)} tables, one for each page; it has printed {len(tables)}")
for place, (table, note) in zip(places, tables, strict=True):
    page, _, kind = place.partition(": ")
    made = f"{note} Made on {date.today()} on {machine()}.".strip()
    replace_table(ROOT / Path(page), kind, *table.splitlines(), "", made)
