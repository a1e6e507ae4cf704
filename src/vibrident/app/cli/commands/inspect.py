"""``vibrident inspect``: show the content of the files, before any model."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from vibrident.app.cli import options
from vibrident.app.cli.console import note, output_console, print_line, show_rows, show_written
from vibrident.app.cli.options import option
from vibrident.app.workflow.folder import written_whole
from vibrident.base.escaping import terminal as printable
from vibrident.base.fields import Fields, NamedTexts

if TYPE_CHECKING:
    from vibrident.data.interferometer.summary import OpticalSummary
    from vibrident.data.records import Calibration
    from vibrident.data.screening import ScreeningFinding

MAX_STEPS = 8  # of the reading that are shown
_CHECKSUM = re.compile(r",? SHA-256 [0-9a-f]{64}")
_FILE = re.compile(rf"{_CHECKSUM.pattern}|[^\s,]+\.[A-Za-z]\w*")


def inspect(
    calibration: Path = options.CALIBRATION_FILE,
    folder: Path | None = option(
        "--out", "DIR", "Folder for the picture.", default="./CAL.inspect.png"
    ),
) -> None:
    """Show calibration data: their description, findings, and a picture."""
    from vibrident.data.io import read_guarded
    from vibrident.physics.models import model_of
    from vibrident.use.inspection import inspect as inspect_data

    data = read_guarded(calibration)
    model_of(data)  # a name that `identify` would refuse
    inspection = inspect_data(data)
    screened = inspection.calibration
    for sentence in inspection.copies:
        note(sentence)
    name = f"{calibration.stem}.inspect.png" if folder is None else "inspect.png"
    with written_whole(folder or Path()) as output:
        from vibrident.show import plots

        plots.save(plots.inspection(screened), output.path / name)
        if any(record.optical is not None for record in screened.records):
            plots.save(
                plots.light(screened), output.path / name.replace("inspect.png", "light.png")
            )
    _show(screened, inspection.findings, output.files)


def _show(
    calibration: Calibration, findings: Sequence[ScreeningFinding], files: list[Path]
) -> None:
    from rich.padding import Padding
    from rich.text import Text

    from vibrident.data import io
    from vibrident.show import words

    console = output_console()
    for label, text in _describe_reading(calibration).items():
        console.print(
            Text.assemble((f"{label + ':':<11}", "bold"), printable(text)), soft_wrap=True
        )
    console.print()
    show_rows(
        _drop_empty_columns(io.describe(calibration)),
        "Tabulated response" if calibration.table else "Records",
    )
    if light := [
        _light_row(record.name, record.optical) for record in calibration.records if record.optical
    ]:
        show_rows(light, "Interferometer")
    if response_rows := _response_rows(calibration):
        show_rows(response_rows, "Known responses")
    if steps := _steps(calibration):
        console.print(Text("Read as:", "bold"))
        for step in steps:
            console.print(Padding(Text(printable(step)), (0, 0, 0, 2), expand=False))
        console.print()
    for code in dict.fromkeys(finding.code for finding in findings):
        console.print(
            Text.assemble(
                ("Finding: ", "bold yellow"), (words.explain(code).title, "bold"), f" ({code})"
            )
        )
        for finding in findings:
            if finding.code == code:
                console.print(Padding(Text(printable(finding.message)), (0, 0, 0, 2), expand=False))
    if not findings and calibration.records:
        print_line(
            "No findings: no clipped samples, no channel without signal, no sign of aliasing."
        )
    show_written(files)


def _steps(calibration: Calibration) -> list[str]:
    """Return what was done with the files: units, clocks and cuts; the most usual steps first."""
    sources = [record.provenance for record in calibration.records]
    if calibration.table is not None:
        sources = [calibration.table.provenance]
    steps = [step for source in sources for step in source.history]
    counts = Counter(map(_without_files, steps)).most_common(MAX_STEPS + 1)
    examples = {_without_files(step): step for step in reversed(steps)}
    same = Counter(steps)
    lines = [
        _step_line(examples[kind], same[examples[kind]], number, len(sources))
        for kind, number in counts[:MAX_STEPS]
    ]
    return (
        [*lines, "further steps: provenance in result.json"] if len(counts) > MAX_STEPS else lines
    )


def _without_files(step: str) -> str:
    """Return a step without the names and checksums of its files, which tell no other step."""
    return _FILE.sub("", step)


def _step_line(step: str, equal: int, alike: int, sources: int) -> str:
    """Return a step with the number of records that it is of.

    ``equal``: the same step; ``alike``: that of other files, too; ``sources``: of all records.
    """
    from vibrident.show.views import count

    if equal < alike:
        return f"{_CHECKSUM.sub('', step)}, and {alike - equal} more of other files"
    return step if equal == sources else f"{step} ({count(equal, 'record')})"


def _describe_reading(calibration: Calibration) -> NamedTexts:
    from vibrident.base.amounts import pretty
    from vibrident.show.numbers import sensor_name

    u = calibration.reference_standard_uncertainty
    reference = f"{calibration.quantity} in {pretty(calibration.reference_unit)}"
    return {
        "File": calibration.source,
        "Sensor": sensor_name(calibration.sensor) or "not named",
        "Model": calibration.model,
        "Reference": f"{reference}, relative standard uncertainty {u:.3g}" if u else reference,
        "Response": f"in {pretty(calibration.response_unit)}",
    }


def _response_rows(calibration: Calibration) -> list[Fields]:
    """Return the known response of each channel: its band, and its size and u in the middle."""
    import numpy as np

    rows = []
    for channel, chain in calibration.known_responses.items():
        low, high = chain.band_hz
        top = 0.5 * max((record.sampling_rate_hz for record in calibration.records), default=1e4)
        middle = np.sqrt(max(low, 1e-4 * min(high, top)) * min(high, top))
        value = complex(chain.value(middle))
        size, turn = np.sqrt(np.diag(chain.covariance([middle])))
        per = calibration.reference_unit if channel == "reference" else calibration.response_unit
        rows.append(
            {
                "channel": channel,
                "stated by": chain.source,
                "from / Hz": low,
                "to / Hz": high,
                "at / Hz": float(f"{middle:.2g}"),
                "magnitude": f"{abs(value):.5g} {chain.channel_unit}/({per})",
                "phase / °": float(np.rad2deg(np.angle(value))),
                "u / %": 100.0 * float(size),
                "u of phase / °": float(np.rad2deg(turn)),
            }
        )
    return rows


def _light_row(name: str, optical: OpticalSummary) -> Fields:
    """Return the quality of an interferometer's signals."""
    row: Fields = {
        "record": name,
        "fringes": optical.fringes,
        "half fringes counted": optical.counted or None,
        "by phase": optical.by_phase or None,
        "fastest / rad": optical.fastest_rad,
        "gaps": optical.gaps,
        "left out / %": 100.0 * optical.left_out,
        "phase noise / rad": optical.phase_noise_rad,
        "noise / (m/√Hz)": optical.noise_density_m,
    }
    if optical.carrier_hz is not None:
        return {**row, "carrier / Hz": optical.carrier_hz}
    first, second = optical.ellipse.amplitudes
    offsets = [
        float(centre) / size
        for centre, size in zip(optical.ellipse.centre, (first, second), strict=True)
    ]
    row |= {"offsets": ", ".join(f"{offset:.4f}" for offset in offsets), "ratio": second / first}
    row |= {"quadrature / rad": optical.ellipse.quadrature_error_rad, "ellipse": optical.origin}
    if optical.cyclic:
        row["cyclic error / rad"] = ", ".join(f"{size:.1g}" for _, size, _ in optical.cyclic)
    return row


def _drop_empty_columns(rows: list[Fields]) -> list[Fields]:
    """Return rows without empty columns; one or two rows become properties line by line."""
    silent = [
        key for key in ("frequency / Hz", "left out") if not any(row.get(key) for row in rows)
    ]
    telling = [{key: value for key, value in row.items() if key not in silent} for row in rows]
    if len(telling) > 2:
        return telling
    columns = dict(
        zip(("value",) if len(telling) == 1 else ("first", "second"), telling, strict=True)
    )
    properties = dict.fromkeys(key for row in telling for key in row)
    return [
        {"property": key, **{name: row.get(key) for name, row in columns.items()}}
        for key in properties
    ]
