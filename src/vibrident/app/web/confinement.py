"""Keep readers of foreign files from other files and the network, where bubblewrap is available."""

from __future__ import annotations

import functools
import shutil
import subprocess
import sys
from pathlib import Path

_SYSTEM_PATHS = ("/usr", "/bin", "/lib", "/lib32", "/lib64", "/etc/ld.so.cache", "/etc/localtime")
#: Namespaces of its own, no capabilities, an end with its owner.
_ISOLATION = (
    "--unshare-all",
    "--die-with-parent",
    "--cap-drop",
    "ALL",
    "--proc",
    "/proc",
    "--dev",
    "/dev",
)
_PROBE_S = 20.0


def confinement_command(folder: Path, *, writable: bool = False) -> tuple[str, ...]:
    """Return the command that confines a process to a folder; empty where that is impossible.

    Where the system has it, ``nice`` comes first: the server, which answers everybody, has
    priority.
    """
    first = ("nice",) if shutil.which("nice") else ()
    sandbox = (
        (*_sandbox_command(), "--bind" if writable else "--ro-bind", str(folder), str(folder), "--")
        if _sandbox_command()
        else ()
    )
    return (*first, *sandbox)


def can_confine() -> bool:
    """Return whether processes are confined on this machine."""
    return bool(_sandbox_command())


@functools.cache
def _sandbox_command() -> tuple[str, ...]:
    program = shutil.which("bwrap")
    if program is None:
        return ()
    interpreter = str(Path(sys.executable).resolve().parent)
    python_paths = [sys.prefix, sys.base_prefix, *sys.path, interpreter]
    visible = dict.fromkeys(
        (*_SYSTEM_PATHS, *(path for path in python_paths if path and Path(path).exists()))
    )
    command = (
        program,
        *_ISOLATION,
        "--tmpfs",
        "/tmp",
        *(word for path in visible for word in ("--ro-bind-try", path, path)),
    )
    try:
        subprocess.run(
            [*command, "--", sys.executable, "-c", "import vibrident"],
            check=True,
            capture_output=True,
            timeout=_PROBE_S,
        )
    except (OSError, subprocess.SubprocessError):  # a container may forbid it
        return ()
    return command
