"""A sensor is stated per its own quantity, whatever its reference measured.

One simulated sensor is calibrated against references of acceleration, velocity and displacement.
Each document of these calibrations states the same numbers, in the same units.
"""

from __future__ import annotations

import functools
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from lxml import etree
from tests.support.certified import CERTIFICATE
from tests.support.shell import printed, run

from vibrident import identify
from vibrident.data.records import Calibration, ResponseTable
from vibrident.export import export
from vibrident.export.formats.csv import sheets
from vibrident.physics.models import parse
from vibrident.physics.simulation import SENSORS, one_third_octave, simulate
from vibrident.result import Result
from vibrident.show import certificate_tables, figures, tables
from vibrident.show.comparison import quantities
from vibrident.show.numbers import unit_of_sensitivity
from vibrident.show.points import reference_point
from vibrident.use.conformity import judge_requirements

REFERENCES = ("acceleration", "velocity", "displacement")
UNITS = {"paper": "V/(m/s^2)", "geophone": "V/(m/s)"}
NOISE = 1e-3  # of both channels, relative to their rms
FAR = 5.0  # standard uncertainties of a difference; beyond with a probability of 6e-7
DATES = {name: f"2025-11-0{number}" for number, name in enumerate(REFERENCES, 1)}
#: Met by both sensors over their whole bands in their own quantity, and in no other.
LIMITS = {"quantity": "sensitivity_deviation", "low": -95.0, "high": 190.0}
SPACE = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}


@functools.cache
def calibrated(sensor: str, reference: str) -> Result:
    """Return the result of a simulated calibration, with all that a certificate asks for."""
    seed = REFERENCES.index(reference)
    calibration = simulate(
        sensor,
        frequencies_hz=one_third_octave(*SENSORS[sensor].band_hz)[::2],
        samples=8000,
        quantity=reference,
        reference_noise=NOISE,
        response_noise=NOISE,
        seed=seed,
    )
    stated = CERTIFICATE | {"date_of_calibration": DATES[reference], "requirements": [LIMITS]}
    stated |= {"number": f"2025-0815-{reference}"}
    more = {"reference_standard_uncertainty": 2e-3, "certificate": stated}
    named = replace(calibration, sensor={"serial_number": "4711"}, **more)
    result = identify(named)
    covers = {"covers": ["noise", "gain", "phase"]}
    return replace(result, uncertainty=covers)


def require_same(one: np.ndarray, other: np.ndarray, u_one: np.ndarray, u_other: np.ndarray):
    """Check that numbers agree within the uncertainty of their difference."""
    assert np.all(np.abs(one - other) <= FAR * np.hypot(u_one, u_other))


@pytest.mark.parametrize("reference", REFERENCES[1:])
@pytest.mark.parametrize("sensor", UNITS)
@pytest.mark.quick("paper-displacement", "geophone-velocity")
def test_curve_and_points_are_those_of_an_acceleration_reference(sensor, reference):
    first, other = calibrated(sensor, "acceleration"), calibrated(sensor, reference)
    assert unit_of_sensitivity(first) == unit_of_sensitivity(other) == UNITS[sensor]
    for one, two in ((first.measured, other.measured), (first.response, other.response)):
        u_size = one.magnitude_uncertainty, two.magnitude_uncertainty
        require_same(one.magnitude, two.magnitude, *u_size)
        turned = (one.phase_deg - two.phase_deg + 180.0) % 360.0 - 180.0
        u_phase = one.phase_deg_uncertainty, two.phase_deg_uncertainty
        require_same(turned, 0.0 * turned, *u_phase)
    points = [reference_point(result)[0] for result in (first, other)]
    values = [np.array(point.magnitude) for point in points]
    require_same(*values, *(np.array(point.magnitude_uncertainty) for point in points))


@pytest.mark.parametrize("reference", REFERENCES)
@pytest.mark.parametrize("sensor", UNITS)
def test_the_curve_is_the_sensors_response_to_its_own_quantity(sensor, reference):
    result = calibrated(sensor, reference)
    sensor_now = result.to_sensor()
    curve = result.response
    model = sensor_now.frequency_response(curve.frequency_hz, result.quantity)
    assert np.allclose(np.abs(model), curve.magnitude, rtol=1e-9)
    assert np.allclose(np.exp(1j * np.deg2rad(curve.phase_deg)), model / np.abs(model), rtol=1e-9)


@pytest.mark.parametrize("sensor", UNITS)
def test_every_document_states_one_unit(sensor, tmp_path):
    stated = []
    for reference in REFERENCES:
        result = calibrated(sensor, reference)
        heads = [certificate_tables.measured(result), certificate_tables.sensitivity(result)]
        heads += [tables.measured(result)]
        columns = [column for table in heads for column in table.header]
        books = {name: list(header) for name, (header, _) in sheets(result).items()}
        panels = [panel.y.label for panel in figures.sensitivity(result).stacks[0].panels]
        (path,) = export(result, "dcc", tmp_path / reference, country="DE")
        root = etree.parse(str(path)).getroot()
        d_si = [unit.text for unit in root.iterfind(".//si:unitXMLList", SPACE)]
        about = [node.text for node in root.iterfind(".//dcc:list/dcc:description/*", SPACE)]
        about = [text for text in about if text.startswith("response per")]
        stated.append((columns, books, panels, d_si, about))
    assert stated[0] == stated[1] == stated[2]


