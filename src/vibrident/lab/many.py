"""Identification of many sensors, in one process or several, in constant memory."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any, Literal, overload

from vibrident.base.errors import InputError, ModelError, VibridentError
from vibrident.base.fields import Fields
from vibrident.base.memory import ONE_THREAD
from vibrident.data.records import Calibration
from vibrident.result import Result

if TYPE_CHECKING:
    from concurrent.futures import ProcessPoolExecutor

    from vibrident.physics.models import GivenModel

CalibrationOrFile = Calibration | str | os.PathLike[str]  # a calibration, or the path of its file
_Waiting = tuple[CalibrationOrFile, "Future[Result | VibridentError]"]
WINDOW = 2  # calibrations in work or waiting, for each worker
PROCESS_START_S = 1.0  # seconds that a process takes to start


@overload
def identify_many(
    calibrations: Iterable[CalibrationOrFile],
    model: GivenModel | None = ...,
    estimator: Any = ...,
    *,
    uncertainty: Literal["auto", "noise", "inflated"] = ...,
    workers: int = ...,
    refused: Literal["raise"] = ...,
) -> Iterator[Result]: ...


@overload
def identify_many(
    calibrations: Iterable[CalibrationOrFile],
    model: GivenModel | None = ...,
    estimator: Any = ...,
    *,
    uncertainty: Literal["auto", "noise", "inflated"] = ...,
    workers: int = ...,
    refused: Literal["return"],
) -> Iterator[Result | VibridentError]: ...


def identify_many(
    calibrations: Iterable[CalibrationOrFile],
    model: GivenModel | None = None,
    estimator: Any = "auto",
    *,
    uncertainty: Literal["auto", "noise", "inflated"] = "auto",
    workers: int = 1,
    refused: Literal["raise", "return"] = "raise",
) -> Iterator[Result | VibridentError]:
    """Identify sensors in turn, and yield their results in the order of the calibrations.

    Args:
        calibrations: calibrations, or paths of calibration files, taken one by one as results are
            asked for, so that only a few are in memory.
        model: as for :func:`vibrident.identify`, the same for all.
        estimator: as for :func:`vibrident.identify`, the same for all.
        uncertainty: as for :func:`vibrident.identify`, the same for all.
        workers: processes, this one among them; all others have one thread of arithmetic each. A
            script that asks for more than 1 needs the usual ``if __name__ == "__main__":``.
        refused: on an error of input or model: ``raise`` it, which ends the iteration, or
            ``return`` it in place of the result.

    Yields:
        Results of :func:`vibrident.identify`.

    Raises:
        InputError: ``workers`` is below one, or ``refused`` is something else.
        ModelError: a model made in Python, and several processes.

    Examples:
        >>> import vibrident
        >>> tones = [100, 300, 650, 1000]
        >>> draws = (
        ...     vibrident.simulate(
        ...         frequencies_hz=tones, samples=1000, response_noise=1e-3, seed=seed
        ...     )
        ...     for seed in (1, 2)
        ... )
        >>> [result.model for result in vibrident.identify_many(draws)]
        ['accelerometer', 'accelerometer']
    """
    if workers < 1 or refused not in ("raise", "return"):
        raise InputError(
            "A setting of identify_many cannot be used.",
            expected="workers of 1 or more, and refused 'raise' or 'return'",
            found=f"workers={workers!r}, refused={refused!r}",
            where="identify_many",
            remedy="leave out the setting, or give one of the expected values",
        )
    if workers > 1 and not (model is None or isinstance(model, str)):
        raise ModelError(
            "A model made in Python cannot go to other processes.",
            expected="workers=1, or the name of a model of an installed package",
            found=f"workers={workers}",
            where="⟦identify.model⟧",
            remedy="leave workers out, or register the model as a plug-in",
        )
    settings = {"model": model, "estimator": estimator, "uncertainty": uncertainty}
    outcomes = (
        (_identified(calibration, settings) for calibration in calibrations)
        if workers == 1
        else _identified_in_processes(calibrations, settings, workers)
    )
    return _raised_or_returned(outcomes, refused)


def _raised_or_returned(
    outcomes: Iterable[Result | VibridentError], refused: str
) -> Iterator[Result | VibridentError]:
    for outcome in outcomes:
        if isinstance(outcome, VibridentError) and refused == "raise":
            raise outcome
        yield outcome


def _identified(calibration: CalibrationOrFile, settings: Fields) -> Result | VibridentError:
    from vibrident.use.identification import identify

    try:
        return identify(calibration, **settings)
    except VibridentError as error:
        return error


def _identified_in_processes(
    calibrations: Iterable[CalibrationOrFile], settings: Fields, workers: int
) -> Iterator[Result | VibridentError]:
    """Identify here and in further processes, a few calibrations ahead of the caller.

    The processes are started once this one has worked as long as that takes, which a few small
    sensors do not need. This one works on meanwhile, and where it would wait for another.
    """
    remaining = iter(calibrations)
    spent_s = 0.0
    for calibration in remaining:
        begin = time.perf_counter()
        outcome = _identified(calibration, settings)
        spent_s += time.perf_counter() - begin
        yield outcome
        if spent_s >= PROCESS_START_S:
            break
    else:
        return
    waiting: deque[_Waiting] = deque()
    pool = _start_processes(workers - 1)
    try:
        for calibration in remaining:
            waiting.append((calibration, pool.submit(_identified, calibration, settings)))
            if len(waiting) >= WINDOW * workers:
                yield _take_next(waiting, settings)
        while waiting:
            yield _take_next(waiting, settings)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _start_processes(processes: int) -> ProcessPoolExecutor:
    """Start processes with one thread of arithmetic each, which is read when they start."""
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor

    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        pool = ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"))
        # a pool takes one call more than it can work on, and does not give it back
        for _ in range(processes + 1):
            pool.submit(_load)
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
    return pool


def _load() -> None:
    import vibrident.use.identification  # noqa: F401


def _take_next(waiting: deque[_Waiting], settings: Fields) -> Result | VibridentError:
    """Return the outcome of the first calibration that waits.

    Until it is there, calibrations that no process has begun are identified here.
    """
    for number, (calibration, future) in enumerate(tuple(waiting)):
        if waiting[0][1].done():
            break
        if future.cancel():
            computed: Future[Result | VibridentError] = Future()
            computed.set_result(_identified(calibration, settings))
            waiting[number] = calibration, computed
    return waiting.popleft()[1].result()
