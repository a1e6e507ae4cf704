"""Many sensors, in one process or several; memory does not grow with their number."""

from __future__ import annotations

import functools
import itertools
import os
from collections import deque
from collections.abc import Iterable, Iterator
from typing import Any, Literal, overload

from vibrident.errors import VibridentError
from vibrident.records import Calibration
from vibrident.result import Result

#: A calibration, or the path of its file.
Given = Calibration | str | os.PathLike[str]
#: Calibrations in work or waiting, for each worker.
WINDOW = 2
#: Calibrations that are fitted together on a device; they are in memory at the same time.
TOGETHER = 64
#: Environment variables that keep a worker's arithmetic on one core.
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@overload
def identify_many(
    calibrations: Iterable[Given],
    model: str | None = ...,
    estimator: Any = ...,
    *,
    uncertainty: Literal["auto", "noise", "inflated"] = ...,
    workers: int = ...,
    refused: Literal["raise"] = ...,
    device: Literal["cpu", "gpu"] = ...,
) -> Iterator[Result]: ...


@overload
def identify_many(
    calibrations: Iterable[Given],
    model: str | None = ...,
    estimator: Any = ...,
    *,
    uncertainty: Literal["auto", "noise", "inflated"] = ...,
    workers: int = ...,
    refused: Literal["return"],
    device: Literal["cpu", "gpu"] = ...,
) -> Iterator[Result | VibridentError]: ...


def identify_many(
    calibrations: Iterable[Given],
    model: str | None = None,
    estimator: Any = "auto",
    *,
    uncertainty: Literal["auto", "noise", "inflated"] = "auto",
    workers: int = 1,
    refused: Literal["raise", "return"] = "raise",
    device: Literal["cpu", "gpu"] = "cpu",
) -> Iterator[Result | VibridentError]:
    """Identify sensors in turn: the results of :func:`vibrident.identify`, in the order of the calibrations.

    Args:
        calibrations: calibrations, or paths of calibration files, taken one by one as results are asked for, so that
            only a few are in memory.
        model: as for :func:`vibrident.identify`, the same for all.
        estimator: as for :func:`vibrident.identify`, the same for all.
        uncertainty: as for :func:`vibrident.identify`, the same for all.
        workers: processes, each with one thread of arithmetic; 1: this one. A script that asks for more needs the usual
            ``if __name__ == "__main__":``.
        refused: on an error of input or model: ``raise`` it, which ends the iteration, or ``return`` it in place of the
            result.
        device: ``gpu`` fits tones and lines of several calibrations at once on the first GPU that JAX finds, in float64
            and with the same numbers to 1e-9; the rest of the work stays on the processor. ``settings.device`` of each
            result says where it was fitted, and why, where it was the processor. It is used with one worker.

    Raises:
        ValueError: ``workers`` is below one, or ``refused`` or ``device`` is something else.
        InputError: there is no GPU.
    """
    if workers < 1 or refused not in ("raise", "return"):
        raise ValueError(f"workers of 1 or more and refused 'raise' or 'return' are needed, not {workers}, {refused!r}")
    if device not in ("cpu", "gpu") or (device == "gpu" and workers > 1):
        raise ValueError(f"device 'cpu', or 'gpu' with one worker, is needed, not {device!r} with {workers}")
    given = {"model": model, "estimator": estimator, "uncertainty": uncertainty}
    if device == "gpu":
        return _told(_together(calibrations, given), refused)
    found = (_identified(one, given) for one in calibrations) if workers == 1 else _beside(calibrations, given, workers)
    return _told(found, refused)


def _told(found: Iterable[Result | VibridentError], refused: str) -> Iterator[Result | VibridentError]:
    for one in found:
        if isinstance(one, VibridentError) and refused == "raise":
            raise one
        yield one


def _identified(calibration: Given, given: dict[str, Any]) -> Result | VibridentError:
    from vibrident.identification import identify

    try:
        return identify(calibration, **given)
    except VibridentError as error:
        return error


def _together(calibrations: Iterable[Given], given: dict[str, Any]) -> Iterator[Result | VibridentError]:
    """Some at a time, fitted on the GPU, which is looked for at once."""
    from vibrident.batched import identified_together
    from vibrident.batched.program import descend, gpu
    from vibrident.identification import identify
    from vibrident.io import read

    on_device = functools.partial(descend, device=gpu())

    def identified() -> Iterator[Result | VibridentError]:
        waiting = iter(calibrations)
        while some := list(itertools.islice(waiting, TOGETHER)):
            read_in = [one if isinstance(one, Calibration) else read(one) for one in some]
            yield from identified_together(read_in, lambda one: identify(one, **given), on_device)

    return identified()


def _beside(calibrations: Iterable[Given], given: dict[str, Any], workers: int) -> Iterator[Result | VibridentError]:
    """In worker processes, a few calibrations ahead of the caller."""
    import multiprocessing
    from concurrent.futures import Future, ProcessPoolExecutor

    waiting: deque[Future[Result | VibridentError]] = deque()
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))  # read when a worker starts
    try:
        with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
            for calibration in calibrations:
                waiting.append(pool.submit(_identified, calibration, given))
                if len(waiting) >= WINDOW * workers:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
