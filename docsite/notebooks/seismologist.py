# %% [markdown]
# # A seismometer
#
# A seismometer of 1 Hz is calibrated on a table whose displacement a laser measures. What
# the observatory needs is its response in StationXML, and ground motion from its counts.
# Table, laser and sensor are simulated here.

# %%

import matplotlib.pyplot as plt
import numpy as np

import vibrident
from vibrident.export import export
from vibrident.physics.models import parse

TRUE = {"generator_constant": 200.0, "natural_frequency": 1.0, "damping_ratio": 0.70}
RATE_HZ = 100.0
simulated = vibrident.simulate(
    ("velocity-pickup", TRUE),
    frequencies_hz=np.geomspace(0.2, 10.0, 9),
    sampling_rate_hz=RATE_HZ,
    samples=4000,
    amplitude=1e-2,
    quantity="displacement",
    reference_noise=1e-4,
    response_noise=1e-3,
    start="steady",
    seed=3,
)
pairs = [(record.reference, record.response) for record in simulated.records]
calibration = vibrident.Calibration.from_arrays(
    *zip(*pairs),
    RATE_HZ,
    quantity="displacement",
    model="velocity-pickup",
    reference_standard_uncertainty=2e-3,
    sensor={"manufacturer": "simulated", "type": "S-1", "serial_number": "7"},
)
result = vibrident.identify(calibration)
result

# %% [markdown]
# The laser gives displacement and the coil answers to velocity. Nothing is
# differentiated: the model takes jω along.
#
# ## Into StationXML
#
# The file holds poles, zeros and gain. It is read back here by ObsPy, which knows nothing
# of this package, and evaluated.

# %%
from obspy import read_inventory

(written,) = export(result, "stationxml", "out", channel="XX.DEMO.00.EHZ")
inventory = read_inventory(str(written))
response = inventory[0][0][0].response
at_hz = np.array([0.2, 1.0, 5.0])
theirs = response.get_evalresp_response_for_frequencies(at_hz, output="ACC")
ours = result.to_sensor().frequency_response(at_hz)
for hz, a, b in zip(at_hz, theirs, ours):
    for program, value in (("ObsPy", a), ("ours", b)):
        print(
            f"{hz:4} Hz, {program:5} {abs(value):9.5f} V/(m/s²), {np.angle(value, deg=True):8.3f}°"
        )

# %% [markdown]
# ## Ground motion from the coil
#
# An event of the simulated ground is felt by the sensor, with a noise of 1 µV.
# [`correct`](correct.md) restores the acceleration, with a standard uncertainty for each
# sample.

# %%
rng = np.random.default_rng(5)
time = np.arange(6000) / RATE_HZ
envelope = np.where(time > 15, (time - 15) * np.exp(-(time - 15) / 3), 0.0)
band = (np.fft.rfftfreq(6000, 1 / RATE_HZ) > 0.3) & (np.fft.rfftfreq(6000, 1 / RATE_HZ) < 5)
ground = envelope * np.fft.irfft(np.fft.rfft(rng.normal(size=6000)) * band, 6000) * 1e-4
hz = np.fft.rfftfreq(12000, 1 / RATE_HZ)
spectrum = np.zeros(hz.size, complex)
spectrum[1:] = np.fft.rfft(ground, 12000)[1:] * parse("velocity-pickup").frequency_response(
    TRUE, hz[1:]
)
coil = np.fft.irfft(spectrum, 12000)[:6000] + 1e-6 * rng.normal(size=6000)
event = vibrident.Calibration.from_arrays(
    None, coil, RATE_HZ, excitation="decay", model="velocity-pickup"
)
(found,) = vibrident.correct(result, event, band_hz=(0.2, 10.0)).corrections
off = (found.acceleration - ground) / found.standard_uncertainty
peak = np.argmax(np.abs(ground))
print(
    f"peak {1e6 * found.acceleration[peak]:.1f} µm/s², u {1e6 * found.standard_uncertainty[peak]:.1f}; "
    f"true {1e6 * ground[peak]:.1f}"
)
inside = np.mean(np.abs(off[500:-500]) < 2)
print(f"{100 * inside:.0f} % of the samples are within 2 u of the true ground")

# %%
figure, axes = plt.subplots(2, 1, figsize=(7, 4.4), sharex=True, layout="constrained")
axes[0].plot(time, 1e6 * ground, "k", lw=2.5, alpha=0.3, label="true")
axes[0].plot(time, 1e6 * found.acceleration, lw=0.8, label="restored")
axes[0].set(ylabel="Ground in µm/s²", title="An event, restored from the coil")
axes[0].legend(loc="upper left", frameon=False)
axes[1].plot(time, 1e6 * (found.acceleration - ground), lw=0.8)
axes[1].fill_between(
    time,
    -2e6 * found.standard_uncertainty,
    2e6 * found.standard_uncertainty,
    alpha=0.25,
    lw=0,
)
axes[1].set(xlabel="Time in s", ylabel="Difference, ±2 u", xlim=(10, 40))
axes[1].grid(alpha=0.3)

# %% [check]
for name, true in TRUE.items():
    parameter = result.parameters[name]
    assert abs(parameter.value - true) < 4 * parameter.standard_uncertainty
assert np.allclose(theirs, ours, rtol=1e-4)
assert inside > 0.9
