"""Files that another file names: only those in its folder and below, unless others are allowed."""

from __future__ import annotations

from pathlib import Path


def named_file(source: Path, name: str, outside: bool) -> Path | None:
    """Return the path of the file `name`, relative to the folder of `source`; None if there is no such file.

    Raises a ValueError if it is not in this folder or below, links followed, and `outside` is false.
    """
    folder, path = source.parent, source.parent / name.strip().replace("\\", "/")
    try:
        missing = "\0" in name or not path.is_file()
    except OSError:  # a name that is too long
        missing = True
    if missing:
        return None
    if not outside and not path.resolve().is_relative_to(folder.resolve()):
        raise ValueError(
            f"the file {name[-200:]!r} is outside of the folder {folder.resolve()}, which a model must not reach "
            "unless that is allowed (outside=True, --allow-outside)"
        )
    return path
