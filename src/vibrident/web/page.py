"""One user's page: the steps in their order."""

from __future__ import annotations

from nicegui import app, ui

from vibrident.web.columns import ColumnsStep
from vibrident.web.compare import CompareStep
from vibrident.web.data import DataStep
from vibrident.web.fit import FitStep
from vibrident.web.frame import User
from vibrident.web.look import STYLE
from vibrident.web.outcome import OutcomeStep
from vibrident.web.session import Session


def page(limit_mb: float) -> None:
    """Build the page for a new user."""

    user = User(Session(limit_mb))
    ui.context.client.on_delete(user.close)
    app.on_shutdown(user.close)
    ui.colors(primary="#0a4b78", positive="#14632f", negative="#a1001a", warning="#7a4b00")
    ui.add_css(STYLE)
    ui.html('<a class="skip" href="#main">To the content</a>', sanitize=False)
    with ui.element("header").classes("top"):
        ui.html("<h1>vibrident</h1><p>From calibration records to a sensor's dynamic model</p>", sanitize=False)
    with ui.element("main").classes("steps").props("id=main"):
        outcome = OutcomeStep(user)
        compare = CompareStep(user)
        fit = FitStep(user)
        columns = ColumnsStep(user)
        data = DataStep(user)
        data.build(on_data=columns.show, on_result=lambda: (outcome.show(), compare.show()))
        columns.build(on_confirmed=fit.show, on_doubt=fit.hide)
        fit.build(on_result=lambda: (outcome.show(), compare.show()))
        outcome.build()
        compare.build()
