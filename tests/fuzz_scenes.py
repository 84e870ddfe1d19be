"""Words of scene files, in orders that belong to the format or do not; see `fuzz`."""

from __future__ import annotations

import random
import re
from pathlib import Path

from dmis.formats.pbrt import directives
from dmis.formats.pbrt.dialect import DIALECTS

SCENES = Path(__file__).parent.parent / "scenes"
TOKEN = re.compile(r'\[[^\]"]*\]|"[^"\n]*"|[^\s"\[\]#]+|\[|\]|#[^\n]*')

V3 = """Integrator "directlighting" Film "image" Camera "perspective" "float fov" [40] WorldBegin AttributeBegin
AreaLightSource "diffuse" "rgb L" [1 2 3] Shape "disk" "float radius" 2 AttributeEnd MakeNamedMaterial "a"
"string type" "matte" "rgb Kd" [.1 .2 .3] NamedMaterial "a" Texture "t" "spectrum" "imagemap" "string filename" "a.exr"
Material "matte" "texture Kd" "t" Shape "plymesh" "string filename" "a.ply" LightSource "infinite" "string mapname"
"a.exr" Shape "loopsubdiv" "integer levels" 1 "integer indices" [0 2 1 0 1 3 0 3 2 1 2 3] "point3 P"
[0 0 0 1 0 0 0 1 0 0 0 1] MediumInterface "" "" ObjectBegin "o" Shape "sphere" ObjectEnd ObjectInstance "o" WorldEnd"""
V4 = """Film "rgb" "float iso" 100 PixelFilter "box" Integrator "volpath" "integer maxdepth" 1
ColorSpace "srgb" WorldBegin LightSource "distant" "blackbody L" 3000 AttributeBegin
AreaLightSource "diffuse" "spectrum L" [400 1 500 2] Shape "sphere" "float radius" 2
AttributeEnd Material "mix" "string materials" ["b" "b"]
MakeNamedMaterial "b" "string type" "diffuse" "spectrum reflectance" "a.spd" Include "empty.pbrt" Shape "trianglemesh"
"point3 P" [0 0 0 1 0 0 0 1 0] "normal N" [0 0 1 0 0 1 0 0 1] "point2 uv" [0 0 0 1 1 1]"""
TEXTS = [TOKEN.findall(path.read_text()) for path in sorted(SCENES.glob("*.pbrt"))]
TEXTS += [TOKEN.findall(V3), TOKEN.findall(V4)]
"""Scenes as tokens: those that come with the library, and two with what they lack."""

NUMBERS = "0 1 -1 3 1e9 1000000000 65536 1e38 1e308 1e-320 -0 2147483647 2147483648 .5 nan inf".split()
NASTY = [
    "[", "]", '"', '""', '"a\0b"', "\ufffd", "[1 2", "[]", '"../../../etc/passwd"', '"/"', '"."', "#", "\0", "²", "",
]  # fmt: skip
PARAMETERS = """"float radius" 2,"point P" [0 0 0 1 0 0 0 1 0],"integer indices" [0 1 2],"rgb L" [1 2 3],
"rgb Kd" [.5 .5 .5],"float scale" 3,"string filename" "a.ply","string filename" "a.exr",
"texture Kd" "t","integer levels" 2,"rgb I" [1 1 1],
"normal N" [0 0 1 0 0 1 0 0 1],"integer nlevels" 20,"float power" 3,"rgb Ks" [0 0 0],"float zmin" 0,
"spectrum L" "a.spd","string type" "matte","rgb reflectance" [.1 .1 .1],"string mapname" "a.exr",
"texture alpha" "t","float alpha" .5,"texture bumpmap" "t","texture displacement" "t","string normalmap" "a.exr",
"texture amount" "t","float uscale" 3,"bool twosided" "true","string materials" ["a" "b"],"spectrum eta" "glass-BK7",
"bool twosided" "false\"""".replace("\n", "").split(",")
MAKERS = {
    "Shape": "sphere disk cylinder trianglemesh plymesh loopsubdiv",
    "Material": "matte plastic metal mirror glass uber mix diffuse conductor dielectric coateddiffuse "
    "coatedconductor translucent diffusetransmission",
    "LightSource": "point spot distant infinite",
    "AreaLightSource": "diffuse area",
    'Texture "t" "spectrum"': "constant scale imagemap mix checkerboard",
    'Texture "t" "float"': "constant scale imagemap mix checkerboard",
    "MakeNamedMaterial": "a b",
    "NamedMaterial": "a b",
    "ObjectBegin": "o",
    "ObjectInstance": "o",
}
MADE = [f'{line} "{kind}"' for line, kinds in MAKERS.items() for kind in kinds.split()]
WORDS = sorted(
    {token for text in TEXTS for token in text if len(token) < 40}
    | set(directives._DIRECTIVES)
    | {f'"{kind} {name}"' for kind in DIALECTS["v3"].types for name in ("L", "Kd", "P", "radius", "indices", "scale")}
    | {*MADE, *PARAMETERS}
)
"""Tokens, directives with a kind, and parameters that belong to the format."""
SMALL = (
    'SurfaceIntegrator "directlighting" Camera "perspective" Film "image" "integer xresolution" 6 '
    '"integer yresolution" 4 WorldBegin LightSource "point"'
)
TRIANGLE = '"trianglemesh" "integer indices" [0 1 2] "point P" [-9 -9 2  9 -9 2  0 9 2]'


def mutated(rng: random.Random, tokens: list[str]) -> str:
    """Tokens dropped, doubled, swapped, put in, replaced, cut off."""
    tokens = list(tokens)
    for _ in range(rng.randint(1, 6)):
        what = rng.choice(["drop", "double", "swap", "put", "replace", "replace", "replace", "cut"])
        k = rng.randrange(max(len(tokens), 1))
        if what == "drop":
            del tokens[k : k + 1]
        elif what == "double":
            tokens[k:k] = tokens[k : k + 3]
        elif what == "swap" and tokens:
            other = rng.randrange(len(tokens))
            tokens[k], tokens[other] = tokens[other], tokens[k]
        elif what == "put":
            tokens.insert(k, token(rng))
        elif what == "replace":
            tokens[k : k + 1] = [token(rng)]
        elif what == "cut" and rng.random() < 0.3:
            del tokens[k:]
    return "\n".join(tokens)


def token(rng: random.Random) -> str:
    """A word that belongs to the format, a number, a list, or none of these."""
    kind = rng.randrange(5)
    if kind == 4:
        return "".join(chr(rng.choice([rng.randrange(128), rng.randrange(0x3000)])) for _ in range(rng.randint(0, 6)))
    return numbers(rng) if kind == 3 else rng.choice((WORDS, NUMBERS, NASTY)[kind])


def numbers(rng: random.Random) -> str:
    """A list of numbers."""
    some = NUMBERS if rng.random() < 0.5 else ["0", "1", "2", "-1", "3"]
    return f"[{' '.join(rng.choice(some) for _ in range(rng.choice([0, 1, 3, 6, 9, 12, rng.randint(0, 20)])))}]"
