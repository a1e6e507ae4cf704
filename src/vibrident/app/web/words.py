"""The page's words for the settings that messages name: the labels of its fields."""

from __future__ import annotations

from collections.abc import Mapping

from vibrident.app.web.tasks import TASKS
from vibrident.base import memory
from vibrident.base.settings import Word, plain
from vibrident.export.form import OPTIONS

#: Setting → label of its field.
LABELS: Mapping[str, str] = {
    "identify.model": "Model",
    "identify.estimator": "Estimator",
    "identify.discretisation": "Discretisation",
    "identify.uncertainty": "Uncertainties cover",
    "export.form": "Export as",
    "export.certificate": "What the certificate states",
    "report.form": "Download",
    **{f"export.{name}": option.label for name, option in OPTIONS.items() if option.label},
}
_COMMANDS = {
    "identify": "“Identify”",
    "inspect": "“Draw these columns”",
    "serve": "the server",
    "export": "“Export”",
    **{name: f"“{task.title}”" for name, task in TASKS.items()},
}
_ELSEWHERE = "(in Python or on the command line)"


def page_word(labels: Mapping[str, str] = LABELS) -> Word:
    """Return the words of a form with these labels, by setting or by option."""

    def word(name: str, value: str) -> str | None:
        if name == "here":
            return "the form"
        if name == "install":
            return f"ask whoever runs the server to install {value}"
        if name == "command":
            return _COMMANDS.get(value, f"`vibrident {value}` (on the command line)")
        if name == f"environment.{memory.VARIABLE}":
            return "the memory that the server may take for a file"
        if not name.startswith("--") and "." not in name:
            return None
        argument = "" if value.isupper() else plain(value)
        setting = name.removeprefix("--").rpartition(".")[2].replace("_", " ").replace("-", " ")
        said = f"“{labels.get(name, setting)}” {argument}".rstrip()
        return said if name in labels else f"{said} {_ELSEWHERE}"

    return word
