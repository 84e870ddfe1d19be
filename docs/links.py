"""Check that internal links of the built site lead to a page, and to a place on it."""

import re
from functools import cache
from html import unescape
from pathlib import Path
from urllib.parse import unquote

import redirects
from sphinx.application import Sphinx
from sphinx.util import logging

LOGGER = logging.getLogger(__name__)


@cache
def find_ids(page: Path) -> set[str]:
    """Return what links may point at in a page."""
    return {unescape(name) for name in re.findall(r'\bid="([^"]+)"', page.read_text("utf-8"))}


def warn_of_broken_links(app: Sphinx, failure: Exception | None) -> None:
    """Log a warning, which fails ``make docs``, for each link or picture of a page or redirect that leads nowhere."""
    if failure or app.builder.format != "html":
        return
    for name in sorted(app.env.found_docs | redirects.MOVED.keys()):
        page = Path(app.builder.get_outfilename(name))
        for link in sorted(set(re.findall(r'\b(?:href|src)="([^"]*)"', page.read_text("utf-8")))):
            address, _, place = unquote(unescape(link)).partition("#")
            if re.match(r"[a-z]+:|//", address):
                continue
            target = (page.parent / address.partition("?")[0]).resolve() if address else page
            if not target.exists():
                LOGGER.warning("link to a page that does not exist: %s", link, location=name)
            elif place and target.suffix == ".html" and place not in find_ids(target):
                LOGGER.warning("link to a place that does not exist: %s", link, location=name)
