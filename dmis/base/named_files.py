"""Files that another file names: only those in its folder and below, unless others are allowed."""

from __future__ import annotations

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
