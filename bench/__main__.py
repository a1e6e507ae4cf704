"""``python -m bench``: run the benchmarks, print one table, keep the figures.

python -m bench                              everything (`make bench`)
python -m bench --only speed cold            some sections
python -m bench --quick                      a short trial; nothing is published
"""

from __future__ import annotations

import argparse
import importlib
import sys
from dataclasses import replace

from rich.console import Console

from bench.figures import STDERR, Options
from bench.publish import circumstances, keep, show

#: Name of a section → the module whose ``measure`` takes it.
SECTIONS = {
    "accuracy": "bench.accuracy",
    "statistics": "bench.scatter",
    "speed": "bench.speed",
    "cold": "bench.cold",
    "memory": "bench.memory",
    "unsuited": "bench.unsuited",
    "waits": "bench.waits",
    "tracking": "bench.tracking",
    "peers": "bench.against",
    "fit_som": "bench.som",
    "track_peers": "bench.track_peers",
}


def main(arguments: list[str] | None = None) -> int:
    """Run the chosen sections; returns 0."""
    options, chosen = _parsed(arguments)
    common = circumstances()
    sections = []
    for name in chosen:
        section = importlib.import_module(SECTIONS[name]).measure(options)
        sections.append(replace(section, conditions={**common, **section.conditions}))
    wide = Console(width=None if sys.stdout.isatty() else 160)
    show(sections, wide)
    path = keep(sections, tuple(SECTIONS), trial=options.quick)
    STDERR.print(f"{common['machine']}; commit {common['commit']}\nwritten: {path}", soft_wrap=True)
    return 0


def _parsed(arguments: list[str] | None) -> tuple[Options, list[str]]:
    defaults = Options()
    parser = argparse.ArgumentParser(prog="python -m bench", description="Benchmarks of vibrident.")
    parser.add_argument(
        "--only", nargs="+", choices=tuple(SECTIONS), help="sections to run (default: all)"
    )
    parser.add_argument(
        "--runs", type=int, default=defaults.runs, help="seeded runs of the statistics"
    )
    parser.add_argument(
        "--jobs", type=int, default=defaults.jobs, help="processes for the statistics"
    )
    parser.add_argument(
        "--pairs", type=int, default=defaults.pairs, help="pairs of every ratio of times"
    )
    parser.add_argument("--quick", action="store_true", help="a short trial; nothing is published")
    arguments_ = parser.parse_args(arguments)
    if min(arguments_.runs, 2) < 2 or arguments_.jobs < 1 or arguments_.pairs < 1:
        parser.error("expected --runs from 2, --jobs and --pairs from 1")
    options = Options(arguments_.runs, arguments_.jobs, arguments_.pairs, arguments_.quick)
    return options, [
        name for name in SECTIONS if arguments_.only is None or name in arguments_.only
    ]


if __name__ == "__main__":
    sys.exit(main())
