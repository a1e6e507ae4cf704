"""A fleet fitted on a GPU: many calibrations at once, here on JAX's CPU backend."""

import os
from pathlib import Path

import pytest
from tests.support.fleets import broken, fleet, good
from tests.support.shell import run as shell

from vibrident.batched import program
from vibrident.errors import InputError
from vibrident.fleet import Orders, row, worker
from vibrident.fleet.batch import _rows
from vibrident.fleet.key import fingerprint
from vibrident.process import Died


def test_a_worker_gives_the_rows_that_it_gives_one_by_one(tmp_path, monkeypatch):
    monkeypatch.setattr(program, "gpu", lambda: program.jax.devices("cpu")[0])
    monkeypatch.chdir(tmp_path)
    fleet(tmp_path / "data", 3)
    broken(tmp_path / "data")
    (tmp_path / "out/results").mkdir(parents=True)
    plain, orders = Orders(str(tmp_path / "out"), results=False), Orders(str(tmp_path / "out"), device="gpu")
    files = [str(file) for file in sorted(tmp_path.glob("data/*/c.toml"))]
    alone = [worker.identified([(file, fingerprint(file, plain).key)], plain)[0][0] for file in files]
    together, _ = worker.identified([(file, fingerprint(file, orders).key) for file in files], orders)
    assert len(together) == 13
    for one, other in zip(alone, together, strict=True):
        assert (one["status"], one["message"], one["warnings"]) == (
            other["status"],
            other["message"],
            other["warnings"],
        )
        for name, (value, u, unit) in one["parameters"].items():
            assert other["parameters"][name] == [pytest.approx(value, rel=1e-9), pytest.approx(u, rel=1e-9), unit]
    assert sum(one["status"] == row.IDENTIFIED for one in together) == 3
    assert len(os.listdir(tmp_path / "out/results")) == 3


def test_calibrations_that_end_their_process_together_are_tried_one_by_one():
    class Fragile:
        def identify(self, tasks):
            if len(tasks) > 1:
                raise Died("crash", "signal 11")
            return [f"row of {tasks[0][0]}"]

        def close(self):
            pass

    assert _rows(Fragile(), [("a", "1"), ("b", "2")]) == ["row of a", "row of b"]


def test_without_a_gpu_the_command_is_refused(tmp_path):
    good(tmp_path / "data", 1)
    arguments = ("fleet", tmp_path / "data", "--out", tmp_path / "out", "--workers", "1", "--device")
    refused = shell(*arguments, "gpu")
    assert (refused.exit_code, "No GPU is here" in refused.output) == (2, True), refused.output
    assert isinstance(refused.exception, SystemExit | InputError)
    assert not Path(tmp_path / "out/fleet.parquet").exists()
    assert shell(*arguments, "tpu").exit_code == 2
