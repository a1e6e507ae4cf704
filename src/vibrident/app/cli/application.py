"""Register the commands in the order of the help, and handle their errors."""

from __future__ import annotations

from inspect import cleandoc
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from vibrident.app.cli.commands.axes import axes
from vibrident.app.cli.commands.compare import compare
from vibrident.app.cli.commands.correct import correct
from vibrident.app.cli.commands.demo import demo
from vibrident.app.cli.commands.doctor import doctor
from vibrident.app.cli.commands.export import export
from vibrident.app.cli.commands.fleet import fleet
from vibrident.app.cli.commands.history import history
from vibrident.app.cli.commands.identify import identify
from vibrident.app.cli.commands.inspect import inspect
from vibrident.app.cli.commands.issue import issue
from vibrident.app.cli.commands.plan import plan
from vibrident.app.cli.commands.predict import predict
from vibrident.app.cli.commands.report import report
from vibrident.app.cli.commands.reproduce import reproduce
from vibrident.app.cli.commands.serve import serve
from vibrident.app.cli.commands.simulate import simulate
from vibrident.app.cli.commands.track import track
from vibrident.app.cli.commands.verify import verify
from vibrident.app.cli.console import BAD_INPUT, INTERRUPTED, show_error
from vibrident.app.cli.options import fill_in_names, without_markup
from vibrident.app.cli.words import shell_word
from vibrident.base.errors import VibridentError
from vibrident.base.version import __version__


class Commands(TyperGroup):
    """A group of commands whose errors are one message on stderr. A bug keeps its traceback."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find a command; names from plug-ins are looked up only for its help."""
        name, command, arguments = super().resolve_command(ctx, args)
        if command is not None and {"-h", "--help"} & set(arguments):
            # Each paragraph on one line: typer keeps other line ends.
            paragraphs = (command.help or "").split("\n\n")
            command.help = "\n\n".join(" ".join(paragraph.split()) for paragraph in paragraphs)
            for parameter in command.params:
                for text in ("metavar", "help"):
                    if hasattr(parameter, text):
                        setattr(parameter, text, fill_in_names(getattr(parameter, text)))
        return name, command, arguments

    def invoke(self, ctx: Any) -> Any:
        """Run a command."""
        try:
            return super().invoke(ctx)
        except VibridentError as error:
            show_error(error, shell_word(self, ctx.invoked_subcommand))
            raise typer.Exit(BAD_INPUT) from None
        except KeyboardInterrupt:
            raise typer.Exit(INTERRUPTED) from None


app = typer.Typer(
    name="vibrident",
    cls=Commands,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)

_PANELS = {
    "Begin": (demo, serve, doctor),
    "From files to a model": (inspect, identify, axes, fleet, report),
    "Use and judge a model": (
        predict,
        correct,
        track,
        plan,
        compare,
        simulate,
        export,
        verify,
        reproduce,
    ),
}
app.add_typer(history, name="history", rich_help_panel="Use and judge a model")
app.add_typer(issue, name="issue", rich_help_panel="Use and judge a model")
for _panel, _commands in _PANELS.items():
    for _command in _commands:
        _help = without_markup(cleandoc(_command.__doc__ or ""))
        app.command(rich_help_panel=_panel, help=_help)(_command)


def _show_version(is_requested: bool) -> None:
    if is_requested:
        typer.echo(f"vibrident {__version__}")
        raise typer.Exit


_HELP = """From calibration records of a vibration sensor to its dynamic model, with uncertainty.

Exit codes: 0 done; 2 bad input, with one message that says what to do; 3 with --strict, a result \
with a warning.
"""


@app.callback(help=_HELP)
def vibrident(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_show_version, is_eager=True, help="Print the version and exit."
        ),
    ] = False,
) -> None:
    """Define the options of the program itself."""
