"""The command line: exit codes, messages and files, as other tools rely on them."""

import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import dmis
from dmis.cli.commands import main
from dmis.fit.registry import RULES
from dmis.formats.shipped import SHIPPED
from dmis.image import read_exr

SCENE = """
LookAt 0 -4 2  0 0 0  0 0 1
Camera "perspective" "float fov" [40]
Film "image" "integer xresolution" [40] "integer yresolution" [30] SurfaceIntegrator "directlighting"
WorldBegin
AttributeBegin
AreaLightSource "area" "color L" [5 5 5]
Material "matte" "color Kd" [0 0 0]
Translate 0 0 3
ReverseOrientation
Shape "disk" "float radius" [1]
AttributeEnd
Material "plastic"
Shape "trianglemesh" "integer indices" [0 1 2 2 3 0] "point P" [-3 -3 0 3 -3 0 3 3 0 -3 3 0]
WorldEnd
"""


@pytest.fixture
def scene(tmp_path):
    """Return the path of a small scene file."""
    path = tmp_path / "scene.pbrt"
    path.write_text(SCENE)
    return str(path)


@pytest.mark.parametrize("workers", ["--threads", "--workers"])
def test_render_writes_layers_stats_and_preview(scene, tmp_path, capsys, workers):
    """``render`` writes every file that its options name, with the promised layers and keys."""
    out, stats, png = (str(tmp_path / name) for name in ("out.exr", "stats.json", "out.png"))
    code = main(
        ["render", scene, "-o", out, "--spp", "8", "--rule", "thesis:patch=4", "--seed", "5", workers, "2"]
        + ["--stats", stats, "--png", png, "--resolution", "20x10"]
    )
    assert code == 0
    layers, attributes = read_exr(out)
    assert layers["RGB"].shape == (10, 20, 3) and {"weight", "variance", "samples"} <= set(layers)
    assert json.loads(attributes["dmis.provenance"])["seed"] == 5
    data = json.loads((tmp_path / "stats.json").read_text())
    covered = dmis.load_scene(scene, resolution=(20, 10)).covered_pixels  # elsewhere no sample is taken
    assert data["samples"] == data["rays"]["camera"] == 8 * covered.sum() < 20 * 10 * 8
    rate = data["samples"] / data["seconds"]
    assert data["samples_per_second"] == pytest.approx(rate)
    assert 0 < data["embree_seconds"] < data["seconds"] and data["peak_rss_bytes"] > 1e6
    assert os.path.getsize(png) > 0
    assert f"{rate / 1e6:.2f} Msamples/s" in capsys.readouterr().out


def test_quiet_and_logs_stay_quiet(scene, tmp_path, capsys):
    """--quiet prints nothing; without a terminal there is no progress bar."""
    command = ["render", scene, "-o", str(tmp_path / "a.exr"), "--spp", "2", "--rule", "balance"]
    assert main([*command, "--quiet"]) == 0 and capsys.readouterr() == ("", "")
    assert main(command) == 0 and capsys.readouterr().err == ""


@pytest.mark.usefixtures("drawn")
def test_verbose_says_more(scene, tmp_path, capsys):
    """--verbose prints plan, stages and rays, or a line for each render of ``compare``; --quiet excludes it."""
    out = str(tmp_path / "a.exr")
    assert main(["render", scene, "-o", out, "--spp", "2", "--rule", "balance", "--verbose"]) == 0
    first, *plan, seconds, rays, weight = capsys.readouterr().out.splitlines()
    plan = [line for line in plan if "noisy speck" not in line]
    assert first.startswith(out) and "40x30 pixels" in plan[0] and len(plan) > 2
    assert "pilot" in seconds and "shadow" in rays and "50%" in weight
    options = ["--rules", "pbrt", "--spp", "2", "--seeds", "2", "--reference-spp", "2", "--resolution", "16x12"]
    assert main(["compare", scene, *options, "-o", str(tmp_path / "c"), "--verbose"]) == 0
    captured = capsys.readouterr()
    assert re.findall(r":\d\d (\[\d/6\] \w+)$", captured.out, re.M) == [
        "[1/6] pinned", "[2/6] balance", "[3/6] pbrt", "[4/6] pinned", "[5/6] balance", "[6/6] pbrt"
    ]  # fmt: skip
    assert captured.err == ""
    with pytest.raises(SystemExit):
        main(["render", scene, "-o", out, "--quiet", "--verbose"])


