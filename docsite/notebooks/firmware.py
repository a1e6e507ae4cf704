# %% [markdown]
# # A sensor in firmware
#
# A microcontroller reads a vibration sensor at 12.8 kHz. The sensor's resonance makes
# what lies above 200 Hz too large. Its lag spoils what the samples are used for. The
# calibration becomes C99 that takes the sensor out again. The C is compiled here, and
# compared with the acceleration that the sensor really saw.

# %% [folded] The data: a calibration and a new motion, simulated
import vibrident

calibration, motion = (
    vibrident.simulate(
        "paper",
        "random",
        samples=samples,
        sampling_rate_hz=12800.0,
        response_noise=noise,
        antialias=True,
        seed=seed,
    )
    for samples, noise, seed in ((16000, 1e-3, 1), (6000, 0.0, 2))
)
(record,) = motion.records
acceleration, voltage = record.reference, record.response

# %%
import vibrident

result = vibrident.identify(calibration)
result

# %% [markdown]
# ## Into C
#
# One call writes a header and a source file. Its first comment says what the filters cost
# and how far they are off, as computed from the coefficients as they are written.

# %%
import textwrap

header, source = vibrident.export(
    result, "c", "firmware", rate_hz=12800.0, band_hz=(10.0, 1000.0)
)
for line in source.read_text().splitlines()[:16]:
    print(textwrap.fill(line, 76, subsequent_indent=" *   "))

# %% [markdown]
# Firmware needs a loop around `sensor_filter_step_f32`, in single precision as on the
# target. Here the loop is a shared library, so that Python can feed it:
# `gcc -std=c99 -O2 -shared -fPIC -o sensor.so sensor.c loop.c`.

# %%
loop = """
#include "sensor.h"
int latency(void) { return SENSOR_CORRECTION_LATENCY; }
void correct(const float *x, float *y, int n) {
    sensor_filter_f32 f;
    sensor_filter_init_f32(&f, &sensor_correction_f32);
    for (int k = 0; k < n; k++) y[k] = sensor_filter_step_f32(&f, x[k]);
}
"""

# %% [folded] Compile it and run it on the new motion
import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np

Path("firmware/loop.c").write_text(loop)
compiler = shutil.which("cc") or shutil.which("gcc")
if compiler:
    flags = "-std=c99 -Wall -Wextra -Werror -pedantic -O2 -shared -fPIC"
    files = [str(source), "firmware/loop.c", "-o", "firmware/sensor.so"]
    subprocess.run([compiler, *flags.split(), *files], check=True)
    library = ctypes.CDLL(str(Path("firmware/sensor.so").absolute()))
    samples = voltage.astype(np.float32)
    corrected = np.empty_like(samples)
    pointer = ctypes.POINTER(ctypes.c_float)
    library.correct(
        samples.ctypes.data_as(pointer),
        corrected.ctypes.data_as(pointer),
        len(samples),
    )
    late = library.latency()
    print(f"corrected samples are {late} samples late")
    print(f"that is {1e3 * late / 12800.0:.2f} ms")
else:
    late = 0
    corrected = voltage
    print("left out: there is no C compiler on this machine")

# %% [markdown]
# ## Is it right?
#
# Two ways to an acceleration: the voltage divided by the sensitivity, as many do, and the
# corrected sample. Both are compared with the true motion from 10 Hz to 1 kHz. The
# resonance lies in this band.

# %%
hz = np.fft.rfftfreq(len(voltage), 1 / 12800.0)
band = (hz > 10) & (hz < 1000)
ways = {
    "true": acceleration,
    "divided": voltage / result.parameters["sensitivity"].value,
    "corrected in C": np.roll(corrected, -late),
}
inside = {
    name: np.fft.irfft(np.fft.rfft(values) * band)[500:-500]
    for name, values in ways.items()
}
errors = {}
for name in ("divided", "corrected in C"):
    difference = inside[name] - inside["true"]
    errors[name] = np.std(difference) / np.std(inside["true"])
    print(f"{name:15} error {100 * errors[name]:6.2f} %")

# %%
import matplotlib.pyplot as plt

figure, axis = plt.subplots(figsize=(7, 3.4), layout="constrained")
time = 1e3 * np.arange(300) / 12800.0
looks = ({"color": "k", "lw": 3, "alpha": 0.3}, {}, {"ls": "--"})
for (name, values), look in zip(inside.items(), looks):
    axis.plot(time, values[:300], label=name, **look)
axis.set(
    xlabel="Time in ms",
    ylabel="Acceleration in m/s²",
    title="A new motion, 10 Hz to 1 kHz",
)
figure.legend(ncols=3, loc="outside lower center", frameon=False)
axis.grid(alpha=0.3)

# %% [markdown]
# ## Sensors age
#
# `online=True` writes the tracker in the same way. It learns the parameters while a
# reference is there, says when they change, and corrects with those of the moment
# ([tracking](tracking.md)). As a block for a simulation the same sensor is
# `export --format fmu` ([exports](exports.md)).

# %%
files = vibrident.export(
    result, "c", "online", rate_hz=12800.0, online=True
)
for file in files:
    print(file)

# %% [check]
sensitivity = result.parameters["sensitivity"].value
assert abs(sensitivity / (1.02 / 9.80665) - 1) < 1e-3
assert errors["divided"] > 0.3
if compiler:
    assert errors["corrected in C"] < 0.01
