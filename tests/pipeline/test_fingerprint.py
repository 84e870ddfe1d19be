"""Fingerprints: what changes an expected image changes the key, and nothing else does."""

import importlib.util
import os
import re
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import pickled, run_cell

import dmis
from dmis.brdf import lobe, microfacet
from dmis.brdf.lobe import Lambert
from dmis.geometry.shapes import quad
from dmis.pipeline.fingerprint import digest, fingerprint
from dmis.testing.scenes import box_scene

LOBE = """
from dataclasses import dataclass
from typing import Any
from dmis.brdf.lobe import CosineLobe
from dmis.samplers.warp import INV_PI

FACTOR = 1.0
TABLE = {"not": "looked at"}

def shape(x):
    return x * FACTOR

class Base(CosineLobe):
    colours = ("reflectance",)
    power = 1
    def value(self):
        return shape(self.reflectance * INV_PI)

@dataclass(frozen=True, eq=False)
class Mine(Base):
    reflectance: Any
    def eval(self, pair):
        return self.value() * 1.0
    def pdf(self, pair):
        return super().pdf(pair)
"""
VALUES = np.arange(6, dtype=np.float32)
EDITS = [
    ("self.value() * 1.0", "self.value() * 0.9"),
    ("return super().pdf(pair)", "return 1 * super().pdf(pair)"),
    ("self.reflectance * INV_PI", "self.reflectance / 3"),
    ("return x * FACTOR", "return x + FACTOR"),
    ("FACTOR = 1.0", "FACTOR = 0.5"),
    ("power = 1", "power = 2"),
    ("not", "anywhere in the file"),
]


def imported(text: str, folder, name: str = "own_lobe") -> type:
    """The class `Mine` of a file that is imported anew."""
    (folder / f"{name}.py").write_text(text)
    sys.modules.pop(name, None)
    specification = importlib.util.spec_from_file_location(name, folder / f"{name}.py")
    sys.modules[name] = loaded = importlib.util.module_from_spec(specification)
    try:
        exec(compile(text, folder / f"{name}.py", "exec"), vars(loaded))
    finally:
        del sys.modules[name]
    return loaded.Mine


def key(kind: type) -> str:
    """The fingerprint of a scene whose floor has a lobe of the class `kind`."""
    return fingerprint(box_scene(dmis.Material((kind(0.5),))))


@pytest.mark.parametrize("before, after", EDITS)
def test_an_edited_lobe_changes_the_key(tmp_path, before, after):
    """One line of the class, of its base class, of a helper, or of anything else in its file, imported again."""
    assert LOBE.count(before) == 1
    old = imported(LOBE, tmp_path)
    first, new = key(old), imported(LOBE.replace(before, after), tmp_path)
    (tmp_path / "sub").mkdir()
    assert key(new) != first == key(old) == key(imported(LOBE, tmp_path / "sub", "other_name"))
    old.power = 3  # set later: the source does not tell it
    assert key(old) != first


def test_a_class_of_a_notebook_has_the_source_of_its_cell():
    """Its module has no file."""
    cells = [{"__name__": "notebook"} for _ in range(2)]
    for k, names in enumerate(cells):
        run_cell(LOBE.replace("power = 1", f"power = 1 + {k}"), f"<cell {k}>", names)
    first, second = (key(names["Mine"]) for names in cells)
    assert first == key(cells[0]["Mine"]) != second


def test_a_definition_without_source_is_refused():
    """A text that was executed, and a definition inside of a function: the message says where to move it."""
    names: dict[str, Any] = {}
    exec(LOBE, names)

    class Inner(Lambert):
        pass

    for value in (names["Mine"](0.5), Inner(0.5), lambda x: x):
        with pytest.raises(ValueError, match="must be defined by class or def at the top level of a file, or of"):
            digest(value)


class Derived(Lambert):
    """A class of one's own with a shipped base."""


def test_names_of_shipped_classes_differ(box, monkeypatch):
    """They stand for the classes."""
    sources = [path.read_text("utf-8") for path in Path(dmis.__file__).parent.rglob("*.py")]
    names = [name for source in sources for name in re.findall(r"^@dataclass.*\n(?:@.*\n)*class (\w+)", source, re.M)]
    assert len(names) == len(set(names)) > 50
    # Nor does the order of bytes of a machine
    assert digest(VALUES) == digest(VALUES.astype(">f4")) == digest(np.repeat(VALUES, 2)[::2])
    assert digest(VALUES.reshape(2, 3)) == digest(np.asfortranarray(VALUES.reshape(2, 3)))
    # `Lambert` and the lights may live in any module of dmis; what is derived from them goes along
    before, derived = fingerprint(box), digest(Derived(0.5))
    for kind in (lobe.Lambert, microfacet.Microfacet, dmis.QuadLight, dmis.Mesh, dmis.Camera):
        monkeypatch.setattr(kind, "__module__", "dmis.shading.lobes")
    assert fingerprint(box) == before and digest(Derived(0.5)) == derived


