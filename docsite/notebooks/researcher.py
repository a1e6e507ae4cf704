# %% [markdown]
# # Is the uncertainty true?
#
# An uncertainty is a promise about errors that nobody sees. In a simulation they can be
# seen: each error can be divided by the u that was stated for it. Three questions. Does u
# keep its promise? Does it depend on the estimator? What does a wrong model do?

# %% [folded] The data: one sensor, moved by five sines
import vibrident

true = {
    "sensitivity": 0.104,
    "natural_frequency": 652.0,
    "damping_ratio": 0.182,
}
clean = vibrident.simulate(
    ("accelerometer", true),
    frequencies_hz=[100, 300, 500, 650, 1000],
    samples=1024,
    start="steady",
)

# %%
import vibrident

noise = {"response_noise": 1e-2, "reference_noise": 5e-3}
draw = vibrident.with_noise(clean, **noise, seed=0)
result = vibrident.identify(draw)
for name, parameter in result.parameters.items():
    if name in true:
        error = parameter.value - true[name]
        print(f"{name:18} {error / parameter.standard_uncertainty:+.2f} u")

# %% [markdown]
# The response has 1 % of noise, the reference 0.5 %. The errors of one draw are about as
# large as u. One draw proves nothing.
#
# ## Forty laboratories
#
# Forty draws of the noise, each identified as if it were the only one:

# %%
import numpy as np

errors = []
for seed in range(40):
    draw = vibrident.with_noise(clean, **noise, seed=seed)
    parameters = vibrident.identify(draw).parameters
    for name in true:
        error = parameters[name].value - true[name]
        errors.append(error / parameters[name].standard_uncertainty)
errors = np.array(errors)

print(f"within 1 u   {np.mean(abs(errors) < 1):.1%}   (normal: 68.3 %)")
print(f"within 2 u   {np.mean(abs(errors) < 2):.1%}   (normal: 95.4 %)")
print(f"rms          {np.sqrt(np.mean(errors**2)):.2f} u (normal: 1 u)")

# %%
import matplotlib.pyplot as plt

figure, axis = plt.subplots(figsize=(7, 3.2), layout="constrained")
bins = np.arange(-4, 4.1, 0.5)
axis.hist(errors, bins, density=True, color="0.8", edgecolor="w")
x = np.linspace(-4, 4, 200)
axis.plot(x, np.exp(-(x**2) / 2) / np.sqrt(2 * np.pi), lw=2)
axis.set(
    xlabel="(value − true) / u",
    ylabel="Density",
    title="Errors in units of u, and the normal distribution",
)
axis.grid(alpha=0.3)

# %% [markdown]
# Forty draws show a u that is wrong by a fifth. They do not show one that is wrong by a
# twentieth: the [benchmarks](studies.md) have hundreds of draws.
#
# ## Does it depend on the estimator?
#
# Three estimators see the same draw: least squares on the inverse response (`lsm`, the
# comparison in the [paper](studies.md)), maximum likelihood in frequency (`ml`), and the
# network on the samples (`ipnn`).

# %%
draw = vibrident.with_noise(clean, **noise, seed=1)
comparison = vibrident.compare(draw, estimators=["lsm", "ml", "ipnn"])
values = comparison.to_dataframe()
values.loc[(slice(None), list(true)), ["value", "standard_uncertainty"]]

# %% [markdown]
# They agree well within u, and state nearly the same u. Where noise is not white, or the
# motion is no sine, they differ ([theory](theory.md)).
#
# ## What does a wrong model do?
#
# The same sensor stands on a mount that sways at 300 Hz. It is identified as if it stood on
# rock, and then with the mount in the model.

# %%
swaying = vibrident.simulate(
    "two-mode",
    samples=2048,
    frequencies_hz=np.geomspace(100, 1000, 14),
    response_noise=1e-3,
    start="steady",
    seed=2,
)
wrong = vibrident.identify(swaying, model="accelerometer")
right = vibrident.identify(swaying, model="accelerometer+mode2")
sensitivity = 1.02 / 9.80665  # of the simulated sensor, V/(m/s²)
for result in (wrong, right):
    parameter = result.parameters["sensitivity"]
    print(result.model)
    print(
        f"    off by    {100 * (parameter.value / sensitivity - 1):+.3f} %"
    )
    u = parameter.standard_uncertainty / parameter.value
    print(f"    u         {100 * u:.3f} %")
    print(f"    χ²/ν      {result.fit.chi2_reduced:.3g}")
    print(f"    warnings  {', '.join(result.warning_codes) or 'none'}")

# %% [markdown]
# The wrong model is off by more than 1 %. It says so, by the warning and by a u that has
# grown with the misfit.

# %% [check]
assert 0.8 < np.sqrt(np.mean(errors**2)) < 1.2
assert 0.88 < np.mean(np.abs(errors) < 2) <= 1.0
assert "lack_of_fit" in wrong.warning_codes
assert not right.warning_codes
parameter = right.parameters["sensitivity"]
error = parameter.value - sensitivity
assert abs(error) < 4 * parameter.standard_uncertainty