@pytest.mark.parametrize("sensor", UNITS)
def test_conformity_is_that_of_the_sensor(sensor):
    rows = []
    for reference in REFERENCES:
        result = calibrated(sensor, reference)
        point, _ = reference_point(result)
        place = point.magnitude, point.magnitude_uncertainty
        (row,) = judge_requirements(result, point.frequency_hz, place)
        assert row.met
        rows.append(row)
    for row in rows[1:]:
        assert row.frequency_hz == pytest.approx(rows[0].frequency_hz, rel=1e-3)
        assert abs(row.value - rows[0].value) <= FAR * math.hypot(row.u, rows[0].u)


@pytest.mark.parametrize("sensor", UNITS)
def test_the_comparison_holds_the_sensitivity(sensor):
    results = [calibrated(sensor, reference) for reference in REFERENCES]
    first = quantities(results)[0]
    assert first.label.startswith("|S| at")
    assert None not in first.values


@pytest.mark.parametrize("sensor", UNITS)
def test_a_history_is_one_series(sensor, tmp_path):
    files = []
    for reference in REFERENCES:
        path = calibrated(sensor, reference).save(tmp_path / f"{reference}.json")
        files.append(str(path))
    store = str(tmp_path / "h.db")
    assert run("history", "add", *files, "--store", store).exit_code == 0
    shown = json.loads(printed("history", "show", "4711", "--store", store, "--format", "json"))
    assert shown["quantity"]["unit"] == UNITS[sensor]
    assert [row["series"] for row in shown["calibrations"]] == [1, 1, 1]
    assert all(abs(row["en"]["ordinary"]) <= 1.0 for row in shown["calibrations"][1:])


def in_the_reference(result: Result) -> dict:
    """Return the document as earlier versions wrote it: per the quantity of the reference."""
    document = json.loads(result.to_json())
    reference = document["reference"]["quantity"]
    own = document.pop("sensitivity_per")["quantity"]
    power = {"acceleration": 0, "velocity": 1, "displacement": 2}
    order = power[reference] - power[own]
    for part in (document["response"], document["measured"]):
        factor = (2j * np.pi * np.array(part["frequency_hz"])) ** order
        for name in ("magnitude", "magnitude_uncertainty", "magnitude_noise"):
            if name in part:
                part[name] = (np.array(part[name]) * np.abs(factor)).tolist()
        turned = np.exp(1j * np.deg2rad(part["phase_deg"])) * factor
        part["phase_deg"] = np.rad2deg(np.angle(turned)).tolist()
    budget = document["settings"]["point_budget"]
    size = (2.0 * np.pi * np.array(budget["frequency_hz"])) ** order
    for source in budget["sources"]:
        source["magnitude"] = (np.array(source["magnitude"]) * size).tolist()
    return document


@pytest.mark.parametrize("reference", REFERENCES)
@pytest.mark.parametrize("sensor", UNITS)
def test_a_result_of_an_earlier_version_is_read_per_the_sensors_own(sensor, reference):
    result = calibrated(sensor, reference)
    again = Result.from_dict(in_the_reference(result))
    assert again.sensitivity_per == result.sensitivity_per
    for name in ("response", "measured"):
        one, two = getattr(again, name), getattr(result, name)
        assert np.allclose(one.magnitude, two.magnitude, rtol=1e-12)
        assert np.allclose(one.magnitude_uncertainty, two.magnitude_uncertainty, rtol=1e-12)
        assert np.allclose(one.phase_deg, two.phase_deg, atol=1e-9)
    budgets = [each.settings["point_budget"]["sources"] for each in (again, result)]
    for one, two in zip(*budgets, strict=True):
        assert np.allclose(one["magnitude"], two["magnitude"], rtol=1e-12)
        assert one["phase_deg"] == two["phase_deg"]


@pytest.mark.parametrize("reference", REFERENCES)
def test_a_table_of_magnitudes_is_stated_per_the_sensors_own(reference):
    f = np.geomspace(10.0, 1000.0, 15)
    values = {"sensitivity": 0.1, "natural_frequency": 650.0, "damping_ratio": 0.2}
    response = parse("accelerometer").frequency_response(values, f, reference)
    table = ResponseTable(f, np.abs(response), None, 1e-3 * np.abs(response))
    result = identify(Calibration(table=table, quantity=reference))
    own = np.abs(parse("accelerometer").frequency_response(values, f))
    assert np.allclose(result.measured.magnitude, own, rtol=1e-12)
    assert np.isnan(result.measured.phase_deg).all()


def test_a_drive_stays_per_unit_of_drive():
    calibration = simulate("paper", frequencies_hz=(100.0, 300.0, 600.0), samples=2000, response_noise=1e-3)
    driven = replace(calibration, quantity="drive", reference_unit="A")
    result = identify(driven)
    assert result.sensitivity_per == {"quantity": "drive", "unit": "A"}
    assert unit_of_sensitivity(result) == "V/A"
