"""Long records a stretch at a time: the numbers of one machine, in memory that does not grow, resumed after a kill."""

from __future__ import annotations

import importlib.util
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.support import file_formats
from tests.support.long_records import RATE_HZ, TRUTH, in_file, random_motion

import vibrident
from vibrident.base.errors import InputError
from vibrident.data.io import long_records
from vibrident.data.io.long_records import RecordsInFiles, RecordSpan, long_records_in, long_records_of
from vibrident.data.io.reader import open_columns
from vibrident.data.records import Calibration
from vibrident.use.stretches import identification
from vibrident.use.stretches.identification import cut_into
from vibrident.use.stretches.pooled import PooledEstimate

SAMPLES = 12_000
STRETCH = 3_000


@pytest.fixture(autouse=True)
def short(monkeypatch):
    """Records of a few thousand samples are long."""
    monkeypatch.setattr(long_records, "MAX_TOGETHER", STRETCH)
    monkeypatch.setattr(identification, "STRETCH_SAMPLES", STRETCH)


def calibration(samples: int = SAMPLES, seed: int = 0, **changed: float) -> Calibration:
    reference, response = random_motion(samples, seed, TRUTH | changed)
    return Calibration.from_arrays(reference, response, RATE_HZ, quantity="acceleration", excitation="random")


def numbers(result: vibrident.Result) -> dict:
    """All numbers of a result, and what it says; not its time, nor the names of its files."""
    document = result.to_dict()
    document["settings"].pop("time_s", None)
    document["provenance"].pop("time")
    return document


def deviations(result: vibrident.Result) -> dict[str, float]:
    """By how many standard uncertainties the parameters are off."""
    stated = {name: result.parameters[name] for name in TRUTH}
    return {name: (p.value - TRUTH[name]) / p.standard_uncertainty for name, p in stated.items()}


def test_stretches_hold_each_sample_once():
    for lengths in ([10], [3, 4, 2, 25, 1, 1], [8] * 5):
        stretches = cut_into(lengths, 8)
        samples = [(part.record, n) for parts in stretches for part in parts for n in range(part.start, part.stop)]
        assert samples == [(record, n) for record, length in enumerate(lengths) for n in range(length)]
        assert max(sum(part.samples for part in parts) for parts in stretches) <= 8


def test_the_pooled_estimate_is_that_of_generalised_least_squares():
    rng = np.random.default_rng(0)
    roots = rng.normal(size=(5, 3, 3))
    covariances = roots @ roots.swapaxes(1, 2)
    truth = np.array([1.0, -2.0, 3.0])
    places = truth + (np.linalg.cholesky(covariances) @ rng.normal(size=(5, 3, 1)))[..., 0]
    whitening = np.concatenate([np.linalg.inv(np.linalg.cholesky(c)) for c in covariances])
    data = np.concatenate([np.linalg.inv(np.linalg.cholesky(c)) @ z for c, z in zip(covariances, places, strict=True)])
    z, squares, *_ = np.linalg.lstsq(whitening, data, rcond=None)
    found = PooledEstimate.from_stretches(places, covariances)
    np.testing.assert_allclose(found.z, z, rtol=1e-9)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(whitening.T @ whitening), rtol=1e-8)
    assert found.chi2 == pytest.approx(float(squares[0]), rel=1e-8)
    assert found.degrees_of_freedom == 12
    np.testing.assert_allclose(found.weights.sum(axis=0), np.eye(3), atol=1e-9)


def test_stretches_tell_what_the_whole_record_tells(monkeypatch):
    record = calibration()
    by_stretches = vibrident.identify(record)
    monkeypatch.setattr(long_records, "MAX_TOGETHER", 10 * SAMPLES)
    whole = vibrident.identify(record)
    for name, stated in whole.parameters.items():
        found = by_stretches.parameters[name]
        assert abs(found.value - stated.value) < 0.7 * stated.standard_uncertainty
        assert found.standard_uncertainty == pytest.approx(stated.standard_uncertainty, rel=0.05)
    assert by_stretches.fit.rmse == pytest.approx(whole.fit.rmse, rel=0.02)
    assert by_stretches.fit.adequate
    assert by_stretches.warnings == ()
    assert by_stretches.settings["stretches"]["count"] == 4
    assert "stretches" not in whole.settings


@pytest.mark.draws(3, 200)
def test_the_truth_is_within_the_uncertainty(draws):
    z = np.array(
        [list(deviations(vibrident.identify(calibration(2 * STRETCH, seed))).values()) for seed in range(draws)]
    )
    assert np.mean(z**2) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / z.size))


