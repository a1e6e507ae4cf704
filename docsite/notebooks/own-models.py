# %% [markdown]
# # A model of your own: three models of other people
#
# Any sensor whose response is a function of frequency can be identified. A model is one
# object: a name, the response as a formula of s, and the parameters. This page writes
# three, of about ten lines each: a convective accelerometer, a loudspeaker, and a geophone
# whose coil has an inductance.
#
# The data come from each sensor's equations of motion, ẋ = A x + B u and y = C x. No
# formula of the models is in them. So each model can be judged against a truth.

# %% [folded] The data: three sensors, simulated from their equations of motion
import numpy as np

import vibrident

# A convective accelerometer: heated gas follows the motion, late.
rate = 2 * np.pi * 35.0
convective = [[-rate]], [rate], [0.1]

# A loudspeaker: position and velocity of the cone, and the current.
force = 6.0  # N/A
resistance = 6.4  # Ω
inductance = 1.5e-3  # H
mass = 0.02  # kg
loss = 1.1  # N s/m
stiffness = 3000.0  # N/m
loudspeaker = (
    [
        [0, 1, 0],
        [-stiffness / mass, -loss / mass, force / mass],
        [0, -force / inductance, -resistance / inductance],
    ],
    [0, 0, 1 / inductance],
    [1, 0, 0],
)
q_mechanical = np.sqrt(stiffness * mass) / loss
w = np.sqrt(stiffness / mass)
cone_truth = {
    "compliance": force / (resistance * stiffness),
    "fs": w / (2 * np.pi),
    "q_electrical": w * mass * resistance / force**2,
    "coil_time": inductance / resistance,
}

# A geophone: position and velocity of the mass, and the current.
constant = 27.0  # V/(m/s)
moving_mass = 0.011  # kg
coil = 395.0  # Ω
load = 1000.0  # Ω
coil_inductance = 0.6  # H
w = 2 * np.pi * 10.0
geophone = (
    [
        [0, 1, 0],
        [-(w**2), -2 * 0.25 * w, -constant / moving_mass],
        [0, constant / coil_inductance, -(coil + load) / coil_inductance],
    ],
    [0, 1, 0],
    [0, 0, load],
)
coil_truth = {
    "constant": constant * load / (coil + load),
    "fn": 10.0,
    "coil_damping": constant**2 / (moving_mass * (coil + load)),
    "coil_time": coil_inductance / (coil + load),
}

truths = {
    "convective": {"gain": 0.1, "cutoff": 35.0},
    "loudspeaker": cone_truth,
    "geophone": coil_truth,
}
sensors = {
    "convective": (convective, 400.0, {}),
    "loudspeaker": (
        loudspeaker,
        1000.0,
        {"quantity": "drive", "reference_unit": "V", "response_unit": "m"},
    ),
    "geophone": (geophone, 800.0, {}),
}
rng = np.random.default_rng(2)
samples = 4096
calibrations = {}
for name, ((a, b, c), top_hz, more) in sensors.items():
    sampling_rate_hz = 2.8 * top_hz
    hz = np.fft.rfftfreq(samples, 1 / sampling_rate_hz)
    lines = np.unique(np.geomspace(3, samples / 2.8, 200).astype(int))
    motion = np.zeros(hz.size, complex)
    motion[lines] = np.exp(2j * np.pi * rng.random(lines.size))
    s = 2j * np.pi * hz[:, None, None]
    states = np.linalg.solve(s * np.eye(len(b)) - a, np.c_[b])[..., 0]
    channels = np.fft.irfft([motion, motion * (states @ c)], samples)
    noise = rng.standard_normal(channels.shape) * [[0.001], [0.002]]
    channels += noise * channels.std(axis=1, keepdims=True)
    calibrations[name] = vibrident.Calibration.from_arrays(
        *channels, sampling_rate_hz, excitation="multisine", **more
    )

# %% [markdown]
# ## A convective accelerometer
#
# A bubble of heated gas follows the motion with a lag of first order.

# %%
import numpy as np

from vibrident import Model, ParameterSpec, identify

bubble = Model(
    "convective",
    lambda s, gain, cutoff: gain / (1 + s / (2 * np.pi * cutoff)),
    [ParameterSpec("gain", "V/(m/s^2)"), ParameterSpec("cutoff", "Hz")],
)
result = identify(calibrations["convective"], model=bubble)
result

