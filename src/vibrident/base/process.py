"""Functions called in another process, with limits on memory and time, progress, and errors as they are raised.

The one mechanism for readers of untrusted files, identifications of the page and of fleets, and
pictures. Calls and answers are parcels over the pipes of the child. The child ends when its stdin
ends, in the middle of whatever it does: whoever started it is gone.
"""

from __future__ import annotations

import contextlib
import math
import os
import pkgutil
import queue
import signal
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Literal, TypeVar

from vibrident.base import parcel
from vibrident.base.errors import InputError, NotConverged, VibridentError
from vibrident.base.memory import ONE_THREAD, keep_freed

_WORK = "from vibrident.base.process import work; work()"
#: One thread of arithmetic, because the stack of each counts as memory. No plug-ins of HDF5: they
#: are foreign code.
_SURROUNDINGS = {
    **ONE_THREAD,
    "HDF5_PLUGIN_PRELOAD": "::",
    "XLA_PYTHON_CLIENT_PREALLOCATE": "false",  # processes share a GPU
}
#: Most bytes of an answer: an error may quote its input.
_LONGEST_ANSWER = 16_000_000
_ANY_LENGTH = 1 << 62  # of a call, whose sender is trusted
_LONGEST_TRACE = 20_000
#: Bytes of what a process printed last.
_LAST_BYTES = 20_000
#: Seconds until a process that closed its output has ended.
_ENDING_S = 5.0
_OUT_OF_TIME = -24  # SIGXCPU of Linux and macOS
#: How an answer fails that was not written by :func:`parcel.send`.
_UNREADABLE = (ValueError, TypeError, KeyError, RecursionError)
_T = TypeVar("_T")


def _signal(number: int) -> str:
    """Return a signal's number and name: ``signal 9, SIGKILL``."""
    try:
        return f"signal {number}, {signal.Signals(number).name}"
    except ValueError:
        return f"signal {number}"


class WorkerError(RuntimeError):
    """An unexpected failure in the process; the message is its traceback."""


class Ended(Exception):
    """The process was ended by its owner during a call, or before."""


class Died(Exception):
    """The process ended, or had to be ended, during a call: ``ending`` in words, and what it printed last."""

    def __init__(
        self, reason: Literal["time", "memory", "crash"], ending: str, printed: str = ""
    ) -> None:
        super().__init__(f"{ending}\n{printed}".rstrip())
        self.reason = reason
        self.ending = ending
        self.printed = printed


@dataclass(frozen=True)
class Limits:
    """Limits of a call; None where there is none."""

    seconds: float | None = None  # most time of the clock
    memory_bytes: int | None = (
        None  # most memory beside the process's code, where the system can limit it (Linux)
    )
    file_bytes: int | None = None  # most bytes of a file that it writes
    answer_bytes: int = _LONGEST_ANSWER  # longest message that is taken from it


NO_LIMITS = Limits()


