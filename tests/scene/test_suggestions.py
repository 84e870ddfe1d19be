"""What scene files ask for: kept as suggestions, followed on request, and no part of a scene's fingerprint."""

import os
import re
import warnings
from dataclasses import replace
from pathlib import Path

import pytest
from helpers import shipped

import dmis
from dmis.__main__ import main
from dmis.formats.pbrt.notes import PbrtWarning
from dmis.image import read_exr
from dmis.pipeline.fingerprint import fingerprint
from dmis.scene.scene import SceneWarning

TRIANGLE = 'Shape "trianglemesh" "point P" [0 0 0 1 0 0 0 1 0] "integer indices" [0 1 2]\n'
V2 = 'SurfaceIntegrator "directlighting"\n'


@pytest.fixture
def read(tmp_path: Path):
    """A scene of options and lights; no warning but those that a test expects."""

    def scene(options: str, lights: str = "", dialect: str | None = "v2") -> dmis.Scene:
        path = tmp_path / "scene.pbrt"
        path.write_text(f"{options}\nWorldBegin\n{lights}\n{TRIANGLE}WorldEnd\n", "utf-8")
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return dmis.load_scene(path, dialect=dialect)

    return scene


@pytest.mark.parametrize(
    ("name", "spp", "samples"),
    [("teapot-area-light", 8, 16), ("killeroo-gold", 64, 4), ("killeroo-diffuse", 64, 4), ("tt", 32, 8)]
    + [("tt-overcast", 32, 8)],
)
def test_shipped_scenes(name: str, spp: int, samples: int) -> None:
    """They ask for what the public pbrt-v2 files of the thesis's scenes ask for (diffuse: gold's)."""
    scene = shipped(name)
    assert scene.suggested == dmis.Suggestions("direct", 5, "lowdiscrepancy", spp, "all", (samples,))
    settings = dmis.Settings.as_in_file(scene)
    assert (settings.sampler, settings.shading_samples, settings.lights) == ("lowdiscrepancy", 2 * samples, "all")


@pytest.mark.skipif("DMIS_PBRT_SCENES" not in os.environ, reason="needs the original pbrt-v2 scenes")
@pytest.mark.parametrize("name", ["teapot-area-light", "killeroo-gold", "tt"])
def test_original_scenes_ask_for_the_same(name: str) -> None:
    """The numbers in the original files, which need not be read as a whole: some lack a map, or name a renderer."""
    text = (Path(os.environ["DMIS_PBRT_SCENES"]) / "original" / f"{name}.pbrt").read_text("latin-1")
    lines = "\n".join(line.partition("#")[0] for line in text.splitlines())
    suggested = shipped(name).suggested
    assert re.findall(r'Sampler +"(\w+)" +"integer pixelsamples" *\[(\d+)', lines) == [
        (suggested.sampler, str(suggested.spp))
    ]
    assert re.findall(r'"integer nsamples" *\[ *(\d+)', lines) == [str(suggested.light_samples[0])]


LAMPS = """AttributeBegin AreaLightSource "area" "integer nsamples" 3 Translate 0 0 2 Shape "disk" AttributeEnd
LightSource "point" "integer nsamples" 64
LightSource "infinite" "integer nsamples" 6"""


@pytest.mark.parametrize(
    ("options", "sampler", "spp", "samples"),
    [
        (f'{V2}Sampler "lowdiscrepancy" "integer pixelsamples" 9', "lowdiscrepancy", 16, (4, 8)),
        (f'{V2}Sampler "lowdiscrepancy"', "lowdiscrepancy", 4, (4, 8)),
        (f'{V2}Sampler "random" "integer pixelsamples" 9', "independent", 9, (3, 6)),
        (f'{V2}Sampler "stratified" "integer xsamples" 3 "integer ysamples" 5', "stratified", 15, (3, 6)),
        (V2, None, None, (4, 8)),  # pbrt-v2 takes lowdiscrepancy
    ],
)
def test_rounding(read, options: str, sampler: str | None, spp: int | None, samples: tuple[int, ...]) -> None:
    """The file's sampler rounds; delta lights have no light samples to share."""
    scene = read(options, LAMPS)
    assert (scene.suggested.sampler, scene.suggested.spp) == (sampler, spp)
    assert scene.suggested.light_samples == samples
    settings = dmis.Settings.as_in_file(scene)
    assert settings.shading_samples == 2 * max(samples)
    assert settings.sampler == (sampler or "auto")
    assert (
        f"light samples {samples[0]}, {samples[1]} (shading_samples {2 * samples[1]} of direct, the" in scene.describe()
    )


