"""Refusals of the pbrt reader: one message lists all that a file has and dmis does not."""

from time import process_time

import pytest

from dmis.formats.pbrt.read import read_pbrt
from dmis.formats.pbrt.tokens import PbrtError
from tests.formats.pbrt.test_read import TRIANGLE

FILE = f"""Integrator "lightpath"
Camera "realistic" "string lensfile" "a.dat"
WorldBegin
MakeNamedMaterial "fur" "string type" "hair"
Texture "noise" "spectrum" "fbm"
Wobble 3 [1 2] "float a" true
Material "diffuse" "texture reflectance" "noise"
{TRIANGLE}
NamedMaterial "fur"
Shape "curve" "point3 P" [0 0 0]
Shape "curve" "point3 P" [0 0 0]
Material "measured"
{TRIANGLE}{TRIANGLE}
"""


def refusal(tmp_path, text):
    (tmp_path / "a.pbrt").write_text(text)
    with pytest.raises(PbrtError) as caught:
        read_pbrt(tmp_path / "a.pbrt")
    return str(caught.value).replace(f"{tmp_path}/", "").splitlines()


def test_all_refusals_are_listed_once(tmp_path):
    *lines, summary = refusal(tmp_path, FILE)
    begins = [
        'a.pbrt:1: token "lightpath": the integrator must be',
        'a.pbrt:2: token "realistic": the camera must be',
        'a.pbrt:4: token "hair": a material must be',
        'a.pbrt:5: token "fbm": a texture must be',
        "a.pbrt:6: token Wobble: a directive must be one of",
        'a.pbrt:11: token "curve": a shape must be',
        'a.pbrt:13: token "measured": a material must be',
    ]
    assert [line[: len(begin)] for line, begin in zip(lines, begins, strict=True)] == begins
    assert [line.endswith("(and 1 more places)") for line in lines] == [False] * 5 + [True, False]
    assert summary == "8 places of 7 kinds must change before the file can be read"


def test_long_lists_end(tmp_path):
    """A file of hair is refused in seconds: each place is found in no time, and a thousand of them are enough."""
    curve = 'Shape "curve" "point3 P" [0 0 0 1 0 0 2 0 0 3 0 0]\n'
    begin = process_time()
    *_, line, summary = refusal(tmp_path, "WorldBegin\n" + 30_000 * curve)
    assert process_time() - begin < 5
    assert line.startswith('a.pbrt:2: token "curve": a shape must be') and line.endswith("(and 999 more places)")
    assert summary == "at least 1,000 places of 1 kinds must change before the file can be read"


def test_a_broken_line_ends_the_list(tmp_path):
    first, broken, summary = refusal(tmp_path, 'WorldBegin\nShape "curve"\nMaterial [1 2]\n' + FILE)
    assert first.startswith('a.pbrt:2: token "curve"') and broken.startswith("a.pbrt:3: token [1 2]: Material needs")
    assert summary.endswith("before the file can be read; reading stopped at the last one, so more may follow")
    *lines, _ = refusal(tmp_path, 'WorldBegin Material "interface" Material "" WorldEnd')
    assert len(lines) > 1 and all("only bounds a medium is not supported" in line for line in lines)
