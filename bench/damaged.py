"""``python -m bench.damaged``: a thousand damaged files and bombs, read by every reader.

python -m bench.damaged --jobs 1            all of them; stops and resumes at will
python -m bench.damaged --only x.h5 --trial  some, to look at

The page is studies/damaged.md; see :mod:`bench.study`.
"""

from __future__ import annotations

import sys
from collections import Counter, defaultdict
from typing import Any

from bench.damaged_bombs import GROUPS
from bench.damaged_files import DAMAGES
from bench.damaged_runs import CELLS, FILES, MAX_MEMORY_BYTES, block
from bench.study import Study
from vibrident.show.media import markdown

HEAD = """# A thousand damaged files

Written by `python -m bench.damaged`; do not edit. Code of commit {commit}.

{count} files: whole ones of every format, each cut, with bits flipped, in another order, in another
encoding or with extreme numbers in place of some, and {bombs} bombs: small files that declare or
unpack far more than a machine holds, or have cyclic links. Each is given to `vibrident inspect` (a
result to `vibrident report`). Required: exit 0 or 2, no traceback, at most {memory:.0f} MB, and no
file outside `--out`.

{verdict}

{table}

Each cell: read, refused, anything else. A file that was read may have lost its tail, or have values
changed that its format does not protect.
"""


def table(lines: list[dict[str, Any]], commit: str) -> str:
    """Return the page as Markdown."""
    runs_of: dict[tuple[str, str], list[dict[str, Any]]] = defaultdict(list)
    for line in lines:
        file, damage = line["cell"].split("/")
        runs_of[file, damage] += line["runs"]
    runs = [run for cell_runs in runs_of.values() for run in cell_runs]
    wrong = [run for run in runs if run["outcome"] not in ("read", "refused")]
    peak = max((run["peak_bytes"] for run in runs), default=0)
    rescued = Counter(
        run["first"].split(" ")[0]
        for run in runs
        if run.get("first", "as a command") != "as a command"
    )
    verdict = (
        f"{len(runs) - len(wrong)} of {len(runs)} met; most memory {peak / 1e6:.0f} MB.\nWithout "
        f"the process that the command line reads binary files in, {sum(rescued.values())} of "
        "them would not have been"
        + (
            f" ({', '.join(f'{count} {name}' for name, count in rescued.items())})."
            if rescued
            else "."
        )
    )
    rows = [
        (f"`{file}`", *(_counts(runs_of[file, damage]) for damage in DAMAGES)) for file in FILES
    ]
    bombs = [run for group in GROUPS for run in runs_of[group, "bombs"]]
    rows.append(("bombs", _counts(bombs), *("" for _ in range(1, len(DAMAGES)))))
    page = HEAD.format(
        commit=commit,
        count=len(runs),
        bombs=len(bombs),
        memory=MAX_MEMORY_BYTES / 1e6,
        verdict=verdict,
        table=markdown.table(("file", *DAMAGES), rows, range(1, 1 + len(DAMAGES))),
    )
    return page + "".join(f"\n- `{run['outcome']}`: {run['said'][-300:]!r}" for run in wrong)


def _counts(runs: list[dict[str, Any]]) -> str:
    """Read, refused, and anything else."""
    counts = Counter(run["outcome"] for run in runs)
    neither = sum(counts.values()) - counts["read"] - counts["refused"]
    return f"{counts['read']}, {counts['refused']}, {neither}"


STUDY = Study("damaged", __doc__.splitlines()[0], 15, CELLS, block, table)

if __name__ == "__main__":
    sys.exit(STUDY.main())
