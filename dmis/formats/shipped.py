"""The scenes that come with the library."""

from __future__ import annotations

from pathlib import Path

_HERE = Path(__file__).resolve().parent.parent
SCENE_FOLDER = _HERE / "_scenes" if (_HERE / "_scenes").is_dir() else _HERE.parent / "scenes"
"""Folder of the scenes that come with the library: of a wheel, or of a checkout."""
SHIPPED = tuple(sorted(path.stem for path in SCENE_FOLDER.glob("*.pbrt")))
"""Names of the scenes that come with the library."""
HELD_OUT = ("interior", "interior-door", "interior-glasses", "ten-lights", "veach-mis")
"""Names of those of them that are held out: no constant of the library is chosen on them, so that they can test it."""