def test_a_sensor_that_changes_on_the_way_is_said():
    before, after = random_motion(2 * STRETCH, 0, TRUTH), random_motion(2 * STRETCH, 1, TRUTH | {"sensitivity": 0.102})
    reference, response = (np.concatenate(pair) for pair in zip(before, after, strict=True))
    record = Calibration.from_arrays(reference, response, RATE_HZ, quantity="acceleration", excitation="random")
    result = vibrident.identify(record)
    (warning,) = (warning for warning in result.warnings if warning.code == "regimes")
    assert "not the same all along" in warning.message
    stretches = result.settings["stretches"]
    assert stretches["probability"] < 1e-6
    values = [row["sensitivity"] for row in stretches["values"]]
    np.testing.assert_allclose(values, [0.1, 0.1, 0.102, 0.102], rtol=1e-3)
    # the Birge ratio covers half of the change
    assert result.parameters["sensitivity"].standard_uncertainty > 0.3e-3


def test_a_slow_sensor_has_longer_stretches():
    slow = calibration(3 * STRETCH, natural_frequency=100.0)
    assert vibrident.identify(slow).settings["stretches"]["count"] == 2


def test_other_motion_takes_the_whole():
    assert (
        long_records_in(replace(calibration(), records=(replace(calibration().records[0], excitation="sweep"),)))
        is None
    )


def test_files_are_read_by_parts_with_the_same_numbers(tmp_path):
    path = in_file(tmp_path, *random_motion(SAMPLES, 0, TRUTH))
    records = long_records_of(path)
    assert isinstance(records, RecordsInFiles)
    assert records.lengths == (SAMPLES,)
    part = records.calibration([RecordSpan(0, 1000, 1500)])
    whole = vibrident.read(path)
    np.testing.assert_array_equal(part.records[0].response, whole.records[0].response[1000:1500])
    np.testing.assert_array_equal(part.records[0].reference, whole.records[0].reference[1000:1500])
    assert part.records[0].start_time_s == 1000 / RATE_HZ
    by_file, by_memory = numbers(vibrident.identify(path)), numbers(vibrident.identify(whole))
    assert by_file["parameters"] == by_memory["parameters"]
    assert by_file["fit"] == by_memory["fit"]
    assert by_file["provenance"]["files"][0]["sha256"] == whole.records[0].provenance.sha256


def test_a_part_of_a_file_is_a_part_of_the_record(tmp_path):
    path = in_file(tmp_path, *random_motion(SAMPLES, 0, TRUTH), more="start_s = 0.1\nstop_s = 0.5\n")
    records = long_records_of(path)
    assert records is not None
    (part,) = records.calibration([RecordSpan(0, 0, 10)]).records
    np.testing.assert_array_equal(part.response, vibrident.read(path).records[0].response[:10])


@pytest.mark.needs("seismic")
def test_parts_of_a_seismogram_are_those_of_the_whole(tmp_path):
    counts = np.random.default_rng(0).integers(-1000, 1000, (2, 20_000)).astype(np.int32)
    file_formats.miniseed(tmp_path / "a.mseed", dict(zip(("HHZ", "HHN"), counts, strict=True)), 100.0)
    file = open_columns(tmp_path / "a.mseed")
    assert file.length(0) == 20_000
    for start, stop in ((0, 20_000), (0, 1), (7_001, 13_002), (19_999, 20_000)):
        np.testing.assert_array_equal(file.block([0, 1], start, stop), np.stack(file.load([0, 1]))[:, start:stop])


