"""Guess what the columns of uploaded files mean. Each function runs in a separate process."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from vibrident.app.web.form.description import ROLES, describe_guess, find_optical_part, pair_files
from vibrident.app.web.sandboxed import draw_chart
from vibrident.base.errors import VibridentError
from vibrident.data.io.guess import Columns, guess_columns
from vibrident.data.io.reader import open_columns
from vibrident.fit.response.motion import kind_of_motion

_MAX_EXAMINED_FILES = 5  # most files whose motion is examined, spread over all of them


MAX_OFFERED_COLUMNS = 60  # most columns offered in lists; otherwise names are typed


_MAX_LABEL_LENGTH = 200


@dataclass(frozen=True)
class ColumnGuess:
    """The possible meaning of the columns."""

    columns: Columns  # by their names; at most what can be shown
    excitation: str | None  # by the file's name or the motion; None if undetermined
    all_columns: int  # number of the file's columns
    chart: bytes  # the guessed columns, as ``chart`` draws them; empty if that fails
    # what names of files with optical signals have beyond the others'; empty if there are none
    optical_part: str = ""


def prepare() -> None:
    """Load the libraries of the sandboxed functions while the process waits.

    The imports of this module do it.
    """


def guess(folder: Path, files: Sequence[str], code: str = "en") -> ColumnGuess:
    """Guess the columns from the first file, and the excitation from several."""
    name_part = find_optical_part(files)
    columns, apart = _guess_columns(folder, pair_files(files, name_part))
    name_part = name_part if apart else ""
    try:
        excitation = likely_excitation(
            columns, folder, [file for file, _ in pair_files(files, name_part)]
        )
    except MemoryError:  # the files may be too large for a guess
        excitation = None
    try:
        drawn = draw_chart(
            describe_guess(columns, excitation or "sine", name_part), folder, files, code
        )
    except (VibridentError, MemoryError):  # reported when the page requests the chart
        drawn = b""
    return ColumnGuess(
        _offered_columns(columns), excitation, len(columns.columns), drawn, name_part
    )


def _guess_columns(folder: Path, pairs: Sequence[tuple[str, str | None]]) -> tuple[Columns, bool]:
    """Return the columns of the first record, and whether another file has its optical signals."""
    response_file, reference_file = pairs[0]
    columns = guess_columns(folder / response_file)
    light = columns if reference_file is None else guess_columns(folder / reference_file)
    signals = light.document["interferometer"]
    if light is columns or columns.document["interferometer"] or not signals:
        return columns, False
    more = [
        pair
        for pair in zip(light.columns, light.labels, strict=True)
        if pair[0] not in columns.columns
    ]
    names, labels = (
        (tuple(column_group) for column_group in zip(*more, strict=True)) if more else ((), ())
    )
    both = {"columns": (*columns.columns, *names), "labels": (*columns.labels, *labels)}
    return replace(columns, **both, document={**columns.document, "interferometer": signals}), True


def likely_excitation(columns: Columns, folder: Path, files: Sequence[str]) -> str:
    """Return the excitation of most files; a sine if undetermined."""
    from_file = columns.document["records"].get("excitation")
    # raw light turns round at any motion
    motion_in = columns.document[
        "response" if columns.document["interferometer"] else "reference"
    ].get("column")
    if from_file is not None or columns.is_table or motion_in is None:
        return from_file or "sine"
    motions: Counter[str] = Counter()
    for file in files[:: -(-len(files) // _MAX_EXAMINED_FILES)]:
        try:
            source = open_columns(folder / file)
            (motion,) = source.load([source.position_of(motion_in, "columns and units")])
        except VibridentError:  # reported when the columns are drawn or confirmed
            continue
        motions[kind_of_motion(motion)] += 1
    return motions.most_common(1)[0][0] if motions else "sine"


def _offered_columns(columns: Columns) -> Columns:
    """Return the columns to offer: the first ones and the guessed ones."""
    description = describe_guess(columns)
    guessed = [description.get(role) for role in ROLES]
    pairs = list(zip(columns.columns, columns.labels, strict=True))
    choices = [
        pair for i, pair in enumerate(pairs) if i < MAX_OFFERED_COLUMNS or pair[0] in guessed
    ]
    names, labels = zip(*choices, strict=True)
    return replace(
        columns, columns=names, labels=tuple(label[:_MAX_LABEL_LENGTH] for label in labels)
    )
