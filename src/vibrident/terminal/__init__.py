"""What the terminal shows of a result: tables for rich, from values alone. Rich is loaded when one is made."""

from __future__ import annotations

from vibrident.terminal.comparison import compare_table, model_table, truth_table
from vibrident.terminal.inspection import inspection_table
from vibrident.terminal.joint import joint_table
from vibrident.terminal.result import (
    ParameterTable,
    fit_line,
    posterior_table,
    summary,
    warning_lines,
    weights_table,
    written_lines,
)

__all__ = [
    "ParameterTable",
    "compare_table",
    "fit_line",
    "inspection_table",
    "joint_table",
    "model_table",
    "posterior_table",
    "summary",
    "truth_table",
    "warning_lines",
    "weights_table",
    "written_lines",
]