def test_a_stretch_that_cannot_be_used_is_left_out_and_said(tmp_path):
    reference, response = random_motion(SAMPLES, 0, TRUTH)
    response[4 * SAMPLES // 10] = np.nan
    result = vibrident.identify(in_file(tmp_path, reference, response))
    (warning,) = result.warnings
    assert "1 of 4 stretches" in warning.message
    assert result.settings["stretches"]["used"] == 3
    assert max(map(abs, deviations(result).values())) < 4.0
    response[::1000] = np.nan
    with pytest.raises(InputError, match="not a number"):
        vibrident.identify(in_file(tmp_path / "bad", reference, response))


def test_what_was_fitted_is_kept_and_not_fitted_again(tmp_path, monkeypatch):
    path = in_file(tmp_path, *random_motion(SAMPLES, 0, TRUTH))
    uninterrupted = numbers(vibrident.identify(path))
    fits = identification.fit_stretch
    calls = []

    def interrupted(source, stretch, order):
        if len(calls) == 2:
            raise KeyboardInterrupt
        calls.append(stretch)
        return fits(source, stretch, order)

    monkeypatch.setattr(identification, "fit_stretch", interrupted)
    with pytest.raises(KeyboardInterrupt):
        vibrident.identify(path, work=tmp_path / "work")
    (folder,) = (tmp_path / "work").iterdir()
    (folder / "000001.fit").write_bytes(b"half a fi")  # a damaged file is computed again
    monkeypatch.setattr(identification, "fit_stretch", lambda *of: calls.append(of[1]) or fits(*of))
    resumed = numbers(vibrident.identify(path, work=tmp_path / "work"))
    assert resumed == uninterrupted
    assert len(calls) == 2 + 2  # the damaged one and the last: the first is always fitted, without being kept
    vibrident.identify(path, work=tmp_path / "work")
    assert len(calls) == 4
    vibrident.identify(path, band_hz=(10.0, 200.0), work=tmp_path / "work")
    assert len(calls) == 4 + 3  # another band, other fits


CHILD = """
import sys
from vibrident.data.io import long_records
from vibrident.use.stretches import identification
long_records.MAX_TOGETHER = identification.STRETCH_SAMPLES = int(sys.argv[2])
import vibrident
result = vibrident.identify(sys.argv[1], work=sys.argv[3] if len(sys.argv) > 3 else None)
result.save(sys.argv[1] + ".json")
with open("/proc/self/status") as status:
    print(next(int(line.split()[1]) for line in status if line.startswith("VmHWM")))
"""


def child(path: Path, *more: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", CHILD, str(path), str(STRETCH), *map(str, more)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="kill -9 and memory are read as Linux has them")
def test_it_continues_after_kill_9(tmp_path):
    path = in_file(tmp_path, *random_motion(10 * STRETCH, 0, TRUTH))
    uninterrupted = numbers(vibrident.identify(path))
    with child(path, tmp_path / "work") as process:
        until = time.monotonic() + 120.0
        while len(list((tmp_path / "work").glob("*/*.fit"))) < 3 and time.monotonic() < until:
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
    kept = {file: file.stat().st_mtime_ns for file in (tmp_path / "work").glob("*/*.fit")}
    assert 3 <= len(kept) < 9
    with child(path, tmp_path / "work") as again:
        assert again.wait() == 0
    assert {file: file.stat().st_mtime_ns for file in kept} == kept
    resumed = numbers(vibrident.Result.load(f"{path}.json"))
    assert resumed["parameters"] == uninterrupted["parameters"]
    assert resumed["measured"] == uninterrupted["measured"]
    assert resumed["settings"]["stretches"] == uninterrupted["settings"]["stretches"]


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="memory is read as Linux has it")
def test_memory_does_not_grow_with_the_record(tmp_path):
    peaks = []
    for stretches in (8, 110):
        path = in_file(tmp_path / str(stretches), *random_motion(stretches * STRETCH, 0, TRUTH))
        with child(path) as process:
            peaks.append(1024 * int(process.communicate()[0]))
    # What a stretch leaves is a few kilobytes of numbers: less than its samples, 16 bytes each.
    assert peaks[1] - peaks[0] < 16 * 102 * STRETCH


needs_dask = pytest.mark.skipif(importlib.util.find_spec("distributed") is None, reason="Dask is not installed")


@needs_dask
@pytest.mark.filterwarnings("default")  # Dask's own, of what it uses
@pytest.mark.parametrize("processes", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_cluster_gives_the_numbers_of_one_machine(tmp_path, processes):
    import distributed

    path = in_file(tmp_path, *random_motion(SAMPLES, 0, TRUTH))
    alone = numbers(vibrident.identify(path))
    in_memory = vibrident.read(path)
    with distributed.LocalCluster(
        processes=processes, n_workers=2, threads_per_worker=1, dashboard_address=None
    ) as cluster:
        shared = vibrident.identify(path, scheduler=cluster.scheduler_address, work=tmp_path / "work")
        sent = vibrident.identify(in_memory, scheduler=cluster.scheduler_address)
    assert numbers(shared) == alone
    assert numbers(sent)["parameters"] == alone["parameters"]
    assert len(list((tmp_path / "work").glob("*/*.fit"))) == 3


@needs_dask
@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_local_workers_are_started_and_ended(tmp_path):
    result = vibrident.identify(calibration(), scheduler="local")
    assert numbers(result)["parameters"] == numbers(vibrident.identify(calibration()))["parameters"]


@needs_dask
@pytest.mark.filterwarnings("default")
def test_workers_of_other_versions_are_refused(monkeypatch):
    import distributed

    from vibrident.base import cluster as door

    with distributed.LocalCluster(
        processes=False, n_workers=1, threads_per_worker=1, dashboard_address=None
    ) as cluster:
        stated = iter([{"numpy": "1"}, {"numpy": "2"}, {"numpy": "1"}, {"numpy": "1"}])
        monkeypatch.setattr(door, "versions", lambda: next(stated))
        with pytest.raises(InputError, match="cannot share") as refused:
            door.Cluster(cluster.scheduler_address, "identify.scheduler")
    assert "numpy 2" in refused.value.found


def test_a_missing_dask_is_said_with_the_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match="needs Dask") as refused:
        vibrident.identify(calibration(), scheduler="local")
    assert "vibrident[cluster]" in refused.value.remedy