def test_one_light_and_paths(read) -> None:
    """Strategy one, and paths, which sample one light once whatever `nsamples` says."""
    one = read('SurfaceIntegrator "directlighting" "string strategy" "one"', LAMPS)
    assert dmis.Settings.as_in_file(one).lights == "one"
    path = read('SurfaceIntegrator "path" "integer maxdepth" 3', LAMPS)
    for settings in (dmis.Settings.as_in_file(path), dmis.Settings.as_in_file(one, integrator="path")):
        assert (settings.lights, settings.shading_samples) == ("one", 2)
    assert dmis.Settings.as_in_file(path, integrator="direct").shading_samples == 16
    assert dmis.Settings.as_in_file(path, sampler="sobol", shading_samples=3).shading_samples == 3
    # pbrt-v3 has `samples` besides, and rounds with 02sequence
    lamp = 'LightSource "infinite" "integer samples" 5'
    scene = read('Sampler "02sequence" "integer pixelsamples" 100\nIntegrator "directlighting"', lamp, "v3")
    assert scene.suggested == dmis.Suggestions("direct", 5, "lowdiscrepancy", 128, "all", (8,))


def test_what_is_not_there(read, tmp_path: Path) -> None:
    """A sampler that dmis does not have is named by `describe` and in a warning; so are too many samples."""
    scene = read(f'{V2}Sampler "adaptive" "integer maxsamples" 9', 'LightSource "infinite" "integer nsamples" 64')
    assert "not available: sampler adaptive" in scene.describe() and scene.suggested.spp == 16
    with pytest.warns(SceneWarning, match=r"does not have: sampler adaptive, 128 shading samples \(at most 100\)"):
        settings = dmis.Settings.as_in_file(scene)
    assert (settings.sampler, settings.shading_samples) == ("auto", 100)
    # a number of samples of another type is no error, because it changes no image, but it is named
    with pytest.raises(PbrtWarning, match=r"'pixelsamples' of Sampler .* 'nsamples' of LightSource"):
        read(f'{V2}Sampler "random" "float pixelsamples" 9', 'LightSource "infinite" "integer nsamples" [-3]')


def test_fingerprint_ignores_samples() -> None:
    """References are shared by scenes that differ in numbers of samples, and not by those of other depths."""
    scene = dmis.load_scene("cornell", resolution=(8, 8))
    other = replace(scene.suggested, sampler="stratified", spp=3, lights="one", light_samples=(7,), unmet=("x",))
    assert fingerprint(replace(scene, suggested=other)) == fingerprint(scene)
    assert fingerprint(replace(scene, suggested=replace(scene.suggested, max_depth=2))) != fingerprint(scene)


@pytest.mark.usefixtures("drawn")
def test_command_line(tmp_path: Path, capsys) -> None:
    """`render --as-in-file` is a render with the file's settings, and options replace them; `compare` has it too."""
    small = ["teapot-area-light", "--resolution", "16x12", "--rule", "balance", "--as-in-file"]
    out = tmp_path / "a.exr"
    assert main(["render", *small, "-o", str(out)]) == 0
    assert "balance, 8 spp, sampler lowdiscrepancy, 32 shading samples, " in capsys.readouterr().out
    scene = dmis.load_scene("teapot-area-light", resolution=(16, 12))
    expected = dmis.render(scene, "balance", 8, settings=dmis.Settings.as_in_file(scene))
    assert (read_exr(out)[0]["RGB"] == expected.image).all()
    assert main(["render", *small, "--spp", "4", "--shading-samples", "2", "-o", str(out)]) == 0
    assert "balance, 4 spp, sampler lowdiscrepancy, 2 shading samples, " in capsys.readouterr().out
    words = [*small[:3], "--rules", "balance", "--seeds", "1", "--reference-spp", "2", "--as-in-file"]
    assert main(["compare", *words, "-o", str(tmp_path / "b")]) == 0
    assert "teapot-area-light,balance,8,0," in (tmp_path / "b" / "results.csv").read_text("utf-8")
    assert main(["info", "teapot-area-light"]) == 0
    text = "that the file asks for (--as-in-file): sampler lowdiscrepancy, 8 spp, lights all, light samples 16 ("
    assert text in capsys.readouterr().out
