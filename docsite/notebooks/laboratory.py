# %% [markdown]
# # A laboratory's certificate
#
# A laboratory has moved an accelerometer sinusoidally at the one-third octaves from 40 Hz
# to 1 kHz, with a laser beside it ([ISO 16063-11](interferometer.md)). The customer wants a
# certificate, and to know whether the sensor is still what it was last year. All data are
# simulated here: a reference with 0.1 % of noise and a sensor with 0.2 %.

# %%
import matplotlib.pyplot as plt
import numpy as np

import vibrident
from vibrident.data.effects import SystematicEffect
from vibrident.physics.simulation import one_third_octave
from vibrident.show import issue, report
from vibrident.use.comparison import normalized_error

SENSOR = {"manufacturer": "simulated", "type": "A-630", "serial_number": "0042"}


def recorded(sensitivity, seed, effects=()):
    """Records of the sensor at the one-third octaves, with what is stated of the measuring chain."""
    true = {"sensitivity": sensitivity, "natural_frequency": 652.0, "damping_ratio": 0.182}
    simulated = vibrident.simulate(
        ("accelerometer", true),
        frequencies_hz=one_third_octave(40.0, 1000.0),
        samples=8000,
        reference_noise=1e-3,
        response_noise=2e-3,
        start="steady",
        seed=seed,
    )
    pairs = [(record.reference, record.response) for record in simulated.records]
    return vibrident.Calibration.from_arrays(
        *zip(*pairs), 51200.0, sensor=SENSOR, effects=effects
    )


bare = vibrident.identify(recorded(0.1040, seed=1))
print(bare.summary())

# %% [markdown]
# The last lines matter most. u holds the scatter of these records, and nothing else:
# nobody has said how well the laser, the amplifier and the recorder are known. A number
# like this must not stand on a certificate as U, and `report` would call its PDF a
# measurement report. So the laboratory states its chain, each source with the way it
# acts:

# %%
CHAIN = (
    SystematicEffect("voltmeter, certificate V-17", "gain", 5e-4),
    SystematicEffect("laser vibrometer, certificate L-3", "gain", 1e-3),
    SystematicEffect("phase of the amplifier", "phase", np.deg2rad(0.05)),
    SystematicEffect("skew of the two channels", "timing", 2e-7),
)
result = vibrident.identify(recorded(0.1040, seed=1, effects=CHAIN))
print("covers:", ", ".join(result.uncertainty["covers"]))
result

# %% [markdown]
# The u of the sensitivity has grown from scatter to what it is worth. Who contributes how
# much is the budget:

# %%
columns = ("source", "kind", "sensitivity", "natural_frequency", "damping_ratio")
for row in result.settings["uncertainty_budget"]:
    shares = "".join(f"{row['contributions'].get(name, 0.0):12.2e}" for name in columns[2:])
    print(f"{row['source'][:34]:36}{shares}")

# %% [markdown]
# ## Is it what it was last year?
#
# Last year's calibration was made by the same chain. E_n compares the two; the covariance
# of what both share is taken out, because a laser that is wrong is wrong both times and
# cannot explain a difference.

# %%
before = vibrident.identify(recorded(0.1043, seed=2, effects=CHAIN))
now, then = (each.parameters["sensitivity"] for each in (result, before))
shared = (
    now.value
    * then.value
    * sum(e.standard_uncertainty**2 for e in CHAIN if e.kind == "gain")
)
pair = (now.value, 2 * now.standard_uncertainty, then.value, 2 * then.standard_uncertainty)
with_shared, without = normalized_error(*pair, shared), normalized_error(*pair)
print(
    f"change {100 * (now.value / then.value - 1):.3f} %, E_n {with_shared:.1f}; taken as independent {without:.1f}"
)

# %% [markdown]
# The true change is −0.29 %. Taken as independent, the two calibrations seem to agree;
# with the common chain taken out the change is plain. (The sensor of this story was never
# taken off its exciter. In a laboratory it is, and what that changes is found by
# [repeats](repeats.md) with a `mounting` of their own.) [`vibrident
# history`](history.md) finds what two results share from their budgets, and does this for
# every sensor.
#
# ## The certificate
#
# What a certificate states besides the numbers is given after the fit. What ISO/IEC 17025
# asks for and is missing makes it a draft.

# %%
print(
    f"before: {len(issue.missing(result))} entries are missing, such as {', '.join(issue.missing(result)[:3])}"
)
with open("certificate.toml", "w", encoding="utf-8") as file:
    file.write("""[certificate]
number = "2026-0042"
laboratory = "Laboratory of an example"
laboratory_address = "1 Example Road"
customer = "A customer"
customer_address = "2 Example Road"
place = "room 1"
date_of_calibration = 2026-03-02
date_of_issue = 2026-03-04
procedure = "ISO 16063-11, method 3"
traceability = "none: the data are simulated"
temperature_c = 23.0
approved_by = "nobody"
decision_rule = "guarded"

[[certificate.requirements]]
quantity = "sensitivity"
low = 0.103
high = 0.105
""")
stated, more = issue.issued(result, ["certificate.toml"])
print(f"with the file: {len(issue.missing(stated))} entries are missing")
written = report.write(stated, "pdf", "certificate.pdf", issue=more)
print(f"{written.name}: {written.stat().st_size // 1024} kB")

# %% [markdown]
# What the model leaves of the measured points. Their U on the certificate is that of
# noise and chain together, 0.23 %: the points lie far closer to the model, because the
# chain is common to them all.

# %%
measured = stated.measured
frequency, deviation = np.array(measured.frequency_hz), np.array(measured.deviation_percent)
figure, axis = plt.subplots(figsize=(7, 3.2), layout="constrained")
axis.axhline(0, color="0.6")
axis.semilogx(frequency, deviation, "o")
axis.set(
    xlabel="Frequency in Hz",
    ylabel="Deviation in %",
    title="Measured sensitivity less the model's",
)
axis.grid(alpha=0.3)

# %% [check]
assert bare.uncertainty["covers"] == ["noise"]
assert set(result.uncertainty["covers"]) == {"noise", "gain", "phase"}
assert now.standard_uncertainty > 3 * bare.parameters["sensitivity"].standard_uncertainty
assert (
    abs(now.value / 0.1040 - 1)
    < 4 * bare.parameters["sensitivity"].standard_uncertainty / now.value
)
assert with_shared < -1.5
assert -1.5 < without < -0.5
assert issue.missing(result)
assert not issue.missing(stated)