def test_a_fallback_is_printed(scene, tmp_path, capsys):
    """The rule auto below 16 samples is balance: render, its --stats, compare and its report say so."""
    stats, size = tmp_path / "a.json", ["--resolution", "16x12"]
    command = ["render", scene, "--rule", "auto", "--spp", "8", "-o", f"{tmp_path}/a.exr", "--stats", str(stats)]
    assert main(command) == 0
    assert "\n  auto at 8 spp: fewer than 16 samples per pixel, rendered with w = 1/2\n" in capsys.readouterr().out
    assert json.loads(stats.read_text())["provenance"]["fallback"].startswith("fewer than 16")
    dmis.write_exr(tmp_path / "r.exr", {"RGB": dmis.render(dmis.load_scene(scene, (16, 12)), "balance", 64).image})
    options = ["--rules", "auto,thesis", "--spp", "4,8", "--seeds", "1", "--reference", str(tmp_path / "r.exr"), *size]
    assert main(["compare", scene, *options, "-o", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr()
    assert "auto at 4, 8 spp: fewer than 16 samples per pixel, rendered with w = 1/2." in printed.out
    assert "thesis is skipped at 4 samples per pixel, because its pilot takes 6: use --spp 7 or more" in printed.err
    if (tmp_path / "out" / "report.html").exists():
        assert "auto at 4, 8 spp: fewer than 16" in (tmp_path / "out" / "report.html").read_text("utf-8")


def test_the_library_prints_nothing(capfd, tmp_path):
    """Reading a scene, rendering it and writing the image print nothing, neither in Python nor in its libraries."""
    scene = dmis.load_scene("teapot-area-light", resolution=(24, 24))
    result = dmis.render(scene, "auto", 16, seed=1)
    dmis.write_image(tmp_path / "a.exr", result)
    dmis.read_exr(tmp_path / "a.exr")
    dmis.make_reference(scene, 2, folder=tmp_path)
    assert capfd.readouterr() == ("", "")


def test_info(scene, capsys):
    """``info`` prints versions, the plan of a scene, the rules with their options, or the names of the scenes."""
    assert main(["info"]) == 0 and "embreex" in capsys.readouterr().out
    assert main(["info", scene]) == 0
    text = capsys.readouterr().out
    assert "Lambert + Microfacet" in text and "DiskLight: two techniques" in text
    assert main(["info", "--rules"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[::2]] == list(RULES) and any("patch=" in line for line in lines)
    sentences = {line[19:] for line in lines[::2] if line.split()[0] in RULES.shipped}
    assert len(sentences) == len(RULES.shipped) and all(len(s) > 40 and s.endswith(".") for s in sentences)
    assert main(["info", "--scenes"]) == 0 and capsys.readouterr().out.split() == list(SHIPPED)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("render nothing.pbrt -o a.exr", "nothing.pbrt"),
        ("render teapot -o a.exr", "did you mean 'teapot-area-light'"),
        ("render SCENE -o a.gif", r"must end in \.exr"),
        ("render SCENE -o no/such/folder/a.exr", "directory does not exist; create it first"),
        ("render SCENE -o full.exr", r"may need .* MB, and .* has 0.0 MB left"),
        ("render SCENE -o a.exr --png a.jpg", r"--png must end in \.png; got a\.jpg"),
        ("render SCENE -o a.exr --stats SCENE", "must differ from each other and from the scene"),
        ("render SCENE -o a.exr --checkpoint taken", "is not a checkpoint of this version"),
        ("render SCENE -o a.exr --checkpoint /proc/a", "cannot write (into )?/proc"),
        ("render SCENE -o a.exr --resolution 4", "WIDTHxHEIGHT"),
        ("render SCENE -o a.exr --resolution 6000x6000", "at most 33554432 pixels; got 6000x6000"),
        ("render SCENE -o a.exr --cluster -1", "the address of a Dask scheduler, HOST:PORT"),
        ("render SCENE -o a.exr --workers 2 --threads 2", "not allowed with"),
        ("render SCENE", "-o"),
        ("compare SCENE -o a --seeds 0", "--seeds: must be a whole number from 1 to 10000"),
        ("compare SCENE -o scene.pbrt/out", "scene.pbrt is not a directory"),
        ("compare SCENE -o taken", "report.html: it is a directory"),
        ("play SCENE -o a.png", r"a page must end in \.html; got 'a\.png'"),
        ("play SCENE -o a.html --patch 6", "patch must be a multiple of 4"),
        ("play SCENE -o a.html --spp 6", "must be a multiple of 4, and at least 8"),
        ("", "COMMAND"),
        # packages that are missing
        ("OpenEXR render SCENE -o a.exr", r"pip install OpenEXR, or write \.png"),
        ("OpenEXR compare SCENE -o out", "a comparison, which keeps images as EXR, needs OpenEXR"),
        ("matplotlib figure taken -o a.png", "a figure needs matplotlib"),
        ("matplotlib info a.exr b.exr -o a.png", "a map needs matplotlib"),
        ("jinja2 play SCENE -o a.html", "a page needs jinja2"),
    ],
)
def test_bad_input_is_refused_before_the_first_ray(scene, tmp_path, monkeypatch, refused, arguments, message):
    """Wrong words, files that cannot be written and missing packages give exit code 2, the reason, and no file."""
    (tmp_path / "taken" / "report.html").mkdir(parents=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("dmis.pipeline.executor.Workers.render", lambda *_: pytest.fail("it has begun"))
    words = [scene if word == "SCENE" else word for word in arguments.split()]
    if "full.exr" in words:
        monkeypatch.setattr(shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(1, 1, 0))
    if words and words[0] in ("OpenEXR", "matplotlib", "jinja2"):
        monkeypatch.setitem(sys.modules, words.pop(0), None)
    assert re.search(message, refused(words))
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["report.html", "scene.pbrt", "taken"]


def test_a_closed_pipe_is_no_error():
    """A reader that closes the pipe, as head does, ends the command without a message."""
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "dmis", "info"]
    with os.fdopen(writer, "w") as pipe:
        process = subprocess.run(command, stdout=pipe, stderr=subprocess.PIPE, text=True, timeout=300)
    assert process.returncode == 141 and process.stderr == ""


def test_interrupt_keeps_the_checkpoint(scene, tmp_path):
    """Ctrl-C ends with 130 and prints the command that resumes, which gives the pixels of an undisturbed render."""
    paths = {name: str(tmp_path / name) for name in ("a.exr", "b.exr", "c")}
    options = ["--spp", "128", "--rule", "balance", "--resolution", "192x144", "--quiet", "--threads", "1"]
    some = 3  # files: two of thirty tiles, so that half a second of work is left when the signal comes
    command = ["render", scene, "-o", paths["a.exr"], *options, "--checkpoint", paths["c"]]
    # what runs in the background of a shell begins with Ctrl-C ignored, these tests perhaps among it
    heed = """import runpy, signal
signal.signal(signal.SIGINT, signal.default_int_handler)
runpy.run_module("dmis", run_name="__main__", alter_sys=True)"""
    with subprocess.Popen([sys.executable, "-c", heed, *command], stderr=subprocess.PIPE, text=True) as process:
        while process.poll() is None and not (os.path.exists(paths["c"]) and len(os.listdir(paths["c"])) > some):
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        error = process.communicate(timeout=300)[1]
    assert process.returncode == 130
    assert f"finished tiles are kept in {paths['c']}" in error and "Traceback" not in error
    assert not os.path.exists(paths["a.exr"])
    again = shlex.split(error.splitlines()[-1])
    assert again[:3] == ["python", "-m", "dmis"]
    assert main(again[3:]) == 0 and not os.path.exists(paths["c"])
    assert main(["render", scene, "-o", paths["b.exr"], *options]) == 0
    np.testing.assert_array_equal(*(read_exr(paths[name])[0]["RGB"] for name in ("a.exr", "b.exr")))


@pytest.mark.parametrize("writer", ["dmis.image.write_exr", "dmis.cli.rendering.write_png"])
def test_checkpoint_is_removed_after_the_image_is_written(scene, tmp_path, monkeypatch, writer):
    """If writing fails, the finished tiles are kept, and the same command renders none of them again."""
    names = [str(tmp_path / name) for name in ("a.exr", "a.png", "c")]
    command = ["render", scene, "--spp", "4", "--quiet", "-o", names[0], "--png", names[1], "--checkpoint", names[2]]

    def full(*_):
        raise OSError("No space left on device")

    with monkeypatch.context() as disk:
        disk.setattr(writer, full)
        assert main(command) == 2 and os.path.exists(names[2])
    monkeypatch.setattr("dmis.pipeline.executor.render_tile", lambda *_: pytest.fail("rendered again"))
    assert main(command) == 0
    assert sorted(os.listdir(tmp_path)) == ["a.exr", "a.png", "scene.pbrt"]


@pytest.mark.filterwarnings("default")
def test_comparison_without_matplotlib_says_so_first(scene, tmp_path, monkeypatch, capsys):
    """It warns before the first ray and writes its table; with matplotlib the same command adds plots and report."""
    words = ["--rules", "balance", "--spp", "2", "--seeds", "1", "--reference-spp", "2", "--resolution", "12x8"]
    command = ["compare", scene, *words, "-o", str(tmp_path / "out"), "--quiet"]
    with monkeypatch.context() as without:
        without.setitem(sys.modules, "matplotlib", None)
        assert main(command) == 0 and "report.html are left out, because figures need" in capsys.readouterr().err
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["comparison.json", "images", "results.csv"]
    pytest.importorskip("matplotlib")
    monkeypatch.setattr("dmis.experiment.runs.render_alone", lambda *_, **__: pytest.fail("rendered again"))
    assert main(command) == 0 and (tmp_path / "out" / "report.html").exists()


def test_interrupt_without_a_checkpoint_says_how_to_keep_work(scene, tmp_path, monkeypatch, capsys):
    """Ctrl-C without a checkpoint ends with 130 and prints a command with --checkpoint that runs as it is."""
    out = str(tmp_path / "a b.exr")
    command = ["render", scene, "-o", out, "--spp", "2", "--rule", "balance", "--quiet", "--resolution", "12x8"]
    with monkeypatch.context() as stopped:
        stopped.setattr("dmis.pipeline.executor.Workers.render", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        assert main(command) == 130
    first, again = capsys.readouterr().err.splitlines()
    assert first.startswith("dmis: interrupted; nothing is kept. With --checkpoint finished tiles are kept")
    words = shlex.split(again)
    assert words == ["python", "-m", "dmis", *command, "--checkpoint", str(tmp_path / "a b.checkpoint")]
    assert main(words[3:]) == 0 and os.path.exists(out)


@pytest.mark.filterwarnings("default")
def test_control_characters_are_shown(tmp_path, capsys):
    """Those of file names, tokens, rules and wrong arguments: no message and no table sends them to the terminal."""
    evil = "\x1bc\x07\x9b2J\u202e"
    path = tmp_path / f"{evil}.pbrt"
    path.write_text(SCENE.replace('"float fov"', f'"float {evil}" 1 "float fov"'))
    bad = tmp_path / "bad.pbrt"
    bad.write_text(f"{SCENE}{evil} {evil}")
    out, image = str(tmp_path / evil), str(tmp_path / f"{evil}.exr")
    for arguments, code in (
        (["info", str(path)], 0),
        (["info", str(bad)], 2),
        (["info", f"{evil}.pbrt"], 2),
        (["render", str(path), "-o", image, "--spp", "2", "--verbose", "--rule", "balance"], 0),
        (["render", str(path), "-o", image, "--rule", evil], 2),
        (["check", str(path)], 2),
        (["bench-rules", "--scenes", evil], 2),
    ):
        assert main(arguments) == code
        text = "".join(capsys.readouterr())
        assert r"\x1bc\x07\x9b2J\u202e" in text and text.replace("\n", "").isprintable()
    for arguments in (["render", str(path), "-o", out, evil], ["info", str(path), "--up", evil]):
        with pytest.raises(SystemExit):
            main(arguments)
        text = "".join(capsys.readouterr())
        assert r"\x1b" in text and text.replace("\n", "").isprintable()
