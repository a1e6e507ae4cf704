"""PyDynamic's functions on the data of ``bench/from_pydynamic.py``: arguments IN.npz and OUT.json.

Everything by its defaults, or as its own examples do it. Imports only what its environment holds.
"""

import importlib
import importlib.metadata
import inspect
import json
import sys
import warnings
from pathlib import Path

import numpy as np

warnings.simplefilter("ignore")
from PyDynamic import LSFIR, fit_som  # noqa: E402
from PyDynamic.misc import (  # noqa: E402
    impinvar,
    kaiser_lowpass,
    sos_absphase,
    sos_FreqResp,
    sos_phys2filter,
    sos_realimag,
)
from PyDynamic.uncertainty import (  # noqa: E402
    GUM_DFT,
    DFT_deconv,
    FIRuncFilter,
    GUM_iDFT,
    Time2AmpPhase,
)
from scipy.signal import freqz  # noqa: E402


def main(source: str, target: str) -> None:
    """Compute and write."""
    np.random.seed(1)  # noqa: NPY002 - the generator it uses
    data = np.load(source)
    out = {"version": importlib.metadata.version("PyDynamic"), "names": _names()}
    values, covariance = fit_som(
        data["frequency_hz"], data["parts"], UH=data["parts_u"], weighting="cov"
    )
    u = np.sqrt(np.diag(covariance))
    out["fit_som"] = {"values": values.tolist(), "u": u.tolist()}  # S0, damping, natural frequency
    out["sos_FreqResp"] = _complex(sos_FreqResp(*data["true"], data["grid_hz"]))
    at_hz = data["at_hz"]
    _, spread = sos_absphase(*values, *u, at_hz)
    out["sos_absphase"] = np.sqrt(np.diag(spread)[: len(at_hz)]).tolist()
    rate = float(data["rate_hz"])
    grid = data["grid_hz"]
    out["impinvar"] = _complex(
        freqz(*impinvar(*sos_phys2filter(*data["true"]), fs=rate), grid, fs=rate)[1]
    )
    tones = []
    for reference, response in zip(data["references"], data["responses"], strict=True):
        parts = [
            Time2AmpPhase(x, s**2)
            for x, s in ((reference, 1e-12), (response, float(data["tone_noise"])))
        ]
        line = int(np.argmax(parts[0][0]))
        gain = parts[1][0][line] / parts[0][0][line]
        spread = np.diag(parts[1][2]) if np.ndim(parts[1][2]) == 2 else parts[1][2]
        tones.append([float(gain), float(np.sqrt(spread[line]) / parts[0][0][line])])
    out["Time2AmpPhase"] = tones
    out["FIRuncFilter"] = _by_fir(values, u, data)
    out["DFT_deconv"] = _by_dft(values, u, data)
    Path(target).write_text(json.dumps(out))


def _names():
    """Return what its packages offer."""
    packages = (
        "",
        ".model_estimation",
        ".uncertainty",
        ".uncertainty.propagate_convolution",
        ".misc",
        ".misc.noise",
    )
    modules = [importlib.import_module("PyDynamic" + package) for package in packages]
    named = {name for module in modules[1:] for name in getattr(module, "__all__", ())}
    offered = {
        name
        for module in (modules[0], *modules[3:4], modules[-1])
        for name, value in vars(module).items()
        if inspect.isfunction(value)
        and value.__module__.startswith("PyDynamic")
        and not name.startswith("_")
    }
    return sorted(named | offered)


def _complex(values):
    return [np.real(values).tolist(), np.imag(values).tolist()]


def _by_fir(values, u, data):
    """Its example deconv_FIR: a filter of order 12 fitted to 1/H, with a Kaiser low-pass."""
    rate = float(data["rate_hz"])
    order = 12
    grid = np.linspace(0.0, float(data["fit_to_hz"]), 200)
    _, covariance = sos_realimag(*values, *u, grid)
    # Real parts, then imaginary ones.
    response = np.concatenate(_complex(sos_FreqResp(*values, grid)))
    taps, spread = LSFIR(
        response,
        order,
        grid,
        rate,
        order // 2,
        verbose=False,
        inv=True,
        UH=covariance,
        mc_runs=1000,
    )
    low, shift = kaiser_lowpass(100, float(data["low_pass_hz"]), rate)
    acceleration, stated = FIRuncFilter(
        data["shock"], float(data["shock_noise"]), taps, spread, shift + order // 2, low
    )
    return {"acceleration": np.ravel(acceleration).tolist(), "u": np.ravel(stated).tolist()}


def _by_dft(values, u, data):
    """GUM_DFT, DFT_deconv with a low-pass that is known, GUM_iDFT."""
    shock = data["shock"]
    rate = float(data["rate_hz"])
    grid = np.fft.rfftfreq(len(shock), 1 / rate)
    _, covariance = sos_realimag(*values, *u, grid)
    # Real parts, then imaginary ones.
    response = np.concatenate(_complex(sos_FreqResp(*values, grid)))
    spectrum, spread = GUM_DFT(shock, float(data["shock_noise"]) ** 2)
    divided, divided_u = DFT_deconv(response, spectrum, covariance, spread)
    keep = np.tile(data["low_pass"], 2)
    acceleration, stated = GUM_iDFT(divided * keep, divided_u * np.outer(keep, keep), Nx=len(shock))
    return {"acceleration": acceleration.tolist(), "u": np.sqrt(np.diag(stated)).tolist()}


if __name__ == "__main__":
    main(*sys.argv[1:3])
