"""Write the confirmed form as a calibration file, and pair files by their names."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from vibrident.app.web.language import phrase
from vibrident.base.errors import InputError
from vibrident.base.fields import Fields
from vibrident.data.io.calibration_file import CalibrationFile, checked_calibration
from vibrident.data.io.guess import Columns
from vibrident.data.io.keys import Key, keys_of
from vibrident.data.io.sections import CHANNEL_KEYS
from vibrident.data.io.toml_text import toml_document
from vibrident.data.records import USUAL_MODEL
from vibrident.physics.models import ADD_ONS

FORM_NAME = "columns and units"  # what messages call the form
SECTIONS = {n: key for n, key in keys_of(CalibrationFile).items() if n != "certificate"}
#: Section → its keys that a form can ask for.
ENTRIES = {
    name: [key for key in keys_of(section.section).values() if key.kind != "entries"]
    for name, section in SECTIONS.items()
    if section.section
}


def _form_keys() -> Iterator[tuple[str, Key]]:
    """Yield path and key of each entry; an interferometer's two columns are two."""
    for section, keys in ENTRIES.items():
        for key in keys:
            if key.kind == "columns":
                first = phrase("First signal: cos, or carrier")
                second = phrase("Second signal: sin")
                for position, title in enumerate((first, second)):
                    path = f"{section}.{key.name}.{position}"
                    yield path, replace(key, title=title, kind="column")
            else:
                yield f"{section}.{key.name}", key


KEYS = dict(_form_keys())
ROLES = [path for path, key in KEYS.items() if key.kind == "column"]
#: Keys that a calibration file need not have in every case, and has where they apply.
NEEDED = (
    *("reference.column", "response.column", "interferometer.carrier_hz"),
    *("uncertainty.standard_uncertainty", "uncertainty.frequency_hz"),
)
#: Lists of entries within the sections of channels.
KNOWN_RESPONSES = ("reference.known_response", "response.known_response")
#: What one entry of a list of sections is called.
ENTRY_NAMES = {
    "records": phrase("Record"),
    "uncertainty": phrase("Source"),
    "cmc": phrase("Capability"),
    "known_response": phrase("Known response"),
}


@dataclass
class Description:
    """The user's description of the data, starting with a guess.

    ``document`` is that of a calibration file, section → key → value, with what all [[records]]
    share and a list of entries of others. What does not apply is kept, and not written. Signals of
    an interferometer may be in files of their own, whose names have ``optical_part`` more than
    those of the response, as may a reference. ``different`` are entries of single files, with what
    differs there.
    """

    document: Fields = field(default_factory=dict)
    table: bool = False
    optical_part: str = ""
    different: list[Fields] = field(default_factory=list)

    def get(self, path: str) -> Any:
        """Return the value of ``section.key``, of a place in its list, or of a list of entries."""
        if "." not in path:
            return getattr(self, path, self.document.get(path))
        section, name, *position = path.split(".")
        value = self.document.get(section, {}).get(name)
        return _padded_pair(value)[int(position[0])] if position else value

    def set(self, path: str, value: Any) -> None:
        """Set the value of ``section.key``, of a place in its list, or of a list of entries."""
        section, *names = path.split(".")
        if not names:
            target = vars(self) if path in vars(self) else self.document
            target[path] = value
            return
        values = self.document.setdefault(section, {})
        if len(names) == 2:
            both = _padded_pair(values.get(names[0]))
            both[int(names[1])] = value
            value = both
        values[names[0]] = value

    @property
    def decay(self) -> bool:
        """Return whether the records are free decays, which need no reference."""
        return self.get("records.excitation") == "decay"

    @property
    def signals(self) -> tuple[int | str | None, ...]:
        """Return the columns of the photodetector signals; empty if the reference is a channel."""
        kind = self.get("interferometer.kind")
        if self.table or self.decay or not kind:
            return ()
        return tuple(
            _padded_pair(self.get("interferometer.columns"))[: 2 if kind == "quadrature" else 1]
        )

    @property
    def motion(self) -> tuple[int | str | None, ...]:
        """Return the columns of the reference: photodetector signals, or one of a channel."""
        return self.signals or (self.get("reference.column"),)

    def pairs(self, files: Sequence[str]) -> list[tuple[str, str | None]]:
        """Return the file of each record with that of its reference, None where it is the same.

        Files of known responses are no records.
        """
        response_files = {
            entry.get("file") for path in KNOWN_RESPONSES for entry in self.get(path) or ()
        }
        files = [file for file in files if file not in response_files]
        return pair_files(files, "" if self.table or self.decay else self.optical_part)

    def applies(self, path: str) -> bool:
        """Return whether a key, or a section, has a meaning beside the others."""
        records = not self.table
        light = self.get("interferometer.kind")
        drive = self.get("reference.quantity") == "drive"
        conditions = {
            "table": self.table,
            **dict.fromkeys(("interferometer", "sampling", "records"), records),
            **dict.fromkeys(("response.column", "response.full_scale"), records),
            **{f"reference.{key}": records and not light for key in CHANNEL_KEYS},
            "reference.column": records and not light and not self.decay,
            KNOWN_RESPONSES[0]: not light and not self.decay,
            "reference.quantity": self.table or not light,
            "reference.unit": drive if self.table else not light,
            **{key: bool(light) for key in KEYS if key.startswith("interferometer.")},
            "interferometer.columns.1": light == "quadrature",
            "interferometer.kind": True,
            "interferometer.carrier_hz": light == "heterodyne",
            "sampling.rate_hz": self.get("sampling.time_column") is None,
            "records.frequency_hz": self.get("records.excitation") == "sine",
        }
        return conditions.get(path.partition(".")[0], True) and conditions.get(path, True)


