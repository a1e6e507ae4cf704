"""The page, started by name, so that the shell does not import it."""

from __future__ import annotations

import importlib
from typing import Any

PAGE = "vibrident.web.server"


def serve(**options: Any) -> None:
    """Serve the page until interrupted; the options are those of ``vibrident.web.server.serve``."""
    importlib.import_module(PAGE).serve(**options)
