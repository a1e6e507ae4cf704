"""The kind of motion in the files, if their names do not state it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from vibrident.errors import VibridentError
from vibrident.io.guess import Columns
from vibrident.io.readers import open_columns
from vibrident.measure.motion import kind_of_motion

#: Most files examined, spread over all of them.
MOST_FILES = 5


def likely_excitation(guess: Columns, folder: Path, files: Sequence[str]) -> str:
    """The excitation of most files; a sine if undetermined."""
    motion_in = guess.response if guess.detectors else guess.reference  # raw light turns round at any motion
    if guess.excitation is not None or guess.is_table or motion_in is None:
        return guess.excitation or "sine"
    seen: Counter[str] = Counter()
    for file in files[:: -(-len(files) // MOST_FILES)]:
        try:
            source = open_columns(folder / file)
            (motion,) = source.load([source.position_of(motion_in, "columns and units")])
        except VibridentError:  # reported when the columns are drawn or confirmed
            continue
        seen[kind_of_motion(motion)] += 1
    return seen.most_common(1)[0][0] if seen else "sine"
