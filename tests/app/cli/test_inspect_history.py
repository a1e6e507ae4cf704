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