class Process:
    """A process that calls importable functions, one at a time: started when needed, and again after it has ended.

    Args:
        prepare: called there before the first call, to load libraries.
        folder: where it works; None for the folder of this process.
        idle_s: seconds without a call after which it ends; None: with its owner.
        wrapper: a command that confines it.
    """

    def __init__(
        self,
        prepare: Callable[[], None] | None = None,
        *,
        folder: Path | None = None,
        idle_s: float | None = None,
        wrapper: Sequence[str] = (),
    ) -> None:
        self._arguments = (_name(prepare) if prepare else "", "" if idle_s is None else str(idle_s))
        self._folder = folder
        self._wrapper = wrapper
        self._child: _Child | None = None
        self._ended = False
        self._lock = threading.Lock()  # held during a call

    def __enter__(self) -> Process:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def alive(self) -> bool:
        """Return whether a process is waiting for calls."""
        return self._child is not None and self._child.popen.poll() is None

    def start(self) -> None:
        """Start it, unless it is alive.

        Raises:
            OSError: no process can be started.
            Ended: :meth:`end` was called.
        """
        if not self.alive:
            self.close()
            self._child = _Child(self._arguments, self._folder, self._wrapper)
        if self._ended:  # perhaps while it started
            self.close()
            raise Ended

    def call(
        self,
        function: Callable[..., _T],
        *args: Any,
        limits: Limits = NO_LIMITS,
        progress: Callable[..., object] | None = None,
    ) -> _T:
        """Call a function there and return what it returns.

        Args:
            function: defined at the top of a module, which the process imports.
            args: values that a parcel can hold.
            limits: of this call.
            progress: called with what the function passes to its argument of that name.

        Raises:
            Died: the process needs more memory or time than it may have, or crashed.
            Ended: :meth:`end` was called.
            WorkerError: anything else that the function raised, or an answer that cannot be read.
            InputError, NotConverged: as the function raises them.
            OSError: no process can be started.
        """
        call = {
            "name": _name(function),
            "args": args,
            "limits": limits,
            "progress": progress is not None,
        }
        with self._lock:
            try:
                self.start()
                assert self._child is not None
                said = self._child.answer(call, limits, progress or (lambda *_: None))
                if "memory" in said:
                    raise Died("memory", "a process that asked for more")
            except Exception as error:
                self.close()
                if self._ended:
                    raise Ended from None
                if isinstance(error, _UNREADABLE):
                    raise WorkerError(f"the answer cannot be read: {error}") from error
                raise
            finally:
                if self._ended:
                    self.close()
        if "done" in said:
            return said["done"]
        raise _error(said)

    def end(self) -> None:
        """End it for good, from any thread; a call that is under way raises Ended."""
        self._ended = True
        self.kill()
        if self._lock.acquire(blocking=False):  # else the call closes it
            try:
                self.close()
            finally:
                self._lock.release()

    def kill(self) -> None:
        """Kill it and what it started, without waiting or taking a lock."""
        if (child := self._child) is not None:
            child.kill()

    def close(self) -> None:
        """End it and what it started; the next call starts another."""
        child = self._child
        self._child = None
        if child is not None:
            child.close()


