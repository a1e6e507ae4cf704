"""Edit the calibration file as text: all that the file can say and the form does not ask."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

from nicegui import ui

from vibrident.app.web import frame
from vibrident.app.web.language import phrase, translate
from vibrident.app.web.sandboxed import read_calibration_text, require_readable
from vibrident.app.web.user import User
from vibrident.base.errors import InputError

_HINT = phrase(
    "A calibration file can state more than the form asks. "
    "To come back to the form, remove the file above."
)
_TRIAL_FILE = ".tried.toml"  # name under which a text is read before it takes the place of a file


def edit_as_text(
    user: User,
    name: str,
    text: str,
    on_taken: Callable[[], Awaitable[Any]],
    on_back: Callable[[], Awaitable[Any]],
) -> None:
    """Show a text to be edited; once used, it is a file of the user like an uploaded one."""
    frame.hint(translate(_HINT))
    written = ui.textarea(translate("Calibration file"), value=text).classes("written w-full")
    written.props("dense outlined stack-label autogrow")
    errors = frame.add_error_area()

    async def take() -> None:
        session = user.session
        content = (written.value or "").encode()
        session.open()
        trial = session.data / _TRIAL_FILE
        with frame.reporting(errors, user):
            try:
                user.require("identify", "write files")
                trial.write_bytes(content)
                for look in (read_calibration_text, require_readable):
                    await user.run_sandboxed(look, session.data, _TRIAL_FILE)
                session.reserve_path(name, len(content)).write_bytes(content)
            except InputError as error:
                texts = {key: text.replace(_TRIAL_FILE, name) for key, text in vars(error).items()}
                raise type(error)(**texts) from error
            finally:
                trial.unlink(missing_ok=True)
            await on_taken()

    with frame.actions():
        frame.add_button(translate("Use this file"), take, "id=use-text")
        frame.add_button(translate("Back"), on_back)
