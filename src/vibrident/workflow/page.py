"""The page, started by a shell that does not know it: it is loaded by its name, as a program is."""

from __future__ import annotations

import importlib
from typing import Any

PAGE = "vibrident.web.server"


def serve(**options: Any) -> None:
    """Serve the page until interrupted; the options are those of ``vibrident.web.server.serve``."""
    importlib.import_module(PAGE).serve(**options)