def _padded_pair(columns: Sequence[Any] | None) -> list[Any]:
    return [*(columns or ()), None, None][:2]


def describe_guess(guess: Columns, excitation: str = "sine", optical_part: str = "") -> Description:
    """Return a guess as a description; the excitation is guessed separately.

    The model is the usual one, with the add-ons that do nothing but delay where there is a phase.
    """
    document = {section: dict(keys) for section, keys in guess.document.items()}
    delays = [addon.name for addon in ADD_ONS.values() if addon.is_delay]
    phase = not guess.is_table or "phase" in document["table"]
    document["sensor"] = {"model": "+".join((USUAL_MODEL, *(delays if phase else ())))}
    document["records"]["excitation"] = excitation
    document["interferometer"]["wavelength_m"] = 632.991e-9  # of a helium-neon laser, in air
    return Description(document, guess.is_table, optical_part)


def calibration_text(description: Description, files: Sequence[str]) -> str:
    """Return the calibration file as text; InputError where a choice is missing or not allowed."""
    files = [file for pair in description.pairs(files) for file in pair if file is not None]
    if description.table and len(files) != 1:
        problem = "A tabulated response is one file."
        number = f"{len(files)} files"
        raise _form_error(problem, "one file", number, "remove the others")
    _require_distinct(description)
    document = dict(_document(description, files))
    checked_calibration(document, FORM_NAME)
    return toml_document(document)


def _document(description: Description, files: Sequence[str]) -> Iterator[tuple[str, Any]]:
    """Yield the sections that apply, with their keys."""
    for section, heading in SECTIONS.items():
        if not description.applies(section) or (
            section == "interferometer" and not description.signals
        ):
            continue
        if section == "table":
            yield section, {"file": files[0], **_filled(description, section)}
        elif section == "records":
            shared = _filled(description, section)
            pairs = description.pairs(files)
            entries_by_file = {
                file: {"file": file, "reference_file": o, **shared} for file, o in pairs
            }
            for entry in description.different:
                if "file" not in entry:
                    expected = "the file of a record that differs"
                    raise _form_error("“File” is empty.", expected, "nothing", "choose one")
                entries_by_file.get(entry["file"], {}).update(entry)
            yield section, [*entries_by_file.values()]
        elif heading.kind == "entries":
            entries = description.get(section) or []
            for number, entry in enumerate(entries, start=1):
                _require_filled(section, number, entry)
            yield section, entries
        elif filled := {**_filled(description, section), **_known_responses(description, section)}:
            yield section, filled


def _known_responses(description: Description, section: str) -> Fields:
    """Return the known responses of a channel; refused where one says nothing."""
    path = f"{section}.known_response"
    entries = description.get(path) if path in KNOWN_RESPONSES else None
    if not entries or not description.applies(path):
        return {}
    for number, entry in enumerate(entries, start=1):
        if not {"file", "highpass_hz", "lowpass_hz"} & {*entry}:
            label = phrase("File")
            entry_name = ENTRY_NAMES["known_response"].lower()
            problem = f"“{label}” of {entry_name} {number} is empty."
            raise _form_error(problem, "a file, or a corner", "nothing", "fill it in")
    return {"known_response": entries}


