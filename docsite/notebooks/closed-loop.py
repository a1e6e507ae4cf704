# %% [markdown]
# # Closing the loop
#
# A sensor in a control loop adds its own lag, and its resonance, to the loop. Here a
# corrector takes them out. Then the sensor drifts. What is left of the loop's margin, with
# a corrector that stays as it was, and with one that follows `vibrident.track`?
#
# The loop controls the acceleration of a table. Amplifier and coil follow up to 2 kHz. The
# controller needs 100 µs to compute. The accelerometer's resonance lies in the band that
# one would like to control.

# %% [folded] The data: random motion of the table, simulated while the sensor drifts
import numpy as np

import vibrident

# In twelve steps the resonance falls by a quarter and the damping by half.
# The sensitivity rises by 5 %. The first record is the calibration.
drift = np.linspace(0, 1, 13)
sensors = [
    {
        "sensitivity": 0.104 * (1 + 0.05 * part),
        "natural_frequency": 652.0 * (1 - 0.25 * part),
        "damping_ratio": 0.182 * (1 - 0.5 * part),
    }
    for part in drift
]
samples = 16000
rate_hz = 20e3
rng = np.random.default_rng(1)
hz = np.fft.rfftfreq(samples, 1 / rate_hz)
model = vibrident.parse_model("accelerometer")
records = []
for sensor in [sensors[0], *sensors]:
    phases = np.exp(2j * np.pi * rng.random(hz.size))
    lines = ((hz > 20) & (hz < 3000)) * phases
    response = lines.copy()
    response[1:] *= model.frequency_response(sensor, hz[1:])
    motion = np.fft.irfft(lines)
    voltage = np.fft.irfft(response)
    voltage += 0.01 * np.std(voltage) * rng.normal(size=samples)
    records.append((motion / np.std(motion), voltage / np.std(motion)))
first, *later = records
calibration = vibrident.Calibration.from_arrays(
    *first, rate_hz, excitation="random", model="accelerometer"
)

# %%
import vibrident

result = vibrident.identify(calibration)
result

# %% [markdown]
# ## The loop
#
# `result.to_sensor().to_control()` is the sensor as a transfer function of python-control.
# Its inverse is the corrector, made proper by a filter of second order at 4 kHz. The
# controller is an integrator.

# %%
import control
import numpy as np

s = control.tf("s")
delay = control.tf(*control.pade(100e-6, 3))
table = delay / (1 + s / (2 * np.pi * 2000))

sensor = result.to_sensor().to_control()
corner = 2 * np.pi * 4000
filtered = corner**2 / (s**2 + 2 * 0.7 * corner * s + corner**2)
fixed = filtered / sensor

plain = table * sensor / result.parameters["sensitivity"].value
corrected = table * sensor * fixed

# %% [markdown]
# The modulus margin is the least distance |1 + L| of the loop L from −1. Zero is a loop
# that is not stable. The integrator is made as fast as a margin of 0.5 allows:

# %%
w = 2 * np.pi * np.geomspace(5, 9000, 4000)


def modulus_margin(loop):
    """Return the least distance of a loop from −1; 0 if unstable."""
    stable = np.all(control.feedback(loop, 1).poles().real < 0)
    return float(np.min(np.abs(1 + loop(1j * w)))) if stable else 0.0


def fastest_integrator(plant):
    """Return the crossover in Hz that leaves a margin of 0.5."""
    low = 1.0
    high = 3000.0
    for _ in range(40):
        middle = np.sqrt(low * high)
        if modulus_margin(2 * np.pi * middle / s * plant) >= 0.5:
            low = middle
        else:
            high = middle
    return low


slow = fastest_integrator(plain)
fast = fastest_integrator(corrected)
margin_plain = modulus_margin(2 * np.pi * fast / s * plain)
margin_slow = modulus_margin(2 * np.pi * slow / s * corrected)
print("crossover with a margin of 0.5")
print(f"    without a corrector   {slow:5.0f} Hz")
print(f"    with the corrector    {fast:5.0f} Hz")
print("modulus margin")
print(f"    at {fast:.0f} Hz without it   {margin_plain:.2f}")
print(f"    at {slow:.0f} Hz with it       {margin_slow:.2f}")

# %%
import matplotlib.pyplot as plt

figure, axes = plt.subplots(2, figsize=(7, 5), layout="constrained")
for loop, label in ((plain, "without"), (corrected, "with")):
    values = (2 * np.pi * slow / s * loop)(1j * w)
    phase = np.rad2deg(np.unwrap(np.angle(values)))
    axes[0].loglog(w / (2 * np.pi), np.abs(values), label=label)
    axes[1].semilogx(w / (2 * np.pi), phase)
axes[0].set(ylabel="|L|", ylim=(1e-2, 20))
axes[0].set_title(f"Open loop with and without corrector, {slow:.0f} Hz")
axes[0].legend()
axes[1].set(xlabel="Frequency in Hz", ylabel="Phase in °")
axes[1].set(ylim=(-540, 0), yticks=range(-540, 1, 90))
for axis in axes:
    axis.grid(alpha=0.3)

# %% [markdown]
# ## The sensor drifts
#
# In twelve steps the resonance falls by a quarter and the damping by half. The sensitivity
# rises by 5 %. At each step the tracker gets 0.8 s of motion, with a reference as a laser
# gives it. The adaptive corrector takes its parameters. The loop stays the fast one.

# %%
tracker = vibrident.SensorTracker(result, 20e3)
margins = []
for (motion, voltage), true in zip(later, sensors):
    tracker.feed(motion, voltage, new_record=True)
    tracker.finish()
    systems = []
    for values in (true, tracker.read().values):
        natural = 2 * np.pi * values["natural_frequency"]
        loss = 2 * values["damping_ratio"] * natural
        gain = values["sensitivity"] * natural**2
        systems.append(gain / (s**2 + loss * s + natural**2))
    now, model_response = systems
    loop = 2 * np.pi * fast / s * table * now
    followed = filtered / model_response
    margins.append([modulus_margin(loop * c) for c in (fixed, followed)])
margins = np.array(margins)
print(f"alarms                      {len(tracker.alarms)}")
print(f"margin, fixed corrector     {margins[-1, 0]:.2f}")
print(f"margin, adaptive corrector  {margins[-1, 1]:.2f}")

# %%
figure, axis = plt.subplots(figsize=(7, 3.4), layout="constrained")
axis.plot(100 * drift, margins[:, 0], "o-", label="fixed corrector")
axis.plot(100 * drift, margins[:, 1], "s-", label="adaptive corrector")
axis.set(xlabel="Drift in % of its whole", ylabel="Modulus margin")
axis.set(ylim=(-0.03, 0.6), title="While the sensor drifts")
axis.axhline(0, color="0.5")
axis.legend(loc="lower left")
axis.grid(alpha=0.3)

# %% [markdown]
# The tracker says each change as an alarm, so that a loop whose corrector must not follow
# can be slowed down in time. Those of the first step:

# %%
for alarm in tracker.alarms[:3]:
    change = f"{alarm.before:.5g} → {alarm.after:.5g}"
    print(f"{alarm.time_s:.2f} s  {alarm.parameter:18} {change}")

# %% [markdown]
# The corrector of [`export --online`](tracking.md#in-firmware) has a linear phase. It is
# late by a fixed number of samples, and suits records and displays rather than fast loops.

# %% [check]
assert fast > 2 * slow
assert margin_plain < 0.25
assert margin_slow > 0.75
assert margins[-1, 0] < 0.25
assert np.all(np.abs(margins[:, 1] - 0.5) < 0.02)
assert tracker.alarms
