"""Units in the first line of a stream are applied as those of a file are."""

import numpy as np
import pytest

from vibrident.base.errors import InputError
from vibrident.data.io.calibration_file import checked_calibration
from vibrident.data.sources.decoding import chunks
from vibrident.data.sources.source import SourceRequest

HEAD = b"t [ms],a [g],v [mV]\n"
ROWS = b"".join(b"%d,%d,%d\n" % (n, n, 2 * n) for n in range(4))


def wanted(tmp_path, position=0, **reference):
    document = {
        "reference": {"column": "a", **reference},
        "response": {"column": "v", "unit": "V"},
        "sampling": {"time_column": "t"},
        "records": [{"file": "x.csv", "excitation": "random"}],
    }
    return SourceRequest(checked_calibration(document, "c.toml"), tmp_path / "c.toml", 1000.0, position=position)


@pytest.mark.parametrize("is_resumed", [False, True])
def test_units_of_the_first_line_hold_for_the_stream(tmp_path, is_resumed):
    """Also where a file is taken up again in its middle."""
    asked = wanted(tmp_path, position=len(HEAD) if is_resumed else 0)
    pieces = [ROWS] if is_resumed else [HEAD[:7], HEAD[7:] + ROWS]
    first_line = HEAD.strip() if is_resumed else b""
    (chunk,) = chunks(iter(pieces), asked, "csv", "x.csv", first_line)
    np.testing.assert_allclose(chunk.reference, 9.80665 * np.arange(4))
    np.testing.assert_allclose(chunk.response, 2e-3 * np.arange(4))
    assert chunk.start_s == 0.0


def test_a_contradiction_is_refused(tmp_path):
    with pytest.raises(InputError, match="contradicts"):
        list(chunks(iter([HEAD + ROWS]), wanted(tmp_path, quantity="velocity"), "csv", "x.csv"))
