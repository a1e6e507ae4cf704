# %% [markdown]
# # Closing the loop
#
# A sensor in a control loop adds its own lag, and its resonance, to the loop. This page
# designs a controller with the model that `identify` found, lets a corrector take the
# sensor's lag out, and shows what is left of the margin when the sensor drifts: with a
# corrector that stays as it was, and with one that follows `vibrident track`. It is
# executed whenever this site is built; all data are simulated.
#
# The loop controls the acceleration of a table: an amplifier and a coil that follow up to
# 2 kHz, a controller with 100 µs of computing time, and an accelerometer whose resonance
# lies in the band that one would like to control.

# %%
import control
import matplotlib.pyplot as plt
import numpy as np

import vibrident
from vibrident.data.sources.source import Chunk
from vibrident.physics.models import parse
from vibrident.use.tracking.session import Session
from vibrident.use.tracking.state import Settings

RATE_HZ, SAMPLES = 20e3, 16000
NEW = {"sensitivity": 0.104, "natural_frequency": 652.0, "damping_ratio": 0.182}
rng = np.random.default_rng(1)


def motion_and_response(values):
    """Random motion from 20 Hz to 3 kHz, in m/s², and the sensor's response to it in V, with 1 % noise."""
    hz = np.fft.rfftfreq(SAMPLES, 1 / RATE_HZ)
    lines = (np.abs(hz - 1510) < 1490) * np.exp(2j * np.pi * rng.random(hz.size))
    response = parse("accelerometer").frequency_response(values, np.maximum(hz, 1.0))
    u, y = np.fft.irfft(lines, SAMPLES), np.fft.irfft(lines * response, SAMPLES)
    scale = np.std(u)
    return u / scale, (y + 0.01 * np.std(y) * rng.normal(size=SAMPLES)) / scale


motion, response = motion_and_response(NEW)
calibration = vibrident.Calibration.from_arrays(
    motion, response, RATE_HZ, excitation="random", model="accelerometer"
)
result = vibrident.identify(calibration)
print("\n".join(f"{name}: {result.parameters[name].value:.6g}" for name in NEW))

# %% [markdown]
# ## The controller, without and with a corrector
#
# The sensor is `result.to_sensor().to_control()`, a transfer function of python-control.
# The corrector is its inverse, made proper by a filter of second order at 4 kHz. (The
# corrector of [`export --online`](tracking.md#in-firmware) has a linear phase and is late
# by a fixed number of samples: it suits records and displays rather than fast loops.) The
# controller is an integrator, set so that nothing comes nearer to −1 than 0.5: the
# modulus margin, the least distance |1 + L| of the loop from −1.

# %%
s = control.tf("s")
numerator, denominator = control.pade(100e-6, 3)
table = control.tf(numerator, denominator) / (1 + s / (2 * np.pi * 2000))
w = 2 * np.pi * np.geomspace(5, 9000, 4000)


def sensor_of(values):
    """The sensor as python-control's transfer function."""
    natural = 2 * np.pi * values["natural_frequency"]
    gain, damping = values["sensitivity"], values["damping_ratio"]
    return gain * natural**2 / (s**2 + 2 * damping * natural * s + natural**2)


def corrector(sensor):
    """Its inverse, with a filter of second order."""
    corner = 2 * np.pi * 4000
    return 1 / sensor * corner**2 / (s**2 + 2 * 0.7 * corner * s + corner**2)


def modulus_margin(loop):
    """Least distance of a loop from −1; 0 where the closed loop is not stable."""
    stable = np.all(control.feedback(loop, 1).poles().real < 0)
    return float(np.min(np.abs(1 + loop(1j * w)))) if stable else 0.0


def integrator(rest, wanted=0.5):
    """The fastest integrator that leaves the wanted modulus margin, by bisection of its crossover in Hz."""
    low, high = 1.0, 3000.0
    for _ in range(40):
        middle = np.sqrt(low * high)
        low, high = (
            (middle, high)
            if modulus_margin(2 * np.pi * middle / s * rest) >= wanted
            else (low, middle)
        )
    return low


