"""Identifications side by side, each in a thread of its own, that wait for each other wherever they fit.

An identification is the usual one up to a descent of Levenberg and Marquardt. There its thread waits until every other
is at a descent too, or has ended. All descents that wait then go to the device, those of equal shape as one program.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from vibrident.errors import VibridentError
from vibrident.estimators.optimise import Objective, Trace, descended_by
from vibrident.problem import Coordinates, FrequencyProblem, LineProblem
from vibrident.records import Calibration, FloatArray
from vibrident.result import Result

if TYPE_CHECKING:
    from vibrident.batched.program import Descent


@dataclass(eq=False)
class _Waiting:
    """A descent that waits, and its end."""

    descent: Descent
    trace: Trace | None = None
    error: BaseException | None = None


class Together:
    """Where threads meet.

    Args:
        descend: ends descents of equal shape, in order.
        threads: that take part.
    """

    def __init__(self, descend: Callable[[Sequence[Descent]], list[Trace]], threads: int) -> None:
        self._descend, self._at_work = descend, threads
        self._waiting: list[_Waiting] = []
        self._changed = threading.Condition()

    def trace(self, descent: Descent) -> Trace:
        """The end of a descent, when those of all threads have been made."""
        own = _Waiting(descent)
        with self._changed:
            self._waiting.append(own)
            self._leave()
            self._changed.wait_for(lambda: own.trace is not None or own.error is not None)
        if own.error is not None:
            raise own.error
        assert own.trace is not None
        return own.trace

    def end(self) -> None:
        """A thread makes no further descents."""
        with self._changed:
            self._leave()

    def _leave(self) -> None:
        self._at_work -= 1
        if self._at_work or not self._waiting:
            return
        waiting, self._waiting = self._waiting, []
        shapes: dict[Any, list[_Waiting]] = {}
        for one in waiting:
            shapes.setdefault(one.descent.shape, []).append(one)
        for some in shapes.values():
            try:
                for one, trace in zip(some, self._descend([one.descent for one in some]), strict=True):
                    one.trace = trace
            except Exception as error:
                for one in some:
                    one.error = error
        self._at_work = len(waiting)
        self._changed.notify_all()


@dataclass
class _Taker:
    """What a thread's descents become: one of a batch, or, with the reason, one on the processor."""

    together: Together
    taken: int = 0
    reasons: dict[str, None] = field(default_factory=dict)

    def __call__(
        self, objective: Objective, start: FloatArray, args: Any, tolerance: float, most: int, straight: int
    ) -> Trace | None:
        from vibrident.batched.program import Descent

        found = _problem_of(objective, args)
        if isinstance(found, str):
            self.reasons[found] = None
            return None
        trace = self.together.trace(Descent.of(*found, start, tolerance, most))
        if len(trace.costs) > straight:
            self.reasons["a descent follows a curved valley"] = None
            return None
        self.taken += 1
        return trace

    @property
    def said(self) -> str:
        """Where the fits were made, for the result."""
        if not self.reasons:
            return "gpu" if self.taken else "cpu: there is no fit of tones or lines"
        return f"{'gpu and ' if self.taken else ''}cpu: {', '.join(self.reasons)}"


def _problem_of(
    objective: Objective, args: Any
) -> tuple[FrequencyProblem, Coordinates, None] | tuple[LineProblem, Coordinates, FloatArray] | str:
    """Problem, coordinates and noise of a descent; for one that no batch can take, the reason in words."""
    own = getattr(objective, "__self__", None)
    if isinstance(own, FrequencyProblem) and isinstance(args, Coordinates):
        return own, args, None
    if not (isinstance(args, tuple) and len(args) == 3 and isinstance(args[1], LineProblem)):
        return "the fit is neither of tones nor of lines"
    coordinates, problem, noise = args
    if problem.trained.method.name == "euler":
        return "the discretisation is not always stable"
    if any(run.used is not None for run in problem.runs):
        return "samples are missing"
    if any(run.hum for run in problem.runs):
        return "hum is fitted beside the motion"
    return problem, coordinates, noise


def identified_together(
    calibrations: Sequence[Calibration],
    identify: Callable[[Calibration], Result],
    descend: Callable[[Sequence[Descent]], list[Trace]],
) -> list[Result | VibridentError]:
    """Results, or errors of input and model, in the order of the calibrations.

    Args:
        calibrations: as many as there will be threads.
        identify: of one calibration.
        descend: ends descents of equal shape, in order.
    """
    together = Together(descend, len(calibrations))
    found: list[Result | BaseException | None] = [None] * len(calibrations)

    def work(number: int, calibration: Calibration) -> None:
        taker = _Taker(together)
        try:
            with descended_by(taker):
                result = identify(calibration)
            found[number] = replace(result, settings={**result.settings, "device": taker.said})
        except BaseException as error:
            found[number] = error
        finally:
            together.end()

    threads = [threading.Thread(target=work, args=one, daemon=True) for one in enumerate(calibrations)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return [_told(one) for one in found]


def _told(found: Result | BaseException | None) -> Result | VibridentError:
    if isinstance(found, Result | VibridentError):
        return found
    assert found is not None
    raise found