class _Child:
    """One life of a process."""

    def __init__(
        self, arguments: Sequence[str], folder: Path | None, wrapper: Sequence[str]
    ) -> None:
        self.popen = subprocess.Popen(
            # -P: no imports from the user's folder. In a session of its own Ctrl-C does not reach
            # it.
            [*wrapper, sys.executable, "-P", "-c", _WORK, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            cwd=folder,
            env={
                **os.environ,
                **_SURROUNDINGS,
                "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
            },
            start_new_session=True,
        )
        assert self.popen.stdin is not None
        assert self.popen.stdout is not None
        self._calls, self._answers = self.popen.stdin, self.popen.stdout
        self._printed, self._wrapped = b"", bool(wrapper)
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()

    def answer(
        self, call: Mapping[str, Any], limits: Limits, progress: Callable[..., object]
    ) -> dict[str, Any]:
        """Send a call; return the last message about it.

        Raises:
            Died: there is none.
        """
        overdue = threading.Event()
        alarm = threading.Timer(limits.seconds or 0.0, lambda: (overdue.set(), self.kill()))
        alarm.daemon = True
        if limits.seconds is not None:
            alarm.start()
        try:
            parcel.send(self._calls, call)
            while "progress" in (said := parcel.receive(self._answers, limits.answer_bytes)):
                progress(*said["progress"])
            return said
        except parcel.TooLong:
            return {"memory": True}
        except (EOFError, OSError):
            raise self._death(overdue) from None
        finally:
            alarm.cancel()

    def _death(self, overdue: threading.Event) -> Died:
        try:
            code = self.popen.wait(_ENDING_S)
        except subprocess.TimeoutExpired:  # it has closed its output, and goes on
            self.kill()
            code = self.popen.wait()
        code = 128 - code if self._wrapped and code > 128 else code  # how a wrapper says a signal
        if overdue.is_set() or code == _OUT_OF_TIME:
            return Died("time", "a process that was still at work")
        self._listener.join(_ENDING_S)
        ending = f"a process that ended with {_signal(-code) if code < 0 else f'status {code}'}"
        return Died("crash", ending, self._printed.decode(errors="replace").strip())

    def kill(self) -> None:
        """Kill it and what it started."""
        with contextlib.suppress(ProcessLookupError, PermissionError):
            if hasattr(os, "killpg"):
                os.killpg(self.popen.pid, signal.SIGKILL)
            else:
                self.popen.kill()

    def close(self) -> None:
        """Kill it, and wait until it has ended."""
        self.kill()
        self.popen.wait()
        self._listener.join(_ENDING_S)
        for stream in (self._calls, self._answers):
            with contextlib.suppress(OSError):  # it died in the middle of a message
                stream.close()

    def _listen(self) -> None:
        """Keep the end of what it prints."""
        assert self.popen.stderr is not None
        with self.popen.stderr as stream:
            while piece := os.read(stream.fileno(), _LAST_BYTES):
                self._printed = (self._printed + piece)[-_LAST_BYTES:]


def processors() -> int:
    """Return how many processors this process may use: of the machine, by its affinity, and by the quota of its container."""
    count = (
        len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    )
    with contextlib.suppress(OSError, ValueError):  # the quota "max" is no number
        quota, period = Path("/sys/fs/cgroup/cpu.max").read_text(encoding="ascii").split()
        count = min(count, math.ceil(int(quota) / int(period)))
    return count


def _name(function: Callable[..., Any]) -> str:
    return f"{function.__module__}:{function.__qualname__}"


def work() -> None:
    """Main of the process: call what the owner asks for, until its stdin ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    keep_freed()
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # keep what libraries print out of the answers
    calls: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    threading.Thread(target=_take_calls, args=(calls,), daemon=True).start()
    prepare, idle_s = sys.argv[1:]
    if prepare:
        pkgutil.resolve_name(prepare)()
    while True:
        try:
            call = calls.get(timeout=float(idle_s) if idle_s else None)
        except queue.Empty:
            os._exit(0)
        _answer(call, answers)


def _take_calls(calls: queue.SimpleQueue[dict[str, Any]]) -> None:
    with contextlib.suppress(EOFError):
        while True:
            calls.put(parcel.receive(sys.stdin.buffer, _ANY_LENGTH))
    os._exit(0)


def _answer(call: Mapping[str, Any], answers: IO[bytes]) -> None:
    set_limits(call["limits"])

    def progress(*values: Any) -> None:
        parcel.send(answers, {"progress": values})

    try:
        more = {"progress": progress} if call["progress"] else {}
        parcel.send(answers, {"done": pkgutil.resolve_name(call["name"])(*call["args"], **more)})
        return
    except MemoryError:
        said: dict[str, Any] = {"memory": True}
    except Exception as error:
        said = _told(error)
    parcel.send(answers, said)  # here, where the memory of the call is freed


def set_limits(limits: Limits) -> None:
    """Limit this process, if the system can: memory for data, file size, and from now on the processor's time.

    The last one ends a process whose owner is gone while a library holds the interpreter.
    """
    try:
        import resource
    except ImportError:  # Windows
        return
    most: dict[int, float | None] = {
        resource.RLIMIT_CORE: 0,
        resource.RLIMIT_DATA: limits.memory_bytes,
        resource.RLIMIT_FSIZE: limits.file_bytes,
    }
    if limits.seconds is not None:
        used = resource.getrusage(resource.RUSAGE_SELF)
        most[resource.RLIMIT_CPU] = used.ru_utime + used.ru_stime + limits.seconds * processors()
    # a file of code cut short would be loaded later
    sys.dont_write_bytecode |= limits.file_bytes is not None
    for what, wanted in most.items():
        _, hard = resource.getrlimit(what)
        if wanted is not None:
            resource.setrlimit(
                what,
                (math.ceil(wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)), hard),
            )


def _told(error: Exception) -> dict[str, Any]:
    """Return an error as plain values."""
    if isinstance(error, InputError):
        return {"input": vars(error)}
    if isinstance(error, VibridentError):
        return {"error": str(error)}
    return {"unexpected": "".join(traceback.format_exception(error))[-_LONGEST_TRACE:]}


def _error(said: Mapping[str, Any]) -> Exception:
    """Return the error that a process told."""
    if "input" in said:
        return InputError(**said["input"])
    if "error" in said:
        return NotConverged(said["error"])
    return WorkerError(said.get("unexpected", "an answer without an outcome"))
