"""Redirect the addresses of pages that were merged into others.

The stub of an old page keeps the anchor of the address. If the new page has no such place, browsers show its top.
"""

from pathlib import Path
from typing import Any

MOVED = {
    "bench-files": "mis-bench",
    "checks": "extending",
    "conventions": "glossary",
    "error-time": "results",
    "learned-rules": "rules",
    "literature": "results",
    "measurements": "results",
    "models": "scenes",
    "paper": "report",
    "pbrt": "scenes",
    "published": "results",
    "reproduction": "thesis",
    "tables": "results",
    "theory-extensions": "theory",
    "what-weights-save": "results",
    "your-rule": "extending",
}
"""Old pages, and the pages that have their content."""
STUB = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Moved: {page}</title>
<link rel="canonical" href="{page}.html">
<script>location.replace("{page}.html" + location.hash)</script>
<noscript><meta http-equiv="refresh" content="0; url={page}.html"></noscript></head>
<body><p>This page is now a part of <a href="{page}.html">{page}</a>.</p></body></html>
"""


def stubs() -> dict[str, str]:
    """Return the stubs of the old pages by file name."""
    return {f"{old}.html": STUB.format(page=page) for old, page in MOVED.items()}


def write_stubs(app: Any, failure: Exception | None) -> None:
    """Write the stubs into the built site."""
    if failure or app.builder.format != "html":
        return
    for name, stub in stubs().items():
        Path(app.outdir, name).write_text(stub, "utf-8")
