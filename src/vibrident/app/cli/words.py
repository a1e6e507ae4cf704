"""Name the settings of messages by the options of the command line."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from vibrident.base.settings import Word, plain, python_word

#: What a keyword says beside its option: the unit, or what identifies the object.
_UNIT = re.compile(r"_(hz|s|rad|bytes|id|number)$")
#: Keyword → its option, where that has another name.
_OPTIONS = {"sampling_rate_hz": "--rate", "parameters": "--parameter"}


def shell_word(root: Any, running: str | None = None) -> Word:
    """Return the words of a command line.

    Args:
        root: the group of all commands.
        running: name of the command that failed; its options come first.
    """

    def word(name: str, value: str) -> str | None:
        if name == "here":
            return "command line"
        if name.startswith("--") or "." not in name:
            return python_word(name, value)
        path = name.split(".")
        if path[0] not in root.commands:  # a variable of the environment
            return path[-1]
        flag = next(_flags(root, [running or path[0], path[0]], path[-1]), None)
        if flag is None:  # a setting of another package's estimator
            return f"--set {path[-1]}" + (f"={plain(value)}" if value else "")
        return f"{flag} {plain(value)}".rstrip()

    return word


def _flags(root: Any, names: list[str], keyword: str) -> Iterator[str]:
    """Yield the options for a keyword, by the name of a command's parameter or by their own."""
    flag_of_keyword = _OPTIONS.get(keyword, f"--{_UNIT.sub('', keyword).replace('_', '-')}")
    for name in names:
        command = root.commands.get(name)
        for subcommand in getattr(command, "commands", {"": command}).values():
            for parameter in getattr(subcommand, "params", ()):
                flags = [*parameter.opts, *parameter.secondary_opts]
                if flag_of_keyword in flags:
                    yield flag_of_keyword
                elif parameter.name == keyword and flags[0].startswith("--"):
                    yield flags[0]
