"""What to write in place of a guess: everything that is named exists."""

from __future__ import annotations

import inspect
import re
from dataclasses import fields, replace
from itertools import product
from pathlib import Path

import pytest

import dmis
from dmis.base.synonyms import COMMAND_LINE, KEYWORDS, NAMES
from dmis.cli.arguments import COMMANDS
from dmis.cli.commands import main


def script_exists(advice: str) -> bool:
    """Whether a message names a script of the checkout."""
    path = re.search(r"python (\S+\.py)", advice)
    return path is not None and (Path(__file__).parents[2] / path[1]).is_file()


def names_exist(advice: str) -> bool:
    """Whether a message names functions of dmis; an AttributeError if one does not exist."""
    named = re.findall(r"dmis\.([\w.]+)\(", advice) or re.findall(r"dmis\.([\w.]+)", advice)
    for path in named:
        found = dmis
        for part in path.split("."):
            found = getattr(found, part)
    return bool(named)


@pytest.mark.parametrize("name", NAMES)
def test_names_that_are_written_instead_exist(name: str) -> None:
    with pytest.raises(AttributeError, match=f"has no attribute '{name}': write ") as raised:
        getattr(dmis, name)
    assert names_exist(str(raised.value)) or script_exists(str(raised.value))


def test_objects_say_what_to_write(box: dmis.Scene) -> None:
    """A result and a scene name functions of dmis; an error inside of a property stays as it is."""
    result = replace(dmis.render(box, "balance", 2, parallel=1), describe=lambda: box.nonsense)  # type: ignore[attr-defined]
    for owner, name in product((box, result), ("save", "show", "pixels", "render")):
        with pytest.raises(AttributeError, match=f"has no attribute '{name}': write dmis") as raised:
            getattr(owner, name)
        assert names_exist(str(raised.value))
    with pytest.raises(AttributeError, match=r"'Scene' object has no attribute 'nonsense'$"):
        result.provenance  # noqa: B018
    with pytest.raises(ValueError, match=r"Write reference\.image for a result$"):
        dmis.relmse(result, result)


@pytest.mark.parametrize("word", COMMAND_LINE)
def test_words_that_are_written_instead_exist(word: str, capsys: pytest.CaptureFixture[str]) -> None:
    """A command or option that does not exist ends with one that does."""
    arguments = ["render", "tt", "-o", "x.exr", word, "1"] if word.startswith("-") else [word]
    with pytest.raises(SystemExit):
        main(arguments)
    advice = capsys.readouterr().err.partition(": write ")[2]
    options = {option for command in COMMANDS.values() for names in command.options for option in names.split()}
    options |= {"--plugin"}
    assert advice and word not in COMMANDS and word not in COMMANDS["render"].options
    assert set(re.findall(r"--[\w-]+", advice)) <= options | {"--help"} or script_exists(advice)
    first = advice.split()[0].rstrip(",")
    assert first in COMMANDS or first in options or script_exists(advice) or names_exist(first)


@pytest.mark.parametrize("name", KEYWORDS)
def test_arguments_are_told_apart_from_settings(name: str, box: dmis.Scene) -> None:
    """What is written in place of an argument is one of `render`, of `compare`, or a call."""
    with pytest.raises(ValueError, match=f"got {name}. Write .* for {name}$"):
        dmis.render(box, "balance", 4, **{name: 3})
    arguments = {*inspect.signature(dmis.render).parameters, *inspect.signature(dmis.compare).parameters}
    arguments |= {field.name for field in fields(dmis.Settings)}
    named = re.findall(r"(?:^|, )(\w+)=", KEYWORDS[name])
    assert set(named) <= arguments or "(" in KEYWORDS[name]


def test_other_words_get_a_suggestion_or_none(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, message in (
        (["rendr"], "there is no command rendr, did you mean 'render'?"),
        (["compare", "tt", "-o", "x", "--seed-count=4"], "compare has no --seed-count"),
        (["render", "tt", "-o", "x.exr", "--shading_samples", "4"], "did you mean '--shading-samples'?"),
    ):
        with pytest.raises(SystemExit):
            main(arguments)
        assert message in capsys.readouterr().err
    for name, end in (("nonsense", ""), ("load_exr", ", did you mean 'read_exr'?"), ("rmse", ", did you mean 'mse'?")):
        with pytest.raises(AttributeError, match=rf"no attribute '{name}'{re.escape(end)}$"):
            getattr(dmis, name)
