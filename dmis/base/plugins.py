"""Plugins: Python files of a user's own, imported before a command runs.

A plugin registers what it defines (rules, techniques, samplers) in the tables of dmis. It is a module of its file's
name, so worker processes can import it, and it may import other files of its folder.
"""

from __future__ import annotations

import importlib
import os
import sys
import sysconfig
import traceback
from pathlib import Path
from typing import Any

_LOADED: list[Path] = []
"""Files of the plugins that were loaded."""


def loaded_plugins() -> tuple[Path, ...]:
    """Return the files of all plugins that were loaded, in this order: worker processes load them, too."""
    return tuple(_LOADED)


def load_plugin(file: str | os.PathLike[str]) -> None:
    """Import a Python file as a module of its name; a file that was loaded before is not loaded again.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If its name is that of another module, or it raises an exception; the message has the file and the line.
    """
    path = Path(file).resolve()
    if path in _LOADED:
        return
    if not path.is_file():
        raise FileNotFoundError(f"no such plugin: {file}; a plugin must be a Python file")
    name, folder = path.stem, str(path.parent)
    if path.suffix != ".py" or "." in name:
        raise ValueError(f"a plugin must be a Python file with a name such as my_rule.py; got {file}")
    sys.path.append(folder)  # for other files of the folder, too
    importlib.invalidate_caches()
    try:
        module = importlib.import_module(name)
    except (Exception, SystemExit) as error:
        sys.path.remove(folder)
        raise ValueError(f"plugin {file}: {raised(error)}") from error
    if getattr(module, "__file__", None) != str(path):
        sys.path.remove(folder)
        raise ValueError(f"plugin {file} must have another name, because {name} is a Python module already: {module}")
    _LOADED.append(path)


def origin(value: Any) -> str:
    """Return the module and the name of a class or function, which stay when a notebook cell defines it anew."""
    return f"{value.__module__}.{getattr(value, '__qualname__', repr(value))}"


def raised(error: BaseException) -> str:
    """Return the message of an exception with the function, file and line of the user's code that raised it."""
    libraries = (sysconfig.get_path(key) for key in ("stdlib", "purelib", "platlib"))
    others = Path(__file__).parents[1], *map(Path, libraries)
    own = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if not frame.filename.startswith("<")  # generated, such as a dataclass's __init__
        and not any(Path(frame.filename).is_relative_to(folder) for folder in others)
    ]
    if not own:
        return str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
    frame = own[-1]
    return f"{frame.name} raised {type(error).__name__}: {error} ({Path(frame.filename).name}, line {frame.lineno})"
