"""Which pages are made, and by what; pages with pictures are written by modules of their own."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from docsite.api import api
from docsite.calibration_file import calibration_file
from docsite.commands import commands
from docsite.excitations import excitations
from docsite.executed import PROGRAMS
from docsite.first_steps import first_steps
from docsite.models import models
from docsite.studies import STUDIES
from docsite.walkthrough import PAGES
from vibrident.base.warning_kinds import WARNINGS

PAGE_MAKERS: Mapping[str, Callable[[], str]] = {
    "index.md": first_steps,
    "models.md": models,
    "excitation.md": excitations,
    "calibration-file.md": calibration_file,
    "commands.md": commands,
    "api.md": api,
}
#: Every page that is not in git; pages with pictures among them.
MADE_PAGES = (
    *PAGE_MAKERS,
    *PAGES,
    "gallery/index.md",
    *(f"notebooks/{program.stem}.md" for program in sorted(PROGRAMS.glob("*.py"))),
    *(f"warnings/{code}.md" for code in WARNINGS),
    *(f"studies/{study.name}" for study in sorted(STUDIES.glob("*.md"))),
)
