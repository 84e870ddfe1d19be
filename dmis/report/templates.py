"""Pages that need no network, made of the Jinja templates beside this module (extra ``plot``)."""

from __future__ import annotations

import os
import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dmis.base.atomic_files import replacing
from dmis.experiment.convergence import ratio_text

if TYPE_CHECKING:
    from jinja2 import Environment


def filled(template: str, **values: Any) -> str:
    """Return a page: a template filled in with `values`, which are escaped; an ImportError if Jinja2 is missing."""
    return _environment().get_template(template).render(values)


def write_page(path: str | os.PathLike[str], page: str) -> None:
    """Write a page to `path`, which replaces a file that is there; its folder is made."""
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as partial:
        partial.write_text(page, "utf-8")


@cache
def _environment() -> Environment:
    """Return what finds and fills in the templates; an unknown name in one of them is an error."""
    try:
        from jinja2 import Environment, PackageLoader, StrictUndefined
        from markupsafe import Markup, escape
    except ImportError as missing:
        raise ImportError("pages need Jinja2: pip install 'dmis[plot]'") from missing
    environment = Environment(
        loader=PackageLoader("dmis", "report"), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    environment.filters["ratio"] = ratio_text
    # names of rules and columns may be broken after these characters
    environment.filters["breakable"] = lambda text: Markup(re.sub("([:,_])(?! )", r"\1<wbr>", str(escape(text))))
    environment.policies["json.dumps_kwargs"] = {"separators": (",", ":")}
    return environment