def _require_filled(section: str, number: int, entry: Fields) -> None:
    """Refuse an entry that lacks what it must have, in the words of the form."""
    for key in ENTRIES[section]:
        path = f"{section}.{key.name}"
        if path == "uncertainty.standard_uncertainty" and entry.get("table"):
            continue
        if entry.get(key.name) is None and (key.default is ... or path in NEEDED):
            row = {sibling.name: sibling.default for sibling in ENTRIES[section]} | entry
            if key.applies(row):
                problem = f"“{key.label}” of {ENTRY_NAMES[section].lower()} {number} is empty."
                raise _form_error(problem, key.expected, "nothing", "fill it in, or remove the row")


def _filled(description: Description, section: str) -> Fields:
    """Return the keys of a section that apply; refused where one is empty that may not be."""
    filled = {}
    for key in ENTRIES[section]:
        name = key.name
        path = f"{section}.{key.name}"
        if key.level == "expert" or not description.applies(path):
            continue
        value = description.get(path) if name != "columns" else [*description.signals]
        if value in (None, "") or (isinstance(value, list) and None in value):
            cleared = name in description.document.get(section, {}) and key.default
            if key.default is ... or cleared or path in NEEDED:
                raise _form_error(f"“{key.label}” is empty.", key.expected, "nothing", "fill it in")
            continue
        filled[name] = value
    return filled


def _require_distinct(description: Description) -> None:
    motion = description.motion
    response = description.get("response.column")
    if description.table or description.decay:
        return
    if response is not None and response in motion and not description.optical_part:
        text = "Reference and response are the same column."
        raise _form_error(text, "two columns", repr(response), "choose another for one of the two")
    if len(motion) == 2 and motion[0] is not None and motion[0] == motion[1]:
        text = "Both photodetector signals are the same column."
        raise _form_error(text, "two columns", repr(motion[0]), "choose another for one of the two")


def _form_error(problem: str, expected: str, actual: str, remedy: str) -> InputError:
    return InputError(problem, expected=expected, found=actual, where=FORM_NAME, remedy=remedy)


def find_optical_part(files: Sequence[str]) -> str:
    """Return what the names of optical files add to the response's, such as ``_optical``.

    Half of the files must have it, and each of them a partner without it; empty for no pairs.
    """
    if len(files) < 2 or len(files) % 2:
        return ""
    first, *other_names = (Path(file).stem for file in files)
    candidates = (_inserted_part(*sorted((first, name), key=len)) for name in other_names)
    return next(
        (part for part in candidates if part and _partners(files, part) is not None),
        "",
    )


def pair_files(files: Sequence[str], optical_part: str) -> list[tuple[str, str | None]]:
    """Return each file of a response with the file of its optical signals, None if the same."""
    if not optical_part:
        return [(file, None) for file in files]
    partners = _partners(files, optical_part)
    if partners is None:
        optical = [file for file in files if optical_part in Path(file).stem]
        raise InputError(
            "The files with optical signals do not match those with responses.",
            expected=f"for each file a second one, with {optical_part!r} more in its name",
            found=f"{len(files) - len(optical)} files without it, {len(optical)} with it",
            where=FORM_NAME,
            remedy="add or rename files, or correct that part of the names; "
            "leave it empty for signals in one file",
        )
    return list(partners)


def _partners(files: Sequence[str], optical_part: str) -> list[tuple[str, str | None]] | None:
    """Return pairs in the order of the responses; None if a file is left over."""
    marked = [file for file in files if optical_part in Path(file).stem]
    optical = {Path(file).stem.replace(optical_part, "", 1): file for file in marked}
    responses = [file for file in files if file not in marked]
    if len(optical) != len(responses) or len(files) != 2 * len(responses) or not responses:
        return None
    pairs = [(file, optical.get(Path(file).stem)) for file in responses]
    return pairs if all(partner is not None for _, partner in pairs) else None


def _inserted_part(short: str, long: str) -> str:
    """Return what a name adds to another in one place; empty if they differ otherwise."""
    pairs = enumerate(zip(short, long, strict=False))
    same = next((i for i, (a, b) in pairs if a != b), len(short))
    more = len(long) - len(short)
    return long[same : same + more] if long[:same] + long[same + more :] == short else ""
