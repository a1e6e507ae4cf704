"""Reports of a result, rendered from its values alone: no data, no JAX; matplotlib only when pictures are drawn."""

from __future__ import annotations

import os
from pathlib import Path

from vibrident import plots
from vibrident.report.markdown import render
from vibrident.result import Result

__all__ = ["render", "write_report"]


def write_report(result: Result, folder: str | os.PathLike[str]) -> Path:
    """Write ``report.md`` and its pictures (png) into a folder, which is made if missing.

    Returns:
        path of ``report.md``.
    """
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    plots.save_all(result, target)
    report = target / "report.md"
    report.write_text(render(result, pictures=target), encoding="utf-8")
    return report
