"""Many calibrations, one table: a row a calibration, resumed where it was stopped."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from vibrident.base.errors import InputError

if TYPE_CHECKING:
    from pandas import DataFrame

    from vibrident.lab.fleet import Outcome, Scheduler
    from vibrident.lab.fleet.coordinator import RunProgress

TIME_LIMIT_S = 300.0  # longest time of one calibration, s, unless it is given


class Fleet:
    """Calibrations of many sensors, and the folder of their table (extra ``fleet``).

    Args:
        calibrations: calibration files; folders, for all .toml files in and below them; or globs.
        folder: of ``fleet.parquet`` (a row a calibration), ``fleet.html`` and what resuming needs.
        model: name of the sensor model for all; None: each file's own.
        estimator: how to fit: a name, or ``auto``.
        limits: a limits file (TOML): nominal values and tolerances by type of sensor.
        time_limit_s: longest time of one calibration, s.
        memory_limit_bytes: largest memory of one process; None: its share of the machine's.
        keep_results: whether whole results are written into ``folder/results``.

    Raises:
        InputError: the limits file cannot be used.
        ModelError: the model is unknown.

    Examples:
        >>> import vibrident
        >>> for serial in ("001", "002"):
        ...     sensor = vibrident.simulate(frequencies_hz=[100, 300, 650, 1000], samples=1000)
        ...     path = vibrident.with_noise(sensor, response_noise=1e-3).save(f"lot/{serial}")
        >>> fleet = vibrident.Fleet("lot", "fleet")
        >>> outcome = fleet.identify(workers=1)
        >>> list(fleet.to_dataframe().status)
        ['identified', 'identified']
    """

    def __init__(
        self,
        calibrations: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
        folder: str | os.PathLike[str],
        *,
        model: str | None = None,
        estimator: str = "auto",
        limits: str | os.PathLike[str] | None = None,
        time_limit_s: float = TIME_LIMIT_S,
        memory_limit_bytes: int | None = None,
        keep_results: bool = True,
    ) -> None:
        from vibrident.lab.fleet.limits import Specification, read_limits
        from vibrident.lab.fleet.orders import Orders
        from vibrident.physics.models import parse

        if model is not None:
            parse(model)  # a wrong name is refused once, not in every row
        if isinstance(calibrations, str | os.PathLike):
            calibrations = [calibrations]
        self._patterns = [os.fspath(pattern) for pattern in calibrations]
        self.folder: Path = Path(folder)
        self._orders = Orders(
            os.fspath(folder), model, estimator, time_limit_s, memory_limit_bytes, keep_results
        )
        self._limits = Specification() if limits is None else read_limits(Path(limits))

    def __repr__(self) -> str:
        return f"<Fleet of {', '.join(self._patterns)[:200]} in {self.folder}>"

    def identify(
        self,
        *,
        workers: int | None = None,
        scheduler: str | None = None,
        resume: bool = True,
        progress: Callable[[RunProgress], None] = lambda _: None,
    ) -> Outcome:
        """Identify the calibrations that have no row yet, and write table and page.

        Args:
            workers: processes on this machine; None: one a core.
            scheduler: address or file of a running Dask scheduler in place of this machine's
                processes (extra ``cluster``).
            resume: whether rows that exist are kept, unless the calibration's files have changed.
            progress: called about twice a second.

        Returns:
            Counts by status and warning, and the files written.

        Raises:
            InputError: a pattern names nothing, the folder cannot be written, the connection to the
                scheduler is lost, workers and scheduler are both given, or pyarrow is missing.
        """
        from vibrident.lab.fleet import RunRequest, run
        from vibrident.lab.fleet.parts import arrow

        arrow()
        request = RunRequest(self._patterns, self._orders, self._limits, fresh=not resume)
        return run(request, _scheduler(workers, scheduler), progress)

    def to_dataframe(self) -> DataFrame:
        """Return the table: a row a calibration, each parameter as ``NAME`` and ``NAME_u``.

        Raises:
            InputError: there is no table yet.
        """
        import pandas as pd

        table = self.folder / "fleet.parquet"
        if not table.is_file():
            raise InputError(
                "There is no table of this fleet yet.",
                expected="the table that identify() writes",
                found="none",
                where=str(table),
                remedy="call identify() first",
            )
        return pd.read_parquet(table)


def _scheduler(workers: int | None, scheduler: str | None) -> Scheduler:
    from vibrident.base.process import processors
    from vibrident.lab.fleet import Dask, LocalScheduler

    if scheduler is None:
        return LocalScheduler(workers or processors())
    if workers is not None:
        raise InputError(
            "Workers are requested in two ways.",
            expected="⟦fleet.workers⟧, for this machine, "
            "or ⟦fleet.scheduler⟧, with its own workers",
            found="both",
            where="⟦here⟧",
            remedy="leave one of the two out",
        )
    return Dask(scheduler)
