"""Name the settings of messages by the labels of the page's fields."""

from __future__ import annotations

from collections.abc import Callable

from vibrident.app.web.language import phrase, translate
from vibrident.app.web.tasks import TASKS
from vibrident.base import memory
from vibrident.base.fields import NamedTexts
from vibrident.base.settings import Word, plain
from vibrident.export.form import OPTIONS

#: Setting → label of its field.
LABELS: NamedTexts = {
    "identify.model": phrase("Model"),
    "identify.estimator": phrase("Estimator"),
    "identify.discretisation": phrase("Discretisation"),
    "identify.uncertainty": phrase("Uncertainties cover"),
    "export.form": phrase("Export as"),
    "export.certificate": phrase("What the certificate states"),
    "report.form": phrase("Download"),
    **{
        f"{name}.{key}": field.label
        for name in ("correct", "track", "plan")
        for key, field in TASKS[name].fields.items()
        if key not in {"low_hz", "high_hz"}
    },
    **{f"export.{name}": option.label for name, option in OPTIONS.items() if option.label},
}
_COMMANDS = {
    "identify": phrase("Identify"),
    "inspect": phrase("Draw these columns"),
    "export": phrase("Export"),
    **{name: task.title for name, task in TASKS.items()},
}
_ELSEWHERE = "(in Python or on the command line)"


def page_word(labels: NamedTexts = LABELS, speak: Callable[[str], str] = translate) -> Word:
    """Return the words of a form with these labels, by setting or by option.

    ``speak``: says a label in the language of the form; by default that of the page being served.
    """

    def word(name: str, value: str) -> str | None:
        if name == "here":
            return "the form"
        if name == "install":
            return f"ask whoever runs the server to install {value}"
        if name == "command":
            if value == "serve":
                return "the server"
            button = _COMMANDS.get(value)
            return f"“{speak(button)}”" if button else f"`vibrident {value}` (on the command line)"
        if name == f"environment.{memory.VARIABLE}":
            return "the memory that the server may take for a file"
        if not name.startswith("--") and "." not in name:
            return None
        argument = "" if value.isupper() else plain(value)
        setting = name.removeprefix("--").rpartition(".")[2].replace("_", " ").replace("-", " ")
        words = f"“{speak(labels.get(name, setting))}” {argument}".rstrip()
        return words if name in labels else f"{words} {_ELSEWHERE}"

    return word
