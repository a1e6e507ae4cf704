"""Calibration before any model: the records as a fit takes them, and doubts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from vibrident.base.binding import bound
from vibrident.base.brief import brief
from vibrident.base.errors import InputError
from vibrident.data.io import GivenCalibration, as_calibration, describe
from vibrident.data.records import Calibration
from vibrident.data.screening import ScreeningFinding, screen
from vibrident.data.screening.copies import notes_of_copies, without_copies

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame


@dataclass(frozen=True, eq=False)
class Inspection:
    """The data of a calibration and what is doubtful about them.

    Attributes:
        calibration: the calibration with clipped and spoilt samples marked as invalid; each record
            once, those without signal too.
        findings: doubts about the data, each with ``code`` and ``message``; empty for clean data.
        copies: a sentence for each record that holds the samples of another one and is left out.
    """

    calibration: Calibration
    findings: tuple[ScreeningFinding, ...]
    copies: tuple[str, ...]

    __repr__ = brief

    def to_dataframe(self) -> DataFrame:
        """Return a row a record, or one for the table; the names of columns state the units."""
        import pandas as pd

        return pd.DataFrame(describe(self.calibration))

    def plot(self) -> Figure:
        """Return excerpts of the records, or the table with U (k = 2), as a matplotlib figure."""
        return bound("plot_inspection")(self.calibration)


def inspect(calibration: GivenCalibration) -> Inspection:
    """Inspect the data of a calibration without fitting anything.

    Args:
        calibration: a calibration, or the path of a calibration file.

    Raises:
        InputError: the file or its data cannot be read.

    Examples:
        >>> import vibrident
        >>> record = vibrident.simulate(frequencies_hz=[160], samples=4000).records[0]
        >>> limit = 0.9 * record.response.max()
        >>> response = record.response.clip(-limit, limit)
        >>> clipped = vibrident.Calibration.from_arrays(
        ...     record.reference, response, record.sampling_rate_hz
        ... )
        >>> [finding.code for finding in vibrident.inspect(clipped).findings]
        ['clipped']
    """
    data = as_calibration(calibration)
    once = without_copies(data.records)
    copies = notes_of_copies((record.name, record.provenance.history) for record in once)
    findings = [
        ScreeningFinding(finding.code, finding.message)
        for record in once
        if record.optical is not None
        for finding in record.optical.findings
    ]
    records = []
    for record in once:
        try:
            (screened,), doubts = screen([record], data.units)
        except InputError as error:
            findings.append(ScreeningFinding("dead_channel", error.found))
            screened = record
        else:
            findings += doubts
        records.append(screened)
    return Inspection(replace(data, records=tuple(records)), tuple(findings), tuple(copies))
