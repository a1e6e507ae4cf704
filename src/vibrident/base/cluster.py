"""Connect to a Dask cluster, and share independent calls over its workers."""

from __future__ import annotations

import contextlib
import itertools
import platform
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from vibrident.base.errors import InputError
from vibrident.base.extras import library
from vibrident.base.process import processors
from vibrident.base.version import __version__

PATIENCE_S = 20.0  # to wait for a scheduler
LOCAL = "local"  # in place of an address: workers of this machine, one a core
#: Packages whose versions decide the last digits of a sum.
_ARITHMETIC = ("numpy", "scipy")
_WAITING_CALLS_PER_THREAD = 2  # calls that wait for each thread, so that none is idle


def connect(where: str, setting: str, patience_s: float = PATIENCE_S) -> Any:
    """Return a client of a running Dask scheduler.

    Args:
        where: address, such as ``tcp://host:8786``, or the scheduler's file (``.json``).
        setting: that gives it, as messages name it, such as ``⟦fleet.scheduler = 'local'⟧``.
        patience_s: to wait for it.

    Raises:
        InputError: Dask is not installed, or no scheduler answers there.
    """
    distributed = _distributed(where, setting)
    scheduler = {"address": where}
    if where.endswith(".json"):
        scheduler = {"scheduler_file": where}
        if not Path(where).is_file():
            raise _unreachable(where, setting, "no file of that name")
    elif "/" not in where.partition("://")[2] and not where.rpartition(":")[2].isdigit():
        raise _unreachable(where, setting, "no port")  # Dask would wait for it at the end
    try:
        return distributed.Client(**scheduler, timeout=patience_s, set_as_default=False)
    except (OSError, ValueError, TimeoutError, KeyError, ImportError) as error:
        raise _unreachable(where, setting, f"{type(error).__name__}: {error}") from error


class Cluster:
    """Workers whose results equal those of this process to the last bit.

    Args:
        where: ``local``, or as of :func:`connect`.
        setting: that gives it, as messages name it.

    Raises:
        InputError: as :func:`connect`; or there are no workers, or they have other versions of
            this package or of the libraries that decide the last digits.
    """

    def __init__(self, where: str, setting: str) -> None:
        self._where = where
        self._open = contextlib.ExitStack()
        try:
            if where == LOCAL:
                distributed = _distributed(where, setting)
                local = distributed.LocalCluster(
                    n_workers=processors(), threads_per_worker=1, dashboard_address=None
                )
                where = self._open.enter_context(local).scheduler_address
            self._client = self._open.enter_context(connect(where, setting))
            self._check_workers()
        except BaseException:
            self._open.close()
            raise

    def __enter__(self) -> Cluster:
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def results(
        self, function: Callable[..., Any], arguments: Iterable[tuple[Any, ...]]
    ) -> Iterator[Any]:
        """Yield the results of calling a function with each tuple of arguments, in their order.

        Only a few calls a thread are submitted ahead, so that neither calls nor results pile up.

        Args:
            function: importable on the workers.
            arguments: of each call, taken when the call is made.

        Raises:
            InputError: the connection is lost, or a worker ends again and again.
        """
        remaining = iter(arguments)
        ahead = _WAITING_CALLS_PER_THREAD * max(sum(self._client.nthreads().values()), 1)
        calls = deque(self._calls(function, itertools.islice(remaining, ahead)))
        try:
            while calls:
                result = self._result(calls.popleft())
                calls.extend(self._calls(function, itertools.islice(remaining, 1)))
                yield result
        finally:
            with contextlib.suppress(Exception):
                self._client.cancel(list(calls))

    def _calls(
        self, function: Callable[..., Any], arguments: Iterable[tuple[Any, ...]]
    ) -> Iterator[Any]:
        for argument in arguments:
            yield self._client.submit(function, *argument, pure=False)

    def _result(self, call: Any) -> Any:
        from concurrent.futures import CancelledError

        try:
            return call.result()
        except (OSError, TimeoutError, CancelledError) as error:
            raise self._lost("The connection to the scheduler is lost.", str(error)) from error
        except Exception as error:
            if type(error).__name__ != "KilledWorker":
                raise
            raise self._lost("A worker ended again and again.", str(error)[:200]) from error

    def _lost(self, problem: str, detail: str) -> InputError:
        return InputError(
            problem,
            expected="workers with room for a stretch of a record (about 1 GB each)",
            found=detail or "no answer",
            where=self._where,
            remedy="start scheduler and workers again, then run the same command again: with "
            "⟦identify.work = FOLDER⟧ it continues where it stopped",
        )

    def _check_workers(self) -> None:
        """Refuse workers with other versions, whose results could differ in the last digits."""
        with contextlib.suppress(Exception):
            self._client.wait_for_workers(1, timeout=PATIENCE_S)
        needed = versions()
        try:
            by_worker = self._client.run(versions)
        except ImportError as error:
            by_worker = {"worker": {"vibrident": f"not installed ({error})"}}
        if not by_worker:
            raise self._unequal("no workers")
        for address, installed in by_worker.items():
            differences = [
                f"{k} {installed.get(k)}" for k, v in needed.items() if installed.get(k) != v
            ]
            if differences:
                raise self._unequal(f"{', '.join(differences)} on {address}")

    def _unequal(self, difference: str) -> InputError:
        needed = ", ".join(f"{name} {number}" for name, number in versions().items())
        return InputError(
            "The workers of the scheduler cannot share this identification.",
            expected=f"workers with {needed}, as here",
            found=difference,
            where=self._where,
            remedy="install these versions where the workers run, and start the workers again",
        )


def versions() -> dict[str, str]:
    """Return the versions that decide the last digits of a result, by name."""
    installed = {"vibrident": __version__, "python": platform.python_version()}
    for package in _ARITHMETIC:
        with contextlib.suppress(PackageNotFoundError):
            installed[package] = version(package)
    return installed


def _distributed(where: str, setting: str) -> Any:
    problem = "A scheduler needs Dask, which is not installed."
    return library("distributed", "cluster", problem, setting)


def _unreachable(where: str, setting: str, detail: str) -> InputError:
    return InputError(
        "No scheduler answers there.",
        expected="the address of a Dask scheduler, such as tcp://host:8786, or its file (.json)",
        found=detail,
        where=setting,
        remedy="start it with `dask scheduler`, and copy the address that it prints",
    )