def test_key_is_the_same_in_every_process(tmp_path):
    """No address, no hash seed: sets and dictionaries in any order."""
    (tmp_path / "own.py").write_text(LOBE + "\ndef known(v):\n    return v in {'p', 'q', 'r'}\n")
    text = "import own\nfrom dmis.pipeline.fingerprint import digest\n"
    text += "print(digest([own.Mine(0.5), {'a', 'b', 'c', 'd'}, {'x': 1, 'y': own.known}]))"
    path = os.pathsep.join([str(tmp_path), str(Path(dmis.__file__).parents[1])])
    keys = set()
    for seed in "0", "1", "2":
        environment = {**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": path}
        keys.add(subprocess.run([sys.executable, "-c", text], env=environment, capture_output=True, check=True).stdout)
    assert len(keys) == 1 and len(keys.pop().strip()) == 16


def test_key_depends_on_meaning_and_not_on_use(box, monkeypatch, tmp_path):
    """What a render caches in lights, textures and meshes is no part of a scene; pickles have the same key."""
    scene = replace(box, name="box")
    before = fingerprint(scene)
    with monkeypatch.context() as raised:  # by hand, where shipped code changes an image
        raised.setattr("dmis.pipeline.fingerprint.MEANING", 3)
        assert fingerprint(scene) != before
    dmis.render(scene, "balance", 2)
    assert fingerprint(scene) == before == fingerprint(pickled(scene)) == fingerprint(replace(scene, name="other"))
    # the `repr` of a map has its extremes
    rule, other = (dmis.Given(0.5 + np.eye(60, 80, k) / 4) for k in (0, 1))
    assert repr(rule) == repr(other)
    box = replace(box, camera=replace(box.camera, resolution=(80, 60)))
    dmis.render(box, rule, 4, checkpoint=tmp_path / "c")
    with pytest.raises(ValueError, match=": rule_hash is"):
        dmis.render(box, other, 4, checkpoint=tmp_path / "c")


def test_everything_that_is_seen_is_in_the_key(box):
    """Lights, materials, camera, normals, texture coordinates, and which part is which lamp."""
    floor, ball = box.parts
    panel = quad((-1, -1, 3), (0, 2, 0), (2, 0, 0))
    lamps = tuple(dmis.QuadLight((-1, -1, 3), (0, 2, 0), (2, 0, 0), (8, 8, 8)) for _ in range(2))
    mesh = ball.mesh
    uv = np.zeros((len(mesh.vertices), 2))
    scenes = [
        dmis.Scene(box.camera, (floor, dmis.Part(m, ball.material), dmis.Part(panel, dmis.matte(0), light)), lamps)
        for m in (mesh, dmis.Mesh(mesh.vertices, mesh.faces), dmis.Mesh(mesh.vertices, mesh.faces, mesh.normals, uv))
        for light in (None, *lamps)
    ]
    scenes += [
        replace(box, lights=(*box.lights[:1], dmis.PointLight((3, -3, 3), (2, 2, 2.5)))),
        replace(box, parts=(replace(floor, material=dmis.matte(0.6)), ball)),
        replace(box, camera=replace(box.camera, fov=41)),
        box,
    ]
    assert len({fingerprint(scene) for scene in scenes}) == len(scenes) == 13


@pytest.mark.parametrize(
    "one, other",
    [
        (1, True), (1, 1.0), (1, "1"), ("1", b"1"), (None, "None"), (0.1, 0.1 + 2e-16), (0.0, -0.0), ((), ""),
        (((1, 2), 3), (1, (2, 3))), (["ab", "c"], ["a", "bc"]), ({"a": 1, "b": 2}, {"a": 2, "b": 1}), ({1}, (1,)),
        (VALUES, VALUES.reshape(2, 3)), (VALUES, VALUES[:0]), (VALUES, VALUES.astype(float)), (VALUES, VALUES + 1),
        (max, min), (box_scene, imported), (np.sin, np.cos),
        (dmis.PointLight((0, 0, 1), (1, 1, 1)), dmis.PointLight((0, 0, 1), (1, 1, 2))),
    ],
)  # fmt: skip
def test_values_that_differ(one, other):
    """By type, value, nesting, code."""
    assert digest(one) != digest(other) and digest(one) == digest(one)


@dataclass(frozen=True, eq=False)
class Drawn(Lambert):
    """A lobe with a field that has no content."""

    rng: Any


@pytest.mark.parametrize("value", [np.random.default_rng(1), sys, np.array([np.random.default_rng(1)]), iter([1])])
def test_a_field_without_content_is_refused(value):
    """The message has the way there, the type and a way out; a list that contains itself ends, too."""
    endless: list[Any] = []
    endless.append(endless)
    with pytest.raises(ValueError, match="value must not contain itself"):
        digest(endless)
    scene = box_scene(dmis.Material((Drawn(0.5, {"a": [1, value]}),)))
    message = r"\['material'\]\.lobes\[0\]\.rng\['a'\]\[1\].* must be made of numbers.*functools.cached_property"
    with pytest.raises(ValueError, match=message):
        fingerprint(scene)


def test_a_scene_without_fingerprint_is_rendered(tmp_path):
    """Its image has no hash of the scene; a checkpoint, which needs it, is refused before the first ray."""
    scene = box_scene(dmis.Material((Drawn(0.5, np.random.default_rng(1)),)))
    dmis.write_image(tmp_path / "a.exr", result := dmis.render(scene, "balance", 2, parallel=1))
    assert result.provenance["scene_hash"] is None
    with pytest.raises(ValueError, match="must be made of numbers"):
        dmis.render(scene, "balance", 2, checkpoint=tmp_path / "c", progress=pytest.fail, parallel=1)
    assert not (tmp_path / "c").exists()
