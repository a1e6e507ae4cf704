"""Readers of foreign files see no other files and no network, where bubblewrap can see to it."""

from __future__ import annotations

import functools
import shutil
import subprocess
import sys
from pathlib import Path

_SYSTEM = ("/usr", "/bin", "/lib", "/lib32", "/lib64", "/etc/ld.so.cache", "/etc/localtime")
#: Namespaces of its own, no capabilities, an end with its owner.
_APART = ("--unshare-all", "--die-with-parent", "--cap-drop", "ALL", "--proc", "/proc", "--dev", "/dev")
_PROBE_S = 20.0


def confined(folder: Path, *, writable: bool = False) -> tuple[str, ...]:
    """What to put before the command of a process that may see this folder, if it can be confined.

    Where the system has it, ``nice`` stands before all: the server, which answers everybody, goes first.
    """
    first = ("nice",) if shutil.which("nice") else ()
    walls = (*_walls(), "--bind" if writable else "--ro-bind", str(folder), str(folder), "--") if _walls() else ()
    return (*first, *walls)


def possible() -> bool:
    """Whether processes are confined on this machine."""
    return bool(_walls())


@functools.cache
def _walls() -> tuple[str, ...]:
    program = shutil.which("bwrap")
    if program is None:
        return ()
    here = [sys.prefix, sys.base_prefix, *sys.path, str(Path(sys.executable).resolve().parent)]
    shown = dict.fromkeys((*_SYSTEM, *(path for path in here if path and Path(path).exists())))
    walls = (program, *_APART, "--tmpfs", "/tmp", *(word for path in shown for word in ("--ro-bind-try", path, path)))
    try:
        subprocess.run(
            [*walls, "--", sys.executable, "-c", "import vibrident"], check=True, capture_output=True, timeout=_PROBE_S
        )
    except (OSError, subprocess.SubprocessError):  # a container may forbid it
        return ()
    return walls
