"""``python -m dmis``: runs one of the commands that `dmis.cli.arguments` lists.

Bad input ends with exit code 2 and one message. An interrupted command ends with 130, and its message has the command
that resumes it.
"""

from __future__ import annotations

import argparse
import os
import shlex
import sys
import warnings
from collections.abc import Sequence
from dataclasses import fields
from importlib import import_module
from pathlib import Path

from dmis.base.plugins import load_plugin
from dmis.cli.arguments import COMMANDS, make_parser
from dmis.cli.shared import say
from dmis.estimator.settings import Settings, make_settings


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    options = make_parser().parse_args(arguments)
    try:
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_, **__: say(f"dmis: warning: {message}", error=True)  # type: ignore[assignment]
            for file in options.plugin:
                load_plugin(file)
            names = [field.name for field in fields(Settings)]
            options.given = {name: value for name, value in vars(options).items() if name in names}
            options.settings = make_settings(**options.given)
            module = import_module(f"dmis.cli.{COMMANDS[options.command].module}")  # another's need not be imported
            code: int = getattr(module, options.command.replace("-", "_"))(options)
            sys.stdout.flush()
            return code
    except BrokenPipeError:  # nothing reads standard output any more, as behind ``| head``
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python flushes what is left at exit
        return 141  # as the shell has it for a command that SIGPIPE ends
    except (ValueError, OSError, MemoryError, ImportError) as error:
        reason = f"there is not enough memory: {error}" if isinstance(error, MemoryError) else error
        say(f"dmis: error: {reason}", error=True)
        return 2
    except KeyboardInterrupt:
        say(f"dmis: interrupted{_how_to_resume(options, arguments)}", error=True)
        return 130


def _how_to_resume(options: argparse.Namespace, arguments: Sequence[str] | None) -> str:
    """Return what an interrupted command has saved, and the command that resumes it."""
    if options.command in ("compare", "play"):
        from dmis.experiment.reference import cache_folder

        kept = f"finished renders are kept in {options.output}, " if options.command == "compare" else ""
        return f"; {kept}finished tiles of references and oracles in {cache_folder()}. Run the same command to resume."
    if options.command != "render":
        return ""
    command = shlex.join(["python", "-m", "dmis", *(sys.argv[1:] if arguments is None else arguments)])
    if options.checkpoint is not None:
        return f"; finished tiles are kept in {options.checkpoint}. Run the same command to resume.\n  {command}"
    folder = shlex.quote(str(Path(options.output).with_suffix(".checkpoint")))
    return f"; nothing is kept. With --checkpoint finished tiles are kept:\n  {command} --checkpoint {folder}"


if __name__ == "__main__":
    sys.exit(main())
