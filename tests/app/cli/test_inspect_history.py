"""`vibrident inspect` says what was done with units and clocks of the files."""

import numpy as np
from tests.support import shell


def test_what_evening_and_units_cost_is_said(tmp_path, rng):
    time = (np.arange(3000) + rng.uniform(-0.2, 0.2, 3000)) / 1000.0
    rows = (f"{t:.9f},{np.sin(600 * t):.9f},{np.cos(600 * t):.9f}\n" for t in time)
    (tmp_path / "x.csv").write_text("t (s),a [g],v [mV]\n" + "".join(rows))
    (tmp_path / "c.toml").write_text(
        '[reference]\ncolumn = "a"\n[response]\ncolumn = "v"\n[[records]]\nfile = "x.csv"\nexcitation = "random"\n'
    )
    text = " ".join(shell.printed("inspect", tmp_path / "c.toml", "--out", tmp_path).split())
    for words in ("in g × 9.80665", "in mV × 0.001", "evened: times deviate", "nothing above 450"):
        assert words in text


def test_steps_that_differ_by_their_files_alone_are_one_line(tmp_path):
    """The checksum of each file is in result.json."""
    records = ""
    for number in range(12):
        times = np.arange(3000) / 1000.0
        rows = [f"{t},{np.sin((60 + number) * t):.9f},{np.cos((60 + number) * t):.9f}" for t in times]
        (tmp_path / f"a{number}.csv").write_text("t (s),a,v\n" + "\n".join(rows) + "\n")
        (tmp_path / f"b{number}.csv").write_text("t (s),a,v\n" + "\n".join(rows) + "\n")
        records += f'[[records]]\nfile = "a{number}.csv"\nreference_file = "b{number}.csv"\nexcitation = "random"\n'
    (tmp_path / "c.toml").write_text(f'[reference]\ncolumn = "a"\n[response]\ncolumn = "v"\nunit = "V"\n{records}')
    text = " ".join(shell.printed("inspect", tmp_path / "c.toml", "--out", tmp_path).split())
    assert "reference from b0.csv, and 11 more of other files" in text
    assert "further steps" not in text
    assert "(1 records)" not in text