# %% [markdown]
# The true values are 0.1 V/(m/s²) and 35 Hz. What to write:
#
# - **The response** is a function of s and of one keyword a parameter. It is per m/s² of
#   acceleration, or per unit of a reference whose quantity is `drive`, such as a voltage.
# - **One parameter is the gain:** the response is proportional to it. It needs no start.
# - **A frequency in Hz** needs no start either. It is looked for over the band of the
#   data.
# - **Every other parameter** has a start value and, if wished, bounds. Without bounds it
#   is searched up to a thousand times smaller and larger. A value that may be negative
#   needs bounds.
#
# ## A loudspeaker, by the motion of its cone
#
# The reference is the voltage. What was measured otherwise is a number in the formula:
# here the mechanical quality, from a free decay with the coil open.

# %%
q_mechanical = 7.04


def cone(s, compliance, fs, q_electrical, coil_time):
    w = 2 * np.pi * fs
    mechanics = 1 + s / (w * q_mechanical) + s**2 / w**2
    coil = 1 + s * coil_time
    return compliance / (coil * mechanics + s / (w * q_electrical))


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
cone_result = identify(calibrations["loudspeaker"], model=loudspeaker)
cone_result.to_dataframe()[["value", "standard_uncertainty", "unit"]]

# %% [markdown]
# ## A geophone whose coil has an inductance
#
# The usual model, [`velocity-pickup`](models.md), has no inductance. At high frequencies
# it fails, and says so:

# %%
plain = identify(calibrations["geophone"], model="velocity-pickup")
print("adequate:", plain.fit.adequate)
print("warnings:", ", ".join(plain.warning_codes))

# %% [markdown]
# With the coil in the formula it fits. The damping of the open coil, 0.25, was measured
# by a free decay.


# %%
def coil(s, constant, fn, coil_damping, coil_time):
    w = 2 * np.pi * fn
    mechanics = s**2 + 2 * 0.25 * w * s + w**2
    total = (1 + s * coil_time) * mechanics + s * coil_damping
    return constant * s / total


geophone = Model(
    "geophone-coil",
    coil,
    [
        ParameterSpec("constant", "V/(m/s)"),
        ParameterSpec("fn", "Hz"),
        ParameterSpec("coil_damping", "1/s", start=30.0),
        ParameterSpec("coil_time", "s", start=1e-4),
    ],
)
coil_result = identify(calibrations["geophone"], model=geophone)
coil_result.to_dataframe()[["value", "standard_uncertainty", "unit"]]

# %% [markdown]
# ## Are they right?
#
# Each error, divided by the u that was stated for it. Values within ±2 are as they should
# be.

# %%
results = {
    "convective": result,
    "loudspeaker": cone_result,
    "geophone": coil_result,
}
print("sensor       parameter     true         error / u")
errors = {}
for sensor, truth in truths.items():
    for name, true in truth.items():
        parameter = results[sensor].parameters[name]
        error = (parameter.value - true) / parameter.standard_uncertainty
        errors[sensor, name] = error
        print(f"{sensor:13}{name:14}{true:<13.5g}{error:+.1f}")

# %% [markdown]
# ## Afterwards
#
# The result states the formula, the numbers in it and the parameters. Report and
# certificate need nothing else.

# %%
print(coil_result.provenance["model"]["formula"])

# %% [markdown]
# - **In another session:** make the model again and give it:
#   `Result.load("result.json", model=geophone)`. Another formula of the same name is
#   refused.
# - **Add-ons** are joined with a plus: `model=geophone + "delay"`.
# - **A ratio of polynomials**, in Python's operators, becomes exact poles and zeros. Any
#   other function, with NumPy's `exp` or `sqrt`, acts as a filter on the reference. It
#   must be analytic, without `abs`, `real` and `imag`.
# - **The command line** knows models by name, from installed packages. The same object is
#   what a package registers ([plug-ins](plug-ins.md)).

# %% [check]
assert not plain.fit.adequate
assert "lack_of_fit" in plain.warning_codes
for result in results.values():
    assert result.fit.adequate
    assert not result.warnings
assert len(errors) == 10
assert max(abs(error) for error in errors.values()) < 3.0
assert abs(q_mechanical / (np.sqrt(60.0) / 1.1) - 1) < 1e-3
