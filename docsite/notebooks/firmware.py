# %% [markdown]
# # A sensor in firmware
#
# A microcontroller reads a vibration sensor at 12.8 kHz. Its resonance makes what lies
# above 200 Hz too large, and its lag spoils what the samples are used for. The
# calibration is turned into C99 that takes the sensor out again, compiled here, and
# compared with the acceleration that the sensor really saw.

# %%
import ctypes
import shutil
import subprocess
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import vibrident
from vibrident.export import export

RATE_HZ = 12800.0
calibration = vibrident.simulate(
    "paper",
    "random",
    samples=16000,
    sampling_rate_hz=RATE_HZ,
    response_noise=1e-3,
    antialias=True,
    seed=1,
)
result = vibrident.identify(calibration)
result

# %% [markdown]
# One call writes a header and a source file. The comment in it says what the filters cost
# and how far they are off, as computed from the coefficients as they are written.

# %%
header, source = export(result, "c", "firmware", rate_hz=RATE_HZ, band_hz=(10.0, 1000.0))
comment = source.read_text().split("*/")[0]
print("\n".join(comment.splitlines()[:16]))

# %% [markdown]
# A loop around `sensor_filter_step_f32`, in single precision as on the target, is all
# that firmware needs. Here it is a shared library, so that Python can feed it with a new
# motion.

# %%
HARNESS = """
#include "sensor.h"
int latency(void) { return SENSOR_CORRECTION_LATENCY; }
void correct(const float *x, float *y, int n) {
    sensor_filter_f32 f;
    sensor_filter_init_f32(&f, &sensor_correction_f32);
    for (int k = 0; k < n; k++) y[k] = sensor_filter_step_f32(&f, x[k]);
}
"""
compiler = shutil.which("cc") or shutil.which("gcc")
ours = vibrident.simulate(
    "paper", "random", samples=6000, sampling_rate_hz=RATE_HZ, antialias=True, seed=2
).records[0]
if compiler:
    Path("firmware/harness.c").write_text(HARNESS)
    flags = [
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-pedantic",
        "-O2",
        "-shared",
        "-fPIC",
    ]
    subprocess.run(
        [compiler, *flags, str(source), "firmware/harness.c", "-o", "firmware/sensor.so"],
        check=True,
    )
    library = ctypes.CDLL(str(Path("firmware/sensor.so").absolute()))
    volt = ours.response.astype(np.float32)
    corrected = np.empty_like(volt)
    pointers = [
        array.ctypes.data_as(ctypes.POINTER(ctypes.c_float)) for array in (volt, corrected)
    ]
    library.correct(*pointers, len(volt))
    late = library.latency()
    print(f"the corrected samples are {late} samples ({1e3 * late / RATE_HZ:.2f} ms) late")
else:
    print("left out: there is no C compiler on this machine")

# %% [markdown]
# Compared in the band of the corrector: the sample divided by the sensitivity, as many
# do, and the corrected sample. The resonance lies in this band, so the first is no
# acceleration at all.


# %%
def in_band(values):
    """From 10 Hz to 1 kHz."""
    hz = np.fft.rfftfreq(len(values), 1 / RATE_HZ)
    return np.fft.irfft(np.fft.rfft(values) * ((hz > 10) & (hz < 1000)), len(values))


if compiler:
    keep = slice(500, -500)
    truth = in_band(ours.reference)[keep]
    plain = in_band(ours.response / result.parameters["sensitivity"].value)[keep]
    right = in_band(np.roll(corrected, -late))[keep]
    errors = [float(np.std(each - truth) / np.std(truth)) for each in (plain, right)]
    print(
        f"error beside the true acceleration: divided {100 * errors[0]:.0f} %, corrected {100 * errors[1]:.2f} %"
    )
    time = 1e3 * np.arange(300) / RATE_HZ
    figure, axis = plt.subplots(figsize=(7, 3.4), layout="constrained")
    axis.plot(time, truth[:300], "k", lw=3, alpha=0.3, label="true")
    axis.plot(time, plain[:300], label="divided by the sensitivity")
    axis.plot(time, right[:300], "--", label="corrected in C, float")
    axis.set(
        xlabel="Time in ms",
        ylabel="Acceleration in m/s²",
        title="A new motion, 10 Hz to 1 kHz",
    )
    axis.legend(ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.2), frameon=False)

# %% [markdown]
# Sensors age. `export --online` writes the tracker in the same way: it learns the
# parameters while a reference is there, says when they change, and corrects with those of
# the moment ([tracking](tracking.md)). As a block for a simulation the same sensor is
# `export --format fmu` ([exports](exports.md)).

# %%
print(
    ", ".join(
        path.name for path in export(result, "c", "online", rate_hz=RATE_HZ, online=True)
    )
)

# %% [check]
assert abs(result.parameters["sensitivity"].value / (1.02 / 9.80665) - 1) < 1e-3
if compiler:
    assert errors[0] > 0.3
    assert errors[1] < 0.01