identified = result.to_sensor().to_control()
plain = table * identified / result.parameters["sensitivity"].value
fixed = corrector(identified)
corrected = table * identified * fixed
slow, fast = integrator(plain), integrator(corrected)
print(
    f"crossover without a corrector {slow:.0f} Hz, with it {fast:.0f} Hz, both with a modulus margin of 0.5"
)
at_fast = modulus_margin(2 * np.pi * fast / s * plain)
print(
    f"at {fast:.0f} Hz without it: "
    + (f"modulus margin {at_fast:.2f}" if at_fast else "unstable")
)
gained = modulus_margin(2 * np.pi * slow / s * corrected)
print(f"margin gained at {slow:.0f} Hz: {0.5:.2f} -> {gained:.2f}")

# %%
figure, axes = plt.subplots(2, 1, sharex=True, figsize=(7, 5), layout="constrained")
for loop, label in ((plain, "without a corrector"), (corrected, "with the corrector")):
    values = (2 * np.pi * slow / s * loop)(1j * w)
    axes[0].loglog(w / (2 * np.pi), np.abs(values), label=label)
    axes[1].semilogx(w / (2 * np.pi), np.rad2deg(np.unwrap(np.angle(values))))
axes[0].set(ylabel="|L|", ylim=(1e-2, 20), title=f"Open loop, integrator of {slow:.0f} Hz")
axes[0].legend()
axes[1].set(
    xlabel="Frequency in Hz", ylabel="Phase in °", ylim=(-540, 0), yticks=range(-540, 1, 90)
)
for axis in axes:
    axis.grid(alpha=0.3)

# %% [markdown]
# ## The sensor drifts
#
# In twelve steps the resonance falls by a quarter and the damping by half, and the
# sensitivity rises by 5 %. At each step the tracker gets 0.8 s of motion with a
# reference, as a laser gives it, and the adaptive corrector takes its parameters. The
# loop is the fast one throughout.

# %%
session = Session.from_result(result, RATE_HZ, "acceleration", 1.0, Settings())
share, margins = np.linspace(0, 1, 13), []
for part in share:
    now = {
        "sensitivity": NEW["sensitivity"] * (1 + 0.05 * part),
        "natural_frequency": NEW["natural_frequency"] * (1 - 0.25 * part),
        "damping_ratio": NEW["damping_ratio"] * (1 - 0.5 * part),
    }
    session.take(Chunk(*motion_and_response(now), separate=True))
    session.tracker.finish()
    followed = corrector(sensor_of(session.tracker.read().values))
    rest = 2 * np.pi * fast / s * table * sensor_of(now)
    margins.append([modulus_margin(rest * each) for each in (fixed, followed)])
margins = np.array(margins)
print(f"alarms: {len(session.alarms)}, the first: {session.alarms[0].what}")
print(
    f"modulus margin at the end: fixed {margins[-1, 0]:.2f}, adaptive {margins[-1, 1]:.2f}"
)

# %%
figure, axis = plt.subplots(figsize=(7, 3.4), layout="constrained")
axis.plot(100 * share, margins[:, 0], "o-", label="fixed corrector")
axis.plot(100 * share, margins[:, 1], "s-", label="adaptive corrector")
axis.set(
    xlabel="Drift in % of its whole",
    ylabel="Modulus margin",
    ylim=(-0.03, 0.6),
    title="While the sensor drifts",
)
axis.axhline(0, color="0.5")
axis.legend(loc="lower left")
axis.grid(alpha=0.3)

# %% [markdown]
# Zero is a loop that is not stable. The tracker says each step of the drift as an alarm,
# so that a loop whose corrector must not follow can be slowed down in time.

# %% [check]
assert fast > 2 * slow
assert at_fast < 0.25
assert gained > 0.75
assert margins[-1, 0] < 0.25
assert np.all(np.abs(margins[:, 1] - 0.5) < 0.02)
