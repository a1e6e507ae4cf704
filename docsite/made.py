"""Which pages are made, and by what; the gallery has pictures and is written by its own module."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from docsite.api import api
from docsite.calibration_file import calibration_file
from docsite.commands import commands
from docsite.first_steps import first_steps
from docsite.models import models

MADE: Mapping[str, Callable[[], str]] = {
    "index.md": first_steps,
    "models.md": models,
    "calibration-file.md": calibration_file,
    "commands.md": commands,
    "api.md": api,
}
#: Everything that is not in git; the gallery's page among it.
MADE_PAGES = (*MADE, "gallery/index.md")
