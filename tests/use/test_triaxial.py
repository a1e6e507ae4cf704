"""The sensitivity matrix: what was simulated, by one motion at a time or three at once, from arrays and from files."""

import json
from dataclasses import replace

import numpy as np
import pytest
from bench.laboratory import MATRIX, OUTPUTS, axes_calibration, coverage, true_matrix
from tests.support import shell

from vibrident import KnownResponse
from vibrident.base.errors import InputError
from vibrident.data.io import read
from vibrident.data.io.axes_file import AxesCalibration, read_axes
from vibrident.data.records import SystematicEffect
from vibrident.use.triaxial import sensitivity_matrix

HEAD = """
[sampling]
rate_hz = 8192.0
[[response]]
column = "vx"
axis = "x"
[[response]]
column = "vy"
axis = "y"
[[response]]
column = "vz"
axis = "z"
"""


def made(motions=False, **more):
    return sensitivity_matrix(axes_calibration(np.random.default_rng(2), motions=motions, **more))


@pytest.mark.parametrize("motions", [False, True])
def test_the_matrix_is_that_which_was_simulated(motions):
    found = made(motions)
    np.testing.assert_allclose(found.values, true_matrix(found.frequency_hz), atol=6 * float(np.max(found.u)))
    assert np.max(found.u) < 1e-3 * np.max(np.abs(found.values))
    for i, one in enumerate(found.main()):
        across = np.delete(MATRIX[i], i) / MATRIX[i, i]
        size = 100 * np.linalg.norm(across)
        assert one["transverse_percent"] == pytest.approx([size] * 2, abs=0.05)
        assert one["misalignment_deg"] == pytest.approx([np.rad2deg(np.arctan(size / 100))] * 2, abs=0.03)
        for axis, true in zip(np.delete(list(OUTPUTS), i), across, strict=True):
            off = np.array(one["components_rad"][axis]) - true
            assert np.all(np.abs(off) < 4 * np.array(one["components_uncertainty_rad"][axis]))


def test_effects_and_transverse_motion_are_in_u():
    effects = (SystematicEffect("laser", "gain", 0.01), SystematicEffect("filter", "phase", 0.02))
    found = made(effects=effects, noise=1e-9)
    own = np.abs(found.values)
    size = np.sqrt(np.sum(found.u**2, axis=-1))
    np.testing.assert_allclose(size / own, np.hypot(0.01, 0.02), rtol=1e-3)
    plain = axes_calibration(np.random.default_rng(2), noise=1e-9)
    moved = sensitivity_matrix(AxesCalibration(plain.outputs, {}, 0.03))
    main = np.abs(moved.values[:, 0, 0])
    np.testing.assert_allclose(moved.u[:, 0, 1, 0], 0.03 * main, rtol=1e-3)
    assert np.all(moved.u[:, 0, 0, 0] < 1e-3 * main)


#: Known responses of the references' channels, and of an amplifier behind the output x.
REFERENCES = {
    axis: KnownResponse.from_corners([2.0 + at], gain=0.1 + at, standard_uncertainty=0.001 * (1 + at))
    for at, axis in enumerate(OUTPUTS)
}
AMPLIFIER = KnownResponse.from_corners([], [3e3], 10.0, standard_uncertainty=0.004)


def seen_through(known, signal):
    """A tone of whole periods behind a known response."""
    hz = np.fft.rfftfreq(signal.size, 1.0 / 8192.0)
    hz[0] = hz[1]
    return np.fft.irfft(np.fft.rfft(signal) * known.value(hz), signal.size)


@pytest.mark.parametrize("motions", [False, True])
def test_known_responses_of_channels_are_removed(motions):
    plain = axes_calibration(np.random.default_rng(2), motions=motions, noise=1e-9)
    references = REFERENCES if motions else dict.fromkeys(OUTPUTS, REFERENCES["x"])

    def through(calibration, axis, response):
        records = []
        for r in calibration.records:
            seen = r.response if response is None else seen_through(response, r.response)
            reference = seen_through(references[axis], r.reference)
            records.append(replace(r, reference=reference, response=seen))
        stated = {"reference_known_response": references[axis], "response_known_response": response}
        return replace(calibration, records=tuple(records), **stated)

    outputs = {axis: through(one, "x", AMPLIFIER if axis == "x" else None) for axis, one in plain.outputs.items()}
    moved = {axis: through(one, axis, None) for axis, one in plain.motions.items()}
    found = sensitivity_matrix(AxesCalibration(outputs, moved))
    np.testing.assert_allclose(found.values, sensitivity_matrix(plain).values, rtol=1e-6)
    size = np.sqrt(np.sum(found.u**2, axis=-1)) / np.abs(found.values)
    for i, output in enumerate(OUTPUTS):
        for j in range(3):
            parts = [0.001 * (1 + (j if motions else 0)), 0.004 if output == "x" else 0.0]
            np.testing.assert_allclose(size[:, i, j], np.hypot(*parts), rtol=1e-2)


