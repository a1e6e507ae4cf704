"""The calibration file states what is known of a channel, in any of the forms that people have."""

from pathlib import Path

import numpy as np
import pytest
from tests.support.known_channels import POLES, RATE_HZ, REFERENCE, Motion, accelerometer
from tests.support.shell import run

from vibrident import Calibration, InputError, identify, read
from vibrident.base.extras import library
from vibrident.data.io.known_section import KnownResponseEntry

HZ = np.geomspace(30.0, 12000.0, 200)
G = 9.80665
GAIN = REFERENCE[0] * (2.0 * np.pi * REFERENCE[1]) ** 2
PAIRS = [[float(pole.real), float(pole.imag)] for pole in POLES]
TABLE = (
    'file = "ref.csv"\nfrequency = "f (Hz)"\nmagnitude = 2\nphase = 3\n'
    "magnitude_uncertainty = 4\nphase_uncertainty = 5\ncoverage_factor = 2.0\n"
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A random record of a reference in V and a sensor, and the certificate of the reference in mV/g."""
    motion = Motion("random", 4096, RATE_HZ, (100.0, 12000.0))
    columns = motion.channel(accelerometer(*REFERENCE)), motion.channel(accelerometer(0.01, 4000.0, 0.02), noise=1e-3)
    np.savetxt(tmp_path / "rec.csv", np.transpose(columns), delimiter=",", header="ref (V),resp (V)", comments="")
    _write_certificate(tmp_path / "ref.csv", HZ)
    return tmp_path


def _write_certificate(path: Path, hz: np.ndarray) -> None:
    value = accelerometer(*REFERENCE)(hz) * G * 1e3
    columns = hz, np.abs(value), np.rad2deg(np.angle(value)), np.full(hz.size, 0.5), np.full(hz.size, 0.2)
    header = "f (Hz),S (mV/g),phase (deg),U(S) in % (k=2),U(phase) (deg)"
    np.savetxt(path, np.transpose(columns), delimiter=",", header=header, comments="")


def calibration(folder: Path, *entries: str, reference: str = "", response: str = "", records: str = "") -> Path:
    """A calibration file with known responses of the reference."""
    path = folder / "cal.toml"
    known = "".join(f"[[reference.known_response]]\n{entry}\n" for entry in entries)
    path.write_text(
        f"[reference]\ncolumn = 1\n{reference}\n{known}[response]\ncolumn = 2\n{response}\n"
        f"[sampling]\nrate_hz = {RATE_HZ}\n"
        f'[[records]]\nfile = "rec.csv"\nexcitation = "random"\n{records}\n'
    )
    return path


def known(folder: Path, *entries: str, **more: str):
    """What a calibration file states of its reference."""
    found = read(calibration(folder, *entries, **more)).reference_known_response
    assert found is not None
    return found


def test_a_certificate_in_its_own_units_is_applied_with_its_u(folder):
    stated = known(folder, TABLE)
    np.testing.assert_allclose(stated.value(HZ), accelerometer(*REFERENCE)(HZ), rtol=1e-6)
    u = np.sqrt(np.diag(stated.covariance(HZ[:50])))
    np.testing.assert_allclose(u[:50], 0.0025, rtol=0.01)  # below the resonance, where a spline is sure
    np.testing.assert_allclose(u[50:], np.deg2rad(0.1), rtol=0.01)
    assert stated.band_hz == pytest.approx((30.0, 12000.0))


def test_every_form_states_the_same_response(folder):
    truth = accelerometer(*REFERENCE)(HZ)
    motion = Motion("random", 4096, RATE_HZ, (100.0, 12000.0))
    laser = Calibration.from_arrays(
        [motion.channel()], [motion.channel(accelerometer(*REFERENCE), noise=1e-5)], RATE_HZ, excitation="random"
    )
    identify(laser).save(folder / "result.json")
    forms = {
        "poles": f'poles = {PAIRS}\ngain = {GAIN}\nunit = "V/(m/s^2)"',
        "per velocity": f'poles = {PAIRS}\nzeros = [[0.0, 0.0]]\ngain = {GAIN}\nunit = "V/(m/s)"',
        "per g": f'poles = {PAIRS}\ngain = {GAIN * G * 1e3}\nunit = "mV/g"',
        "result": 'file = "result.json"',
    }
    for name, form in forms.items():
        np.testing.assert_allclose(known(folder, form).value(HZ), truth, rtol=2e-5, err_msg=name)


def test_a_chain_leads_from_the_recorder_to_the_motion(folder):
    charge = 'highpass_hz = [0.5]\nlowpass_hz = [50000.0]\ngain = 0.002\nunit = "V/pC"\ncorner_uncertainty = 0.1'
    sensor = f'poles = {PAIRS}\ngain = {GAIN * 500.0}\nunit = "pC/(m/s^2)"'
    digital = f"numerator = [0.5, 0.5]\nrate_hz = {RATE_HZ}"
    stated = known(folder, digital, charge, sensor)
    amplifier = (1j * HZ / 0.5) / (1.0 + 1j * HZ / 0.5) / (1.0 + 1j * HZ / 50000.0)
    filtered = 0.5 * (1.0 + np.exp(-2j * np.pi * HZ / RATE_HZ))
    np.testing.assert_allclose(stated.value(HZ), accelerometer(*REFERENCE)(HZ) * amplifier * filtered, rtol=1e-12)


def test_the_response_is_per_what_its_chain_leads_to(folder):
    path = calibration(folder, TABLE)
    path.write_text(
        path.read_text().replace(
            "[sampling]", '[[response.known_response]]\nhighpass_hz = [1.0]\ngain = 0.001\nunit = "V/pC"\n[sampling]'
        )
    )
    found = read(path)
    assert (found.response_unit, found.units["response"], found.units["reference"]) == ("pC", "V", "V")


BAD = {
    "no phase": TABLE.replace("phase = 3\n", "").replace("phase_uncertainty = 5\n", ""),
    "out of order": TABLE.replace("ref.csv", "disorder.csv"),
    "right half plane": f'poles = {[[-a, b] for a, b in PAIRS]}\nunit = "V/(m/s^2)"',
    "does not fit its channel": f'poles = {PAIRS}\nunit = "A/(m/s^2)"',
    "do not lead from the channel": f"poles = {PAIRS}",
    "stated in one way": f"poles = {PAIRS}\n{TABLE}",
    "does not belong to": f"poles = {PAIRS}\nhighpass_hz = [1.0]\n".replace("highpass_hz = [1.0]", "rate_hz = 1.0"),
    "needs the rate": "numerator = [1.0]",
    "contradicts": TABLE.replace("coverage_factor = 2.0\n", ""),
    "cannot be read": TABLE.replace("ref.csv", "nothing.csv"),
    "is not known here": f"pols = {PAIRS}",
}


@pytest.mark.parametrize("problem", BAD)
def test_a_bad_statement_gets_one_message(folder, problem):
    rows = (folder / "ref.csv").read_text().splitlines()
    (folder / "disorder.csv").write_text("\n".join([*rows[:5], rows[6], rows[5], *rows[7:]]))
    done = run("identify", str(calibration(folder, BAD[problem])), "--out", str(folder / "out"))
    assert done.exit_code == 2
    assert problem in " ".join(done.output.split())
    assert "Traceback" not in done.output


def test_a_band_beyond_the_certificate_is_refused_and_one_within_is_kept(folder):
    with pytest.raises(InputError, match="beyond what is known"):
        identify(calibration(folder, TABLE, records="to_hz = 15000.0"))
    result = identify(calibration(folder, TABLE, records="to_hz = 8000.0"))
    assert result.settings["known_responses"][0]["band_hz"][1] == 8000.0
    assert {"file": "ref.csv", "history": ["known response of the reference"]}.items() <= result.provenance["files"][
        1
    ].items()


def test_inspect_and_identify_say_what_is_taken_out(folder):
    path = str(calibration(folder, TABLE))
    shown = run("inspect", path, "--out", str(folder / "out")).output
    assert "Known responses" in shown
    assert "ref.csv" in shown
    said = run("identify", path, "--out", str(folder / "out"), "--no-pictures").output
    assert "known response of the reference, is taken out; the fit takes 30 to 1.2e+04 Hz" in " ".join(said.split())


def test_every_key_is_of_a_way():
    from vibrident.data.io.known_section import _ANY, WAYS

    named = {key for needed, others in WAYS.values() for key in (*needed, *others)} | _ANY
    assert named == set(KnownResponseEntry.model_fields)


SACPZ = """* NETWORK   (KNETWK): XX
* INPUT UNIT        : M
* OUTPUT UNIT       : V
ZEROS 3
POLES 2
-4.44 4.44
-4.44 -4.44
CONSTANT 30.0
"""


def test_sacpz_lists_zeros_that_are_not_at_the_origin_alone(folder):
    (folder / "geophone.pz").write_text(SACPZ)
    stated = known(folder, 'file = "geophone.pz"', reference='quantity = "velocity"')
    s = 2j * np.pi * HZ
    np.testing.assert_allclose(stated.value(HZ), 30.0 * s**2 / (s**2 + 8.88 * s + 2 * 4.44**2), rtol=1e-12)


@pytest.mark.needs("seismic")
def test_stations_are_what_evalresp_computes():
    obspy = library("obspy", "seismic", "", "")
    from vibrident.data.io.instrument_files import _known_response

    at = np.geomspace(0.002, 8.0, 20)
    channels = [channel for network in obspy.read_inventory() for station in network for channel in station]
    for channel in channels:
        if channel.code.endswith("Z") and channel.sample_rate >= 20.0:
            truth = channel.response.get_evalresp_response_for_frequencies(at, output="VEL")
            stated, unit = _known_response(channel.response, Path("inventory"))
            assert unit == "counts/(m/s)"
            np.testing.assert_allclose(stated.value(at), truth, rtol=1e-9)


@pytest.mark.needs("seismic")
def test_a_station_file_with_several_channels_asks_which(folder):
    obspy = library("obspy", "seismic", "", "")
    obspy.read_inventory().write(str(folder / "stations.xml"), format="STATIONXML")
    counts = 'quantity = "velocity"\nunit = "counts"\nscale = 1e6'
    with pytest.raises(InputError, match="name one by channel"):
        known(folder, 'file = "stations.xml"', reference=counts)
    stated = known(folder, 'file = "stations.xml"\nchannel = "GR.FUR..BHZ"', reference=counts)
    assert np.abs(stated.value(1.0)) == pytest.approx(9.43e8, rel=0.05)
