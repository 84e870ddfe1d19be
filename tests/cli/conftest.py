"""What the tests of the command line share."""

from collections.abc import Callable, Sequence

import pytest

from dmis.cli.commands import main


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Callable[[Sequence[str]], str]:
    """Run a command that ends with exit code 2 and prints nothing but its message, which is returned in one line."""

    def run(arguments: Sequence[str]) -> str:
        try:
            code = main(arguments)
        except SystemExit as stop:  # of argparse
            code = stop.code  # type: ignore[assignment]
        out, error = capsys.readouterr()
        assert (code, out) == (2, "") and "Traceback" not in error
        return error.replace("\n", " ")

    return run
