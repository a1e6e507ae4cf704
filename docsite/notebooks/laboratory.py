# %% [markdown]
# # A laboratory's certificate
#
# A laboratory moves an accelerometer with sines, at the one-third octaves from 40 Hz to
# 1 kHz. A laser measures the motion ([ISO 16063-11](interferometer.md)). The customer
# wants a certificate. He also asks: is the sensor still what it was last year?

# %% [folded] The data: two calibrations, simulated
from dataclasses import replace

import vibrident

sensor = {
    "manufacturer": "simulated",
    "type": "A-630",
    "serial_number": "0042",
}
years = []
for year, sensitivity in enumerate((0.1043, 0.1040)):
    simulated = vibrident.simulate(
        (
            "accelerometer",
            {
                "sensitivity": sensitivity,
                "natural_frequency": 652.0,
                "damping_ratio": 0.182,
            },
        ),
        frequencies_hz=vibrident.one_third_octave(40.0, 1000.0),
        samples=8000,
        reference_noise=1e-3,
        response_noise=2e-3,
        start="steady",
        seed=2 - year,
    )
    years.append(replace(simulated, sensor=sensor))
last_year, calibration = years

# %%
import vibrident

scatter = vibrident.identify(calibration)
scatter

# %% [markdown]
# The last sentence above the picture matters most. This u holds the scatter of the
# records and nothing else. Nobody has said how good the laser, the amplifier and the
# recorder are. A certificate must not state such a number.
#
# ## The measuring chain
#
# The laboratory states its chain: each source, how it acts, and its standard uncertainty.
# A gain is relative, a phase in rad, a time in s.

# %%
from dataclasses import replace

from vibrident import SystematicEffect

chain = (
    SystematicEffect("voltmeter, certificate V-17", "gain", 5e-4),
    SystematicEffect("laser, certificate L-3", "gain", 1e-3),
    SystematicEffect("phase of the amplifier", "phase", 8.7e-4),
    SystematicEffect("skew of the two channels", "timing", 2e-7),
)
result = vibrident.identify(replace(calibration, effects=chain))
result

# %% [markdown]
# The u of the sensitivity has grown to what it is worth. The budget says who contributes
# how much, in the unit of each parameter:

# %%
import pandas as pd

budget = pd.DataFrame(
    {
        row["source"]: row["contributions"]
        for row in result.settings["uncertainty_budget"]
    }
).T
names = ["sensitivity", "natural_frequency", "damping_ratio"]
budget[names].map("{:.1e}".format)

# %% [markdown]
# The laser decides the sensitivity. Phase and skew decide the other two.
#
# ## Is it what it was last year?
#
# Last year's calibration was made by the same chain. E_n compares the two: beyond ±1 they
# disagree. What both share is taken out. A laser that is wrong was wrong both times, and
# cannot explain a difference.

# %%
before = vibrident.identify(replace(last_year, effects=chain))
comparison = vibrident.compare({"last year": before, "this year": result})
shared = comparison.normalized_error("sensitivity")["this year"]

now = result.parameters["sensitivity"]
then = before.parameters["sensitivity"]
u = (now.standard_uncertainty**2 + then.standard_uncertainty**2) ** 0.5
alone = (now.value - then.value) / (2 * u)
print(f"change         {100 * (now.value / then.value - 1):.3f} %")
print(f"E_n            {shared:.1f}")
print(f"if independent {alone:.1f}")

# %% [markdown]
# The true change is −0.29 %. Taken as independent, the two calibrations seem to agree.
# With the common chain taken out, the change is plain.
#
# This sensor was never taken off its exciter. In a laboratory it is; what that changes is
# found by [repeats](repeats.md). [The history](history.md) does the
# comparison for every sensor.
#
# ## The certificate
#
# A certificate states more than numbers. What ISO/IEC 17025 asks for and is missing makes
# it a draft:

# %%
missing = vibrident.check_certificate(result)
print(f"{len(missing)} entries are missing:")
for entry in missing:
    print("   ", entry)

# %% [markdown]
# They are given after the fit, here as a dictionary. A file `certificate.toml` does the
# same for the command line ([reports](report.md)).

# %%
from datetime import date

entries = {
    "number": "2026-0042",
    "laboratory": "Laboratory of an example",
    "laboratory_address": "1 Example Road",
    "customer": "A customer",
    "customer_address": "2 Example Road",
    "place": "room 1",
    "date_of_calibration": date(2026, 3, 2),
    "date_of_issue": date(2026, 3, 4),
    "procedure": "ISO 16063-11, method 3",
    "traceability": "none: the data are simulated",
    "temperature_c": 23.0,
    "approved_by": "nobody",
    "decision_rule": "guarded",
    "requirements": [
        {"quantity": "sensitivity", "low": 0.103, "high": 0.105},
    ],
}
print("missing:", vibrident.check_certificate(result, entries))
pdf = vibrident.report(result, "certificate.pdf", certificate=entries)
print(f"{pdf.name}: {pdf.stat().st_size // 1024} kB")

# %% [markdown]
# What the model leaves of the measured points. Their U is that of noise and chain
# together. The points lie far closer to the model, as the chain is common to them all.

# %%
result.plot("deviation")

# %% [check]
assert scatter.uncertainty["covers"] == ["noise"]
assert set(result.uncertainty["covers"]) == {"noise", "gain", "phase"}
bare = scatter.parameters["sensitivity"].standard_uncertainty
assert now.standard_uncertainty > 3 * bare
assert abs(now.value - 0.1040) < 4 * bare
assert shared < -1.5
assert -1.5 < alone < -0.5
assert budget["sensitivity"].idxmax().startswith("laser")
assert missing
assert not vibrident.check_certificate(result, entries)
