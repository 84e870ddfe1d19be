"""Plugins: Python files of a user's own, imported before a command runs.

A plugin registers what it defines (rules, techniques, samplers) in the tables of dmis. It is a module of its file's
name, so worker processes can import it, and it may import other files of its folder.
"""

from __future__ import annotations

import importlib.util
import os
import sys
import traceback
from pathlib import Path

_LOADED: dict[Path, str] = {}
"""Module names of the plugins that were loaded, by their files."""


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
        If its name is not that of a new module, it is not Python, or it raises an exception; the message has the file
        and the line.
    """
    path = Path(file).resolve()
    if path in _LOADED:
        return
    if not path.is_file():
        raise FileNotFoundError(f"no such plugin: {file}; a plugin must be a Python file")
    name = path.stem
    if path.suffix != ".py" or "." in name:
        raise ValueError(
            f"a plugin must be a Python file with a name such as my_rule.py; got {file}. Copy it to a name that ends "
            f"in .py and has no other point"
        )
    if (origin := _origin(name)) not in (None, path):
        raise ValueError(f"plugin {file} must have another name, because {name} is a Python module already: {origin}")
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    sys.path.append(str(path.parent))  # for other files of the folder
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        sys.path.remove(str(path.parent))
        raise ValueError(_located(error, path, file)) from error
    _LOADED[path] = name


def _origin(name: str) -> Path | None:
    """Return the file of the module that `import` would load, or its name if it has no file; None if there is none."""
    module = sys.modules.get(name)
    spec = getattr(module, "__spec__", None) if module else importlib.util.find_spec(name)
    if module is None and spec is None:
        return None
    return Path((spec and spec.origin) or name)


def _located(error: BaseException, path: Path, file: str | os.PathLike[str]) -> str:
    """Return a message with the line of a plugin at which an exception was raised."""
    if isinstance(error, SyntaxError) and error.filename in (None, str(path)):
        return f"plugin {file}, line {error.lineno or 1}, is not Python: {error.msg}"
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
    place = f", line {lines[-1]}" if lines else ""
    return f"plugin {file}{place}: {type(error).__name__}: {error}"
