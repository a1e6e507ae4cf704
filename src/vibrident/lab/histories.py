"""Follow sensors over the years: add results to a store, and query it."""

from __future__ import annotations

import datetime
import os
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Self

from vibrident.result import Result
from vibrident.result.loading import GivenResult
from vibrident.show.issue import GivenCertificate, issued

if TYPE_CHECKING:
    from vibrident.lab.history.document import Question


class History:
    """A store of the calibrations of sensors (extra ``history``); closes with the ``with`` block.

    Args:
        store: path of a SQLite file (``.db``), or a SQLAlchemy URL of SQLite or PostgreSQL; None:
            the environment's ``VIBRIDENT_STORE``, else a SQLite file in the user's data folder. A
            new store is created when the first result is added.

    Raises:
        InputError: the store cannot be used, or SQLAlchemy is not installed.

    Examples:
        >>> import vibrident
        >>> hz = [100, 300, 650, 1000]
        >>> calibration = vibrident.simulate(frequencies_hz=hz, samples=2000, response_noise=1e-3)
        >>> result = vibrident.identify(calibration)
        >>> with vibrident.History("laboratory.db") as history:
        ...     new = history.add(result, serial_number="4711")
        ...     [sensor["serial_number"] for sensor in history.sensors()]
        ['4711']
    """

    def __init__(self, store: str | os.PathLike[str] | None = None) -> None:
        import vibrident.lab.history  # noqa: F401 - says which library is missing
        from vibrident.lab.history.store import Store

        self._store = Store(None if store is None else os.fspath(store))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<History in {self._store.printed}>"

    def close(self) -> None:
        """Close the connections to the store."""
        self._store.close()

    def add(
        self,
        results: GivenResult | Iterable[GivenResult],
        *,
        serial_number: str | None = None,
        date: datetime.date | None = None,
        certificate: GivenCertificate = (),
    ) -> int:
        """Add results to the store; a result that it holds already stays unchanged.

        Args:
            results: a result or several, or paths of their ``result.json``; a generator is read one
                result after another.
            serial_number: for results without one.
            date: of the calibration, for results without one.
            certificate: what the certificate states, given after the fit, as for
                :func:`vibrident.report`.

        Returns:
            The number of new results.

        Raises:
            InputError: a result states no serial number, or the store cannot be used.
        """
        from vibrident.lab.history.entry import add_all

        listed = [results] if isinstance(results, Result | str | os.PathLike) else results
        certified = (issued(result, certificate)[0] for result in listed)
        return sum(
            added.new
            for added in add_all(self._store, certified, serial_number=serial_number, date=date)
        )

    def sensors(self, *, sensor_type: str | None = None) -> list[dict[str, Any]]:
        """Return a row for each sensor: number of calibrations, and first and last date.

        Args:
            sensor_type: only sensors of this type; None: all.

        Raises:
            InputError: there is no store yet.
        """
        from vibrident.lab.history.document import listed

        return listed(self._store, sensor_type)

    def show(
        self,
        serial_number: str,
        *,
        sensor_type: str | None = None,
        axis: str | None = None,
        manufacturer: str | None = None,
        quantity: str | None = None,
        frequency_hz: float | None = None,
        until: datetime.date | None = None,
        tolerance: float | None = None,
        nominal: float | None = None,
        interval_years: float | None = None,
    ) -> dict[str, Any]:
        """Return the calibrations, drift, prediction and due date of a sensor.

        Args:
            serial_number: of the sensor.
            sensor_type: needed if several sensors have the number.
            axis: likewise, for a sensor of several axes.
            manufacturer: likewise.
            quantity: name of a parameter; None: the sensitivity at the reference frequency.
            frequency_hz: nominal frequency, for the sensitivity there.
            until: date to predict for; None: the end of the interval in force.
            tolerance: relative, for the due date; None: no due date.
            nominal: the value that the sensor is used with; None: the last calibration's.
            interval_years: in force; None: the time between the last two calibrations.

        Returns:
            The document of ``vibrident history show --format json``, plain values.

        Raises:
            InputError: there is no such sensor or quantity.
        """
        from vibrident.lab.history.document import of_sensor
        from vibrident.lab.history.query import find

        question = _question(quantity, frequency_hz, until, tolerance, nominal, interval_years)
        sensor = find(self._store, serial_number, sensor_type, axis, manufacturer)
        return of_sensor(self._store, sensor, question)

    def due(
        self,
        tolerance: float,
        *,
        nominal: float | None = None,
        sensor_type: str | None = None,
        quantity: str | None = None,
        frequency_hz: float | None = None,
        interval_years: float | None = None,
    ) -> list[dict[str, Any]]:
        """Return a row for each sensor with the date of its next calibration, the earliest first.

        Args:
            tolerance: relative; the quantity shall not change by more.
            nominal: the value that the sensors are used with; None: that of each last calibration.
            sensor_type: only sensors of this type; None: all.
            quantity: name of a parameter; None: the sensitivity at the reference frequency.
            frequency_hz: nominal frequency, for the sensitivity there.
            interval_years: in force; None: the time between the last two calibrations.

        Raises:
            InputError: there is no store yet.
        """
        from vibrident.lab.history.document import all_due

        question = _question(quantity, frequency_hz, None, tolerance, nominal, interval_years)
        return all_due(self._store, question, sensor_type)

    def approve(self, number: int, *, by: str | None = None, note: str = "") -> list[int]:
        """Approve a calibration, so that it counts instead of other evaluations of the same data.

        Args:
            number: of the calibration in the store.
            by: who approves; None: whom the certificate states, else the account.
            note: a remark.

        Returns:
            Numbers of the evaluations that are superseded.

        Raises:
            InputError: there is no such calibration, or it cannot be approved.
        """
        from vibrident.lab.history.approval import approve

        return approve(self._store, number, by=by, note=note)

    def result(self, number: int) -> Result:
        """Return a stored result.

        Args:
            number: of the calibration in the store.

        Raises:
            InputError: no calibration has this number.
        """
        from vibrident.lab.history.query import result

        return result(self._store, number)


def _question(
    quantity: str | None,
    frequency_hz: float | None,
    until: datetime.date | None,
    tolerance: float | None,
    nominal: float | None,
    interval_years: float | None,
) -> Question:
    from vibrident.lab.history.document import Question
    from vibrident.lab.history.due import Tolerance
    from vibrident.lab.history.schema import REFERENCE_SENSITIVITY

    limits = None if tolerance is None else Tolerance(tolerance, nominal)
    return Question(
        quantity or REFERENCE_SENSITIVITY, frequency_hz, until, lambda _: limits, interval_years
    )
