"""Ellipse fits of hoqi-bench on the cases of ``bench.light``: ``python X.py CASES.npz``.

CASES: signals, shape (cases, 2, samples), and the true phase, shape (cases, samples). Prints, for
each of its fits, the relative error of the amplitude of the phase of every case; NaN where the fit
failed. Imports only what that environment holds.
"""

import json
import sys
import warnings

import numpy as np
from hoqi_bench.methods import METHOD_REGISTRY

SLOW = "koning_wimmer_witkovsky"


def gain_error(phase, phase_found):
    """Relative error of the amplitude; the sign of the direction is taken for known."""
    true = phase - phase.mean()
    phase_found = np.unwrap(phase_found)
    return float(abs(phase_found @ true) / (true @ true) - 1.0)


def main(path):
    """Run all fits and print the errors."""
    data = np.load(path)
    errors = {}
    for name, fit in METHOD_REGISTRY.items():
        if name == "raw_atan2":  # no fit
            continue
        gains = []
        every = int(data["every"]) if name == SLOW else 1  # seconds a case
        for signals, phase in zip(data["signals"][::every], data["phase"][::every], strict=True):
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    result = fit(signals[0], signals[1])
                gains.append(gain_error(phase, np.asarray(result.recovered_phase)))
            except Exception:
                gains.append(float("nan"))
        errors[name] = [None if not np.isfinite(value) else value for value in gains]
    print(json.dumps(errors))


if __name__ == "__main__":
    main(sys.argv[1])
