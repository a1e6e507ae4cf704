# %% [markdown]
# # A seismometer
#
# A seismometer of 1 Hz stands on a table. A laser measures the table's displacement. The
# observatory needs two things: the sensor's response in StationXML, and ground motion
# from its voltage.

# %% [folded] The data: a calibration and an event, simulated
from dataclasses import replace

import numpy as np

import vibrident

true = {
    "generator_constant": 200.0,
    "natural_frequency": 1.0,
    "damping_ratio": 0.70,
}
rate_hz = 100.0
simulated = vibrident.simulate(
    ("velocity-pickup", true),
    frequencies_hz=np.geomspace(0.2, 10.0, 9),
    sampling_rate_hz=rate_hz,
    samples=4000,
    amplitude=1e-2,
    quantity="displacement",
    reference_noise=1e-4,
    response_noise=1e-3,
    start="steady",
    seed=3,
)
calibration = replace(
    simulated,
    reference_standard_uncertainty=2e-3,
    sensor={
        "manufacturer": "simulated",
        "type": "S-1",
        "serial_number": "7",
    },
)

# An event of the ground from 0.3 to 5 Hz, and what the coil gives of it.
rng = np.random.default_rng(5)
time = np.arange(6000) / rate_hz
hz = np.fft.rfftfreq(6000, 1 / rate_hz)
spectrum = np.fft.rfft(rng.normal(size=6000)) * ((hz > 0.3) & (hz < 5))
envelope = np.maximum(time - 15, 0) * np.exp(-np.maximum(time - 15, 0) / 3)
ground = 1e-4 * envelope * np.fft.irfft(spectrum, 6000)
hz = np.fft.rfftfreq(12000, 1 / rate_hz)[1:]
model = vibrident.parse_model("velocity-pickup")
spectrum = np.fft.rfft(ground, 12000)
spectrum[0] = 0.0
spectrum[1:] *= model.frequency_response(true, hz)
voltage = np.fft.irfft(spectrum, 12000)[:6000]
voltage += 1e-6 * rng.normal(size=6000)

# %%
import vibrident

result = vibrident.identify(calibration)
result

# %% [markdown]
# The laser gives displacement, and the coil answers to velocity. Nothing is
# differentiated: the model takes jω along.
#
# ## Into StationXML
#
# The file holds poles, zeros and gain. ObsPy reads it back. It knows nothing of this
# package.

# %%
import numpy as np
from obspy import read_inventory

channel = "XX.DEMO.00.EHZ"
(file,) = vibrident.export(result, "stationxml", "out", channel=channel)
response = read_inventory(str(file))[0][0][0].response

frequency = np.array([0.2, 1.0, 5.0])
theirs = response.get_evalresp_response_for_frequencies(
    frequency, output="ACC"
)
ours = result.to_sensor().frequency_response(frequency)
print("    Hz    ObsPy, V/(m/s²)       vibrident, V/(m/s²)")
for hz, *values in zip(frequency, theirs, ours):
    cells = (f"{abs(v):9.5f} {np.angle(v, deg=True):8.3f}°" for v in values)
    print(f"{hz:6.1f}", *cells, sep="   ")

# %% [markdown]
# ## Ground motion from the coil
#
# An event shakes the simulated ground. The coil feels it, with a noise of 1 µV.
# [`correct`](correct.md) restores the acceleration, with a standard uncertainty for each
# sample.

# %%
event = vibrident.Calibration.from_arrays(
    None, voltage, 100.0, excitation="decay", model="velocity-pickup"
)
restoring = vibrident.correct(result, event, band_hz=(0.2, 10.0))
(restored,) = restoring.corrections

difference = restored.acceleration - ground
u = restored.standard_uncertainty
inside = np.mean(np.abs(difference / u)[500:-500] < 2)
peak = np.argmax(np.abs(ground))
print(f"true peak   {1e6 * ground[peak]:7.1f} µm/s²")
print(f"restored    {1e6 * restored.acceleration[peak]:7.1f} µm/s²")
print(f"u           {1e6 * u[peak]:7.1f} µm/s²")
print(f"{inside:.0%} of the samples are within 2 u of the true ground")

# %%
import matplotlib.pyplot as plt

figure, axes = plt.subplots(2, figsize=(7, 4.4), layout="constrained")
micro = 1e6
axes[0].plot(time, micro * ground, "k", lw=2.5, alpha=0.3, label="true")
axes[0].plot(time, micro * restored.acceleration, lw=0.8, label="restored")
axes[0].set(ylabel="Ground in µm/s²", title="An event, restored")
axes[0].legend(loc="upper left", frameon=False)
axes[1].plot(time, micro * difference, lw=0.8)
axes[1].fill_between(time, -2 * micro * u, 2 * micro * u, alpha=0.25, lw=0)
axes[1].set(xlabel="Time in s", ylabel="Difference, ±2 u")
for axis in axes:
    axis.set_xlim(10, 40)
    axis.grid(alpha=0.3)

# %% [check]
for name, value in true.items():
    parameter = result.parameters[name]
    assert abs(parameter.value - value) < 4 * parameter.standard_uncertainty
assert np.allclose(theirs, ours, rtol=1e-4)
assert inside > 0.9
