"""Every command of the command line with its arguments and options, from the application itself."""

from __future__ import annotations

import re
from typing import Any

import click
import typer.main
from rich.text import Text

from docsite.tables import table
from vibrident.app.cli.application import app

_HEADS = {"argument": ("argument", "meaning"), "option": ("option", "meaning")}


def commands() -> str:
    """Return the page: the application's own help, then a section a command."""
    group: Any = typer.main.get_command(app)
    context = click.Context(group, info_name="vibrident")
    parts = ["# Commands", _prose(group.help), "Every command has `--help`."]
    for name in group.list_commands(context):
        parts += _command(group.get_command(context, name), name, context, "##")
    return "\n\n".join(parts) + "\n"


def _command(command: Any, name: str, context: Any, mark: str) -> list[str]:
    """A section of a command; of a group, then one of each of its commands."""
    inner = click.Context(command, parent=context, info_name=name)
    parts = [
        f"{mark} {name}",
        f"    {inner.command_path} {' '.join(command.collect_usage_pieces(inner))}",
    ]
    parts.append(_prose(command.help))
    for kind, heads in _HEADS.items():
        rows = [
            _row(parameter, inner)
            for parameter in command.get_params(inner)
            if _shown(parameter, kind)
        ]
        if rows:
            parts.append(table(heads, rows))
    for subcommand in getattr(command, "commands", {}):
        parts += _command(command.commands[subcommand], subcommand, inner, f"{mark}#")
    return parts


def _shown(parameter: Any, kind: str) -> bool:
    return parameter.param_type_name == kind and not getattr(parameter, "hidden", False)


def _row(parameter: Any, context: Any) -> tuple[str, str]:
    names, meaning = parameter.get_help_record(context)
    return f"`{names}`", _escaped(_plain(meaning))


def _prose(text: str | None) -> str:
    """Help with its paragraphs; lines that the source indents stay as they are."""
    return _escaped(_plain((text or "").replace("\f", "").strip()))


def _plain(text: str) -> str:
    """Without the terminal's markup; what only looks like it, such as [default: 2], stays."""
    return Text.from_markup(re.sub(r"\[(?=default|required|x)", r"\\[", text)).plain


def _escaped(text: str) -> str:
    return re.sub(r"([<*_])", r"\\\1", text)