def test_a_tone_outside_what_is_known_is_refused():
    plain = axes_calibration(np.random.default_rng(2))
    table = KnownResponse.from_table([100.0, 1000.0], [1.0, 1.0], [0.0, 0.0])
    known = {axis: replace(one, response_known_response=table) for axis, one in plain.outputs.items()}
    with pytest.raises(InputError, match="outside the band of a known response"):
        sensitivity_matrix(AxesCalibration(known, {}))


def test_motions_that_are_alike_are_refused():
    calibration = axes_calibration(np.random.default_rng(2), motions=True)
    same = dict.fromkeys(OUTPUTS, calibration.motions["x"])
    with pytest.raises(InputError, match="apart"):
        sensitivity_matrix(AxesCalibration(calibration.outputs, same))


def write(folder, text, motions=False):
    """The records of a calibration as CSV files, and the calibration file."""
    calibration = axes_calibration(np.random.default_rng(2), motions=motions)
    entries = []
    for k, record in enumerate(calibration.outputs["x"].records):
        columns = {f"v{name}": one.records[k].response for name, one in calibration.outputs.items()}
        columns |= {f"a{name}": one.records[k].reference for name, one in calibration.motions.items()}
        columns |= {"a": record.reference}
        np.savetxt(
            folder / f"{k}.csv",
            np.stack(list(columns.values()), 1),
            delimiter=",",
            header=",".join(columns),
            comments="",
        )
        axis = f'axis = "{record.circumstances.axis}"\n' if record.circumstances.axis else ""
        entries.append(
            f'[[records]]\nfile = "{k}.csv"\nexcitation = "sine"\nfrequency_hz = {record.frequency_hz}\n{axis}'
        )
    path = folder / "calibration.toml"
    path.write_text(text + "\n".join(entries))
    return path


def test_what_no_motion_shows_is_not_known():
    """Two outputs and motion along one axis: no transverse sensitivity of zero, and no missing output."""
    calibration = axes_calibration(np.random.default_rng(2))
    along_x = {
        name: replace(output, records=tuple(r for r in output.records if r.circumstances.axis == "x"))
        for name, output in calibration.outputs.items()
    }
    matrix = sensitivity_matrix(AxesCalibration(along_x, {}, 0.01))
    assert matrix.axes[0] == "x"
    assert set(matrix.axes) == set(OUTPUTS)
    main = {row["output"]: row for row in matrix.main()}
    assert set(main) == set(OUTPUTS)
    true = np.abs(true_matrix(matrix.frequency_hz)[:, 0, 0])
    assert main["x"]["magnitude"] == pytest.approx(true.tolist(), rel=1e-3)
    assert main["x"]["transverse_percent"] == main["y"]["magnitude"] == [None, None]


def test_from_files(tmp_path):
    path = write(tmp_path, '[reference]\ncolumn = "a"\ntransverse_motion = 0.01\n' + HEAD)
    assert read_axes(path).transverse_motion == 0.01
    done = shell.run("axes", path, "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    document = json.loads((tmp_path / "out" / "matrix.json").read_text())
    found = np.array(document["real"]) + 1j * np.array(document["imaginary"])
    np.testing.assert_allclose(found, made().values, rtol=1e-9)
    assert "transverse" in done.output
    refused = shell.run("identify", path)
    assert refused.exit_code == 2
    assert "vibrident axes" in refused.output


def test_three_references_from_files(tmp_path):
    references = "".join(f'[[reference]]\ncolumn = "a{name}"\naxis = "{name}"\n' for name in OUTPUTS)
    found = sensitivity_matrix(write(tmp_path, references + HEAD, motions=True))
    np.testing.assert_allclose(found.values, made(True).values, rtol=1e-9)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (('axis = "y"\n[[response]]', 'axis = "x"\n[[response]]'), "different axis"),
        (('column = "vy"\naxis = "y"', 'column = "vy"'), "no axis"),
        (("[reference]\n", "[reference]\ntransverse_motion = 2\n"), "transverse"),
        (('axis = "z"\n[[records]]', "[[records]]"), "axis of the motion"),
        (('column = "vy"', 'colum = "vy"'), "colum"),
    ],
)
def test_bad_files_are_refused(tmp_path, change, said):
    path = write(tmp_path, '[reference]\ncolumn = "a"\n' + HEAD)
    text = path.read_text()
    if change[0].startswith('axis = "z"'):
        path.write_text(text.replace('frequency_hz = 80.0\naxis = "x"\n', "frequency_hz = 80.0\n", 1))
    else:
        assert change[0] in text
        path.write_text(text.replace(*change, 1))
    with pytest.raises(InputError, match=said):
        sensitivity_matrix(path)
    with pytest.raises(InputError, match="several"):
        read(path)


@pytest.mark.slow
@pytest.mark.parametrize("study", ["triaxial", "three motions"])
def test_coverage(study):
    for name, share in coverage(study, 500).items():
        assert abs(share - 0.95) <= 0.02, name
