"""Run a command and print its wall time, peak memory and exit status as one line of JSON.

    python -I -S child.py COMMAND [ARGUMENT …]

A small process: on Linux a child's peak memory includes its parent's at the fork, so a benchmark
that holds JAX would measure its own.
"""

import json
import os
import resource
import sys
import time


def main() -> None:
    """Run the command; its output is dropped, its errors are passed on."""
    begin = time.perf_counter()
    pid = os.posix_spawnp(
        sys.argv[1],
        sys.argv[1:],
        os.environ,
        file_actions=[(os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)],
    )
    _, status, usage = os.wait4(pid, 0)
    wall = time.perf_counter() - begin
    launcher = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    unit = 1 if sys.platform == "darwin" else 1024
    figures = {
        "wall_s": wall,
        "peak_bytes": usage.ru_maxrss * unit,
        "launcher_bytes": launcher * unit,
    }
    print(json.dumps({**figures, "status": os.waitstatus_to_exitcode(status)}))


if __name__ == "__main__":
    main()
