"""Write the files of a tracking session: rows as they come, and a checkpoint after every chunk.

The checkpoint holds the state, the alarms, the place in the source and the length of ``track.csv``.
It is replaced in one step; what was written after it is cut off when the session is taken up again.
So a process that is killed loses the chunk that was open, and says nothing twice.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from vibrident.app.workflow.folder import write_json
from vibrident.base.errors import InputError
from vibrident.base.fields import Fields, GivenFields
from vibrident.base.files import atomic_write, unwritable

if TYPE_CHECKING:
    from vibrident.use.tracking.session import TrackingSession
    from vibrident.use.tracking.state import TrackedEstimate

CHECKPOINT = "track.state"
RECORDS = "calibration-records"  # the source where none is given


class TrackingFiles:
    """``track.csv``, ``track.json`` and the checkpoint of the session that ``key`` identifies."""

    def __init__(self, folder: Path, session: TrackingSession, key: GivenFields) -> None:
        self._folder = folder
        self._session = session
        self._key = hashlib.sha256(
            json.dumps(key, sort_keys=True, default=str).encode()
        ).hexdigest()
        names = session.tracker.network.model.parameter_names
        pairs = [column for name in names for column in (name, f"{name}_u")]
        self.columns = ["time_s", *pairs, "innovation", "excited"]

    def begin(self, *, resumable: bool) -> int:
        """Open ``track.csv``, anew or at its checkpoint; return the place in the source."""
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            position = self._resumed() if resumable and (self._folder / CHECKPOINT).exists() else 0
            self.rows = (self._folder / "track.csv").open(
                "a" if position else "w", encoding="utf-8", newline="\n"
            )
            if not position:
                (self._folder / CHECKPOINT).unlink(missing_ok=True)
                self.rows.write(",".join(self.columns) + "\n")
        except OSError as error:
            raise unwritable(error, self._folder) from error
        return position

    def _resumed(self) -> int:
        from vibrident.use.tracking.causes import Cause
        from vibrident.use.tracking.session import Trouble
        from vibrident.use.tracking.state import Alarm

        head, _, state = (self._folder / CHECKPOINT).read_bytes().partition(b"\n")
        try:
            saved = json.loads(head)
            same = saved["key"] == self._key
        except (ValueError, KeyError, TypeError):
            same = False
        if not same:
            raise InputError(
                "The folder holds a session of another sensor, source or setting.",
                expected="a new folder, or the same result, calibration file and options as before",
                found=CHECKPOINT,
                where=str(self._folder),
                remedy="give another ⟦track.folder⟧, or remove that file to begin anew",
            )
        session = self._session
        session.tracker.state.restore(state)
        session.samples = saved["samples"]
        session.samples_to_row = saved["left"]
        session.started = True
        session.troubles.extend(Trouble(**trouble) for trouble in saved["troubles"])
        session.alarms.extend(Alarm(**alarm) for alarm in saved["alarms"])
        session.waiting_alarms.extend(Alarm(**row) for row in saved["held"])
        session.cause = Cause(**saved["cause"])
        os.truncate(self._folder / "track.csv", saved["csv_bytes"])
        return int(saved["position"])

    def write(self, rows: Sequence[TrackedEstimate]) -> None:
        """Add rows."""
        for row in rows:
            pairs = [(row.values[name], row.uncertainty[name]) for name in row.values]
            numbers = [row.time_s, *(number for pair in pairs for number in pair), row.innovation]
            cells = ["" if number != number else repr(float(number)) for number in numbers]
            self.rows.write(",".join([*cells, " ".join(row.excited)]) + "\n")
        self.rows.flush()

    def keep(self, position: int) -> None:
        """Write a checkpoint: everything up to here is done."""
        session = self._session
        head = {
            "key": self._key,
            "position": position,
            "csv_bytes": self.rows.tell(),
            "samples": session.samples,
            "left": session.samples_to_row,
            "troubles": [vars(trouble) for trouble in session.troubles],
            "alarms": [vars(alarm) for alarm in session.alarms],
            "held": [vars(alarm) for alarm in session.waiting_alarms],
            "cause": vars(session.cause),
        }
        with atomic_write(self._folder / CHECKPOINT) as partial:
            partial.write_bytes(json.dumps(head).encode() + b"\n" + session.tracker.state.save())

    def end(self) -> Fields:
        """Write the last row and ``track.json``; return the content of the latter."""
        self.write(self._session.finish())
        self.rows.close()
        document = self._session.document()
        write_json(self._folder / "track.json", document)
        return document
