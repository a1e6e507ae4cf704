# %% [markdown]
# # A maker's lot
#
# A maker of sensors has each one swept on a shaker beside a reference; the analyser
# leaves a table of the response. Within the shift it must be decided which may be
# shipped. Thirty sensors of a lot are simulated here; one was glued badly and one cable
# is broken. The folder is what the test stand leaves behind: a data file and a
# [calibration file](calibration-file.md) for each sensor.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pyarrow.parquet as parquet

from vibrident.lab.fleet import RunRequest, Local, Orders, run
from vibrident.lab.fleet.limits import read_limits
from vibrident.physics.models import parse

HZ = np.geomspace(10, 1000, 21)
rng = np.random.default_rng(7)
lot = Path("lot")
lot.mkdir()
DESCRIPTION = """[sensor]
type = "A-630"
serial_number = "{serial}"
model = "accelerometer"
[response]
unit = "V"
[table]
file = "{serial}.csv"
frequency = 1
magnitude = 2
phase = 3
magnitude_uncertainty = 4
phase_uncertainty = 5
phase_unit = "deg"
"""
for number in range(30):
    true = {
        "sensitivity": 0.104 * (1 + 0.01 * rng.normal()),
        "natural_frequency": 652.0 * (1 + 0.008 * rng.normal()),
        "damping_ratio": 0.182 * (1 + 0.03 * rng.normal()),
    }
    if number == 11:  # glued badly
        true["natural_frequency"] = 560.0
    size = np.full(HZ.size, 0.003)  # standard uncertainty, relative
    response = parse("accelerometer").frequency_response(true, HZ)
    magnitude = np.abs(response) * (1 + size * rng.normal(size=HZ.size))
    phase = np.rad2deg(np.angle(response) + size * rng.normal(size=HZ.size))
    if number == 23:  # a broken cable
        magnitude = np.zeros(HZ.size)
    columns = np.column_stack(
        [HZ, magnitude, phase, size * np.abs(response), np.rad2deg(size)]
    )
    np.savetxt(
        lot / f"{number:03}.csv",
        columns,
        "%.6g",
        ",",
        header="Hz,V/(m/s^2),deg,u,u",
        comments="",
    )
    (lot / f"{number:03}.toml").write_text(DESCRIPTION.format(serial=f"{number:03}"))

# %% [markdown]
# The limits are a file too. In the shell it would be `vibrident fleet lot --out fleet
# --limits limits.toml`; this is the same in Python.

# %%
Path("limits.toml").write_text("""[[limits]]
type = "A-630"
parameter = "sensitivity"
nominal = 0.104
tolerance_percent = 1.5

[[limits]]
parameter = "natural_frequency"
nominal = 652.0
tolerance = 30.0
""")
outcome = run(RunRequest(["lot"], Orders("fleet"), read_limits(Path("limits.toml"))), Local(2))
table = parquet.read_table("fleet/fleet.parquet").to_pandas()
print(table.status.value_counts().to_string())
print()
for row in table[table.status != "identified"].itertuples():
    print(f"{row.serial_number or row.calibration}: {row.message}")

# %% [markdown]
# The broken cable is a row, not an end of the run. The badly glued sensor was identified
# well: its resonance is simply not where it belongs. Which sensors may be shipped depends
# on the rule. *Simple*: the value lies within its limits. *Beyond doubt* (ISO 14253-1):
# the value lies within them by U, so that no sensor outside the limits passes.

# %%
good = table[table.status == "identified"]
off = np.abs(good.sensitivity / 0.104 - 1)
u = good.sensitivity_u / 0.104
resonance = np.abs(good.natural_frequency - 652.0)
simple = (off <= 0.015) & (resonance <= 30.0)
beyond = (off + 2 * u <= 0.015) & (resonance + 2 * good.natural_frequency_u <= 30.0)
print(
    f"of {len(table)}: {simple.sum()} pass by the simple rule, {beyond.sum()} beyond doubt"
)

# %%
figure, axis = plt.subplots(figsize=(7, 3.6), layout="constrained")
axis.errorbar(
    1e3 * good.sensitivity,
    good.natural_frequency,
    2 * good.natural_frequency_u,
    2e3 * good.sensitivity_u,
    "o",
    ms=4,
)
axis.add_patch(
    plt.Rectangle(
        (1e3 * 0.104 * 0.985, 622.0), 1e3 * 0.104 * 0.03, 60.0, fill=False, ec="C2", lw=1.5
    )
)
axis.annotate(
    "011, glued badly",
    (1e3 * good.sensitivity[good.serial_number == "011"].iloc[0], 560),
    (8, 6),
    textcoords="offset points",
)
axis.set(
    xlabel="Sensitivity in mV/(m/s²)",
    ylabel="Natural frequency in Hz",
    title="The lot, with U, and its limits",
)
axis.grid(alpha=0.3)

# %% [markdown]
# Repeat the command and nothing is computed again; add a sensor to the folder and only
# that one is. What the page [`fleet.html`](fleet.md) shows beside this are distributions,
# outliers and warnings.

# %%
again = run(RunRequest(["lot"], Orders("fleet"), read_limits(Path("limits.toml"))), Local(2))
print(f"computed: first {outcome.computed}, then {again.computed}")

# %% [check]
assert (table.status == "identified").sum() == 29
assert table.status[table.serial_number == "023"].iloc[0] == "refused"
assert not simple[good.serial_number == "011"].iloc[0]
assert beyond.sum() <= simple.sum() < 29
assert again.computed == 0
