"""Files that another file names: only those in its folder and below, unless others are allowed."""

from __future__ import annotations

import glob
import re
from pathlib import Path


def named_file(folder: Path, name: str, root: Path | None) -> Path | None:
    """Return the path of the file `name`, relative to `folder`; None if there is no such file.

    Raises a ValueError if it is not in the folder `root` or below, links followed; None: it may be anywhere.
    """
    path = folder / name.strip().replace("\\", "/")
    try:
        missing = "\0" in name or not path.is_file()
    except OSError:  # a name that is too long
        missing = True
    if missing:
        return None
    if root is not None and not path.resolve().is_relative_to(root.resolve()):
        raise ValueError(
            f"the file {name[-200:]!r} is outside of the folder {root.resolve()}, which a scene must not reach unless "
            "that is allowed (outside=True, --allow-outside)"
        )
    return path


def found_file(folder: Path, name: str, root: Path | None) -> Path | None:
    r"""Return the path of a file that another machine may have named, such as ``C:\My Scene\Wood.JPG``.

    It is that of `named_file`; if there is no such file, the one in `folder` whose path is the longest end of `name`,
    upper and lower case being the same. Blanks may be escaped. None if there is none. Raises a ValueError as
    `named_file` does.
    """
    name = name.replace("\\ ", " ")
    path = named_file(folder, name, root)
    words = re.split(r"[\\/]|^\w:", name.strip())
    words = [word for word in words if word not in (".", "..") and 0 < len(word) < 256]  # longer ones are no names
    patterns = [re.sub(r"\w", lambda c: f"[{c[0].lower()}{c[0].upper()}]", glob.escape(word)) for word in words[-32:]]
    for k in range(len(patterns)):
        found = sorted(folder.glob("/".join(patterns[k:]))) if path is None else []
        path = named_file(folder, str(found[0].relative_to(folder)), root) if found else path
    return path
