# %% [markdown]
# # A model of your own
#
# Any sensor whose response is a function of frequency can be identified. In a script or a
# notebook a model is one object: a name, the response as a formula of s, and the
# parameters. This page is executed whenever this site is built; the data of its three
# sensors are sums of sines, made from the formulas here and noise of 0.2 %.
#
# ## What to write
#
# - **The response** is a function of s and of one keyword a parameter: response per m/s² of
#   acceleration, or per unit of a reference of quantity `drive` (a pressure, a voltage).
# - **One parameter is the gain:** the response is proportional to it. It needs no start value.
# - **Every other parameter** has a start value and, if wished, bounds; without them it is
#   searched up to a thousand times smaller and larger. A frequency in Hz needs neither: it is
#   looked for over the band of the data. A value that may be negative needs bounds.
# - **A ratio of polynomials**, in Python's operators, becomes exact poles and zeros.
# - **Any other function**, with NumPy's `exp` or `sqrt`, acts as a filter on the reference;
#   the start of a record is not used for as long as the filter rings. It must be analytic in
#   its parameters, without `abs`, `real` and `imag`: derivatives are taken by complex steps.
#
# ## A hydrophone with a charge amplifier

# %%
import numpy as np

import vibrident
from vibrident import Model, ParameterSpec


def element(s, sensitivity, corner, fn, q):
    w = 2 * np.pi * fn
    return sensitivity * s / (s + 2 * np.pi * corner) / (1 + s / (q * w) + (s / w) ** 2)


hydrophone = Model(
    "hydrophone",
    element,
    [
        ParameterSpec("sensitivity", "V/Pa"),
        ParameterSpec("corner", "Hz", start=10.0),
        ParameterSpec("fn", "Hz", start=5000.0),
        ParameterSpec("q", "1", start=5.0, bounds=(0.5, 100.0)),
    ],
)

# %% [markdown]
# Its data, and the identification as of any sensor:

# %%
rng = np.random.default_rng(2)
results = []


def record(response, top_hz, samples=4096):
    """200 tones of whole periods, a response to them, and noise in both channels."""
    rate_hz = 2.8 * top_hz
    bins = np.unique(np.geomspace(3, top_hz / rate_hz * samples, 200).astype(int))
    hz = bins * rate_hz / samples
    turns = np.exp(
        2j * np.pi * (np.outer(np.arange(samples) / rate_hz, hz) + rng.random(bins.size))
    )
    channels = np.sum(turns, axis=1).real, (turns @ response(2j * np.pi * hz)).real
    noise = np.std(channels, axis=1)[:, None] * rng.standard_normal((2, samples))
    return *(channels + np.array([[0.001], [0.002]]) * noise), rate_hz


def identified(model, truth, unit, top_hz):
    """Identify a model by a record of its own response at true values."""
    data = record(lambda s: model.response(s, **truth), top_hz)
    calibration = vibrident.Calibration.from_arrays(
        *data, quantity="drive", reference_unit=unit, excitation="multisine"
    )
    results.append((vibrident.identify(calibration, model=model), truth))
    return results[-1][0]


truth = {"sensitivity": 2e-4, "corner": 25.0, "fn": 7000.0, "q": 8.0}
result = identified(hydrophone, truth, "Pa", 9000.0)
print(result.summary())


# %% [markdown]
# ## A loudspeaker, by the motion of its cone
#
# The reference is the voltage. What was measured otherwise is a number in the formula: here
# the mechanical quality, of a free decay with the coil open.

# %%
q_mechanical = 7.04


def cone(s, compliance, fs, q_electrical, coil_time):
    w = 2 * np.pi * fs
    mechanics = 1 + s / (w * q_mechanical) + s**2 / w**2
    return compliance / ((1 + s * coil_time) * mechanics + s / (w * q_electrical))


loudspeaker = Model(
    "loudspeaker",
    cone,
    [
        ParameterSpec("compliance", "m/V"),
        ParameterSpec("fs", "Hz", start=50.0, bounds=(10.0, 300.0)),
        ParameterSpec("q_electrical", "1", start=0.5, bounds=(0.1, 5.0)),
        ParameterSpec("coil_time", "s", start=1e-4, bounds=(1e-5, 1e-3)),
    ],
)
truth = {"compliance": 3.1e-4, "fs": 61.6, "q_electrical": 1.38, "coil_time": 2.3e-4}
result = identified(loudspeaker, truth, "V", 1000.0)
print(result.summary())

# %% [markdown]
# ## A pressure line, which is late
#
# The travel time is no ratio of polynomials; it is written as it is.

# %%
line = Model(
    "pressure-line",
    lambda s, gain, lag, travel: gain * np.exp(-s * travel) / (1 + s * lag),
    [
        ParameterSpec("gain", "V/Pa"),
        ParameterSpec("lag", "s", start=1e-3),
        ParameterSpec("travel", "s", start=5e-3, bounds=(0.0, 0.02)),
    ],
)
truth = {"gain": 1e-3, "lag": 2e-3, "travel": 6.3e-3}
result = identified(line, truth, "Pa", 300.0)
print(result.summary())

# %% [markdown]
# ## Afterwards
#
# The result states the formula, the numbers in it and the parameters. Values, curve, report
# and certificate need nothing else.

# %%
print(result.provenance["model"]["formula"])

# %% [markdown]
# To compute with a result in another session (`to_sensor`, `predict`, `correct`), make the
# model again and give it: `Result.load("result.json", model=line)`. Another formula of the
# same name is refused. Add-ons are joined with a plus: `model=hydrophone + "delay"`.
#
# The command line and the page know models by name, from installed packages: the same object
# is what a package registers ([plug-ins](plug-ins.md)).

# %% [check]
assert len(results) == 3
for each, values in results:
    assert each.fit.adequate
    assert not each.warnings
    for name, true in values.items():
        parameter = each.parameters[name]
        assert abs(parameter.value - true) < 4 * parameter.standard_uncertainty
assert result.provenance["model"]["formula"].startswith(
    "lambda s, gain, lag, travel: gain * np.exp("
)
