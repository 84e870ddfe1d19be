"""What scripts of ``examples/`` share with their notebooks, ``dmis.examples.gallery`` among it: modules in
``examples/shared`` of a checkout and in ``dmis/_examples`` of a wheel, as the scenes are in ``scenes`` and ``_scenes``.
"""

from pathlib import Path

_HERE = Path(__file__).resolve().parent
__path__ = [str(folder) for folder in (_HERE / "_examples", _HERE.parent / "examples" / "shared") if folder.is_dir()]
