"""The command line run in this process."""

from __future__ import annotations

import contextlib
import functools
from pathlib import Path

from typer import testing
from typer.testing import CliRunner, Result

from vibrident.app.cli import app

# The runner would make all commands anew from their functions at each call: 20 ms.
testing._get_command = functools.cache(testing._get_command)


def run(*arguments: object, folder: Path | None = None) -> Result:
    """``vibrident`` with these arguments, in a folder if one is named."""
    with contextlib.chdir(folder) if folder else contextlib.nullcontext():
        return CliRunner().invoke(app, [str(argument) for argument in arguments])


def printed(*arguments: object, folder: Path | None = None) -> str:
    """What it prints; it must succeed."""
    done = run(*arguments, folder=folder)
    assert done.exit_code == 0, done.output
    return done.stdout
