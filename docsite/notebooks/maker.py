# %% [markdown]
# # A maker's lot
#
# A maker of sensors has each one swept on a shaker, beside a reference. The analyser
# leaves a table of the response. Within the shift it must be decided which sensors may be
# shipped.
#
# The folder `lot` is what the test stand leaves behind: for each of thirty sensors a table
# and a [calibration file](calibration-file.md). One sensor was glued badly, and one cable
# is broken.

# %% [folded] The data: tables of thirty sensors, simulated
from pathlib import Path

import numpy as np

description = """[sensor]
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
frequency = np.geomspace(10, 1000, 21)
u = np.full(frequency.size, 0.003)  # standard uncertainty, relative
rng = np.random.default_rng(7)
lot = Path("lot")
lot.mkdir()
for number in range(30):
    serial = f"{number:03}"
    sensitivity = 0.104 * (1 + 0.01 * rng.normal())
    natural = 652.0 * (1 + 0.008 * rng.normal())
    damping = 0.182 * (1 + 0.03 * rng.normal())
    if serial == "011":  # glued badly
        natural = 560.0
    ratio = 1j * frequency / natural
    response = sensitivity / (1 + 2 * damping * ratio + ratio**2)
    noise = rng.normal(size=(2, frequency.size))
    magnitude = np.abs(response) * (1 + u * noise[0])
    phase = np.rad2deg(np.angle(response) + u * noise[1])
    if serial == "023":  # a broken cable
        magnitude = np.zeros(frequency.size)
    columns = [
        frequency,
        magnitude,
        phase,
        u * np.abs(response),
        np.rad2deg(u),
    ]
    np.savetxt(
        lot / f"{serial}.csv",
        np.column_stack(columns),
        "%.6g",
        ",",
        header="Hz,V/(m/s^2),deg,u,u",
        comments="",
    )
    file = lot / f"{serial}.toml"
    file.write_text(description.format(serial=serial))

# %%
import vibrident

outcome = vibrident.Fleet("lot", "fleet").identify(workers=2)
table = vibrident.Fleet("lot", "fleet").to_dataframe()
print(table.status.value_counts().to_string())

# %% [markdown]
# In the shell this is `vibrident fleet lot --out fleet`. The table has a row a sensor, with
# each parameter and its u. Which row was refused, and why?

# %%
import textwrap

(refused,) = table[table.status == "refused"].itertuples()
print(refused.calibration)
for line in refused.message.splitlines():
    print(textwrap.fill(line, 76, subsequent_indent=" " * 12))

# %% [markdown]
# The broken cable is a row, and not an end of the run.
#
# ## Limits
#
# A limits file states nominal values and tolerances. The same command again takes it in.
# Nothing is identified twice.

# %%
from pathlib import Path

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
fleet = vibrident.Fleet("lot", "fleet", limits="limits.toml")
again = fleet.identify(workers=2)
print(f"identified: first {outcome.computed}, then {again.computed}")

# %% [markdown]
# The page `fleet/fleet.html` shows yield, distributions and outliers
# ([fleets](fleet.md)). Which sensors may be shipped depends on the rule:
#
# - **Simple:** the value lies within its limits.
# - **Beyond doubt** (ISO 14253-1): it lies within them by U. No bad sensor passes.

# %%
good = fleet.to_dataframe().query("status == 'identified'")
sensitivity = (good.sensitivity / 0.104 - 1).abs()
resonance = (good.natural_frequency - 652.0).abs()
expanded = 2 * good.sensitivity_u / 0.104, 2 * good.natural_frequency_u

simple = (sensitivity <= 0.015) & (resonance <= 30.0)
beyond_doubt = (sensitivity + expanded[0] <= 0.015) & (
    resonance + expanded[1] <= 30.0
)
print(f"of {len(table)} sensors pass")
print(f"    by the simple rule   {simple.sum()}")
print(f"    beyond doubt         {beyond_doubt.sum()}")

# %% [markdown]
# The badly glued sensor was identified well. Its resonance is not where it belongs:

# %%
import matplotlib.pyplot as plt

figure, axis = plt.subplots(figsize=(7, 3.6), layout="constrained")
axis.errorbar(
    1e3 * good.sensitivity,
    good.natural_frequency,
    2 * good.natural_frequency_u,
    2e3 * good.sensitivity_u,
    "o",
    ms=4,
)
limits = plt.Rectangle((102.44, 622), 3.12, 60, fill=False, ec="C2", lw=1.5)
axis.add_patch(limits)
glued = good[good.serial_number == "011"].iloc[0]
axis.annotate(
    "011, glued badly",
    (1e3 * glued.sensitivity, glued.natural_frequency),
    (8, 6),
    textcoords="offset points",
)
axis.set(
    xlabel="Sensitivity in mV/(m/s²)",
    ylabel="Natural frequency in Hz",
    title="The lot, with U, and its limits",
)
axis.grid(alpha=0.3)

# %% [check]
assert (table.status == "identified").sum() == 29
assert table.status[table.serial_number == "023"].iloc[0] == "refused"
assert not simple[good.serial_number == "011"].iloc[0]
assert beyond_doubt.sum() <= simple.sum() < 29
assert again.computed == 0
