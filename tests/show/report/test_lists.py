"""A list leaves out several entries or none: the line that counts a single one has room for it."""

from dataclasses import replace

import pytest
from tests.support.sample_results import table2

from vibrident.app.web import frame
from vibrident.result import Finding
from vibrident.show import certificate, document, findings


def with_files(number):
    made = table2()
    files = [{"file": f"{i}.csv", "sha256": f"{i:064x}"} for i in range(number)]
    return replace(made, provenance={**made.provenance, "files": files})


def files_in_certificate(number):
    (table,) = (
        b for part in certificate.certificate(with_files(number)).sections if part.name == "data" for b in part.blocks
    )
    return table.rows, table.notes


def files_in_report(number):
    (part,) = (part for part in document.report(with_files(number)).sections if part.name == "provenance")
    (table,) = part.blocks[-1].blocks
    return table.rows, table.notes


def rows_of_findings(number):
    found = tuple(Finding("drift", f"{i}.csv", None, 1e-7, {"sensitivity": 1e-6}, "It drifts.") for i in range(number))
    table = findings.table(replace(table2(), findings=found))
    return table.rows, table.notes[:-2]


def names_on_the_page(number):
    text = frame.list_names([f"{i}.csv" for i in range(number)])
    return text.split(" and ")[0].split(", "), text.split(" and ")[1:]


@pytest.mark.parametrize(
    ("shown", "most"),
    [(files_in_certificate, 30), (files_in_report, 100), (rows_of_findings, 30), (names_on_the_page, 12)],
)
def test_one_entry_is_never_left_out(shown, most):
    for number in (most, most + 1):
        rows, more = shown(number)
        assert len(rows) == number
        assert not more
    rows, (more, *_) = shown(most + 2)
    assert len(rows) == most
    assert "2 more" in more
