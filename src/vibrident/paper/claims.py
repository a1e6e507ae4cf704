"""Check the claims of the paper and the targets of this package against the numbers of a run."""

from __future__ import annotations

from dataclasses import dataclass

from vibrident.paper import methods, published
from vibrident.paper.reproduction import Reproduction
from vibrident.paper.sections import PaperSection

#: Targets of this package without channel noise: deviation of the curve, mean and at the peak, %.
MAX_MEAN_PERCENT = 0.005
MAX_PEAK_PERCENT = 0.02
#: Target with noise: RMS error over the Cramér–Rao bound.
MAX_OVER_BOUND = 2.0
#: Response noise of that target, relative to the rms.
NOISE_LEVEL = 0.01


@dataclass(frozen=True)
class Claim:
    """A claim, the figures of this run, whether they meet it, and the reason."""

    claim: str
    figures: str
    is_met: bool
    reason: str

    @property
    def verdict(self) -> str:
        """Return whether the claim is met, in words."""
        return "yes" if self.is_met else "no"


def check_paper_claims(run: Reproduction) -> list[Claim]:
    """Check every claim of the paper that a number can decide, under Euler and Adam as there."""
    claims = [
        *_check_rmse(run.simulation, "simulation"),
        _check_rpd(run.simulation),
        _check_lstm(run.simulation),
        *_check_curves(run),
        *_check_rmse(run.interferometer, "experiment, simulated"),
        *_check_experiment(run.interferometer),
    ]
    if run.seismometer is not None:
        claims += _check_rmse(run.seismometer, "experiment, measured")
        claims += _check_experiment(run.seismometer)
    return claims


def _check_rmse(section: PaperSection, where: str) -> list[Claim]:
    gru = _rmse(section, "GRU")
    lstm = _rmse(section, "LSTM")
    claims = []
    for name in (methods.PUBLISHED, methods.EXACT):
        rmse = _rmse(section, name)
        below_gru = 100.0 * (1.0 - rmse / gru)
        below_lstm = 100.0 * (1.0 - rmse / lstm)
        is_met = min(below_gru, below_lstm) >= 100.0 * published.RMSE_REDUCTION
        claims.append(
            Claim(
                f"RMSE at least 60 % below GRU and LSTM ({where}), {name}",
                f"{below_gru:.1f} % below GRU, {below_lstm:.1f} % below LSTM",
                is_met,
                _REASONS_OF_RMSE[name, is_met],
            )
        )
    return claims


#: Network, whether the claim is met → the reason.
_REASONS_OF_RMSE = {
    (methods.PUBLISHED, True): (
        "three numbers that are physics need less data than 832 or 1104 that are not"
    ),
    (methods.PUBLISHED, False): "Euler's discretisation error remains, as large as their errors",
    (methods.EXACT, True): "the physics holds and its weights are exact",
    (methods.EXACT, False): "noise or nonlinearity remains",
}


def _rmse(section: PaperSection, name: str) -> float:
    metrics = section.row(name).metrics
    return float("inf") if metrics is None else metrics.rmse


def _check_rpd(section: PaperSection) -> Claim:
    names = ("GRU", "LSTM", methods.PUBLISHED)
    ratios = {
        name: metrics.rpd for name in names if (metrics := section.row(name).metrics) is not None
    }
    return Claim(
        "all three predict reliably, RPD > 3 (simulation)",
        ", ".join(f"{name.split(' (')[0]} {value:.3g}" for name, value in ratios.items()),
        min(ratios.values()) > published.RELIABLE_RPD,
        "decided by how long the networks without physics are trained",
    )


def _check_lstm(section: PaperSection) -> Claim:
    gru, lstm, ipnn = (_rmse(section, name) for name in ("GRU", "LSTM", methods.PUBLISHED))
    return Claim(
        "LSTM is the poorest of the three (simulation)",
        f"RMSE GRU {gru:.3g}, LSTM {lstm:.3g}, IPNN {ipnn:.3g}",
        lstm > max(gru, ipnn),
        "one split and one start; neither network without physics sees the test frequencies",
    )


def _check_curves(run: Reproduction) -> list[Claim]:
    deviations = run.simulation.deviations
    euler = deviations[methods.PUBLISHED]
    plain = deviations[methods.PLAIN]
    euler_peak = euler.at_peak or 0.0
    plain_peak = plain.at_peak or 0.0
    printed = published.SIMULATION["IPNN"]
    printed_lsm = published.SIMULATION["LSM"]
    reason = f"forward Euler at {run.settings.rate_hz / 1e3:g} kHz; see the study of sampling rates"
    return [
        Claim(
            f"IPNN's curve within {printed.mean} % of the true one on average",
            f"{euler.mean:.3g} %",
            euler.mean <= 1.1 * printed.mean,
            reason,
        ),
        Claim(
            f"IPNN's curve within {printed.largest} % at the resonance",
            f"{euler_peak:.3g} %",
            abs(euler_peak) <= 1.1 * printed.largest,
            reason,
        ),
        Claim(
            f"LSM is {printed_lsm.largest} % off at the resonance, "
            "with a mean four times the IPNN's",
            f"{plain_peak:.3g} %, mean {plain.mean:.3g} % ({plain.mean / euler.mean:.3g} times)",
            abs(plain_peak) >= 0.9 * printed_lsm.largest and plain.mean >= 3.0 * euler.mean,
            "least squares on sine fits is far better than that; "
            "with sensitivities read from largest excursions it is "
            f"{deviations[methods.EXTREMES].mean:.3g} % off on average: the paper does not state "
            "how they are read",
        ),
    ]


def _check_experiment(section: PaperSection) -> list[Claim]:
    where = "measured"
    exact_reason = (
        "the data are not a linear sensor's; "
        "this network gives most weight to the records that it fits best"
    )
    if section.simulated:
        where = "simulated"
        exact_reason = "exact weights and a delay"
    printed = published.EXPERIMENT["IPNN"]
    claims = []
    for name, reason in (
        (methods.PUBLISHED, "forward Euler, and no delay in the model"),
        (methods.EXACT, exact_reason),
    ):
        deviation = section.deviations[name]
        claims.append(
            Claim(
                f"{name} within {printed.mean} % (mean) and {printed.largest} % (largest) "
                f"of the interferometer ({where})",
                f"{deviation.mean:.3g} %, {deviation.largest:.3g} %",
                deviation.mean <= printed.mean and deviation.largest <= printed.largest,
                reason,
            )
        )
    plain = section.deviations.get(methods.PLAIN)
    if plain is None:
        is_met = True
        figures = "plain LSM gives no stable sensor"
        reason = "points of small sensitivity dominate, and are noise"
    else:
        ratio = section.deviations[methods.PUBLISHED].mean / plain.mean
        reduction = 100.0 * (1.0 - ratio)
        is_met = reduction >= 100.0 * published.DEVIATION_REDUCTION
        figures = f"{ratio:.3g} times LSM's"
        reason = "Euler's error"
        if reduction > 0:
            figures = f"{reduction:.3g} % below"
            reason = "plain LSM weighs 1/H equally, so the points of small sensitivity dominate"
    claim = f"IPNN's mean deviation about 65 % below plain LSM's ({where}), {methods.PUBLISHED}"
    return [*claims, Claim(claim, figures, is_met, reason)]


def check_own_targets(run: Reproduction) -> list[Claim]:
    """Check this package's own targets in the paper's simulation."""
    method = "IPNN, exact weights"
    noise = run.noise
    exact = run.simulation.deviations[methods.EXACT]
    exact_peak = abs(exact.at_peak or 0.0)
    point = next(p for p in noise.points if p.method == method and p.level == NOISE_LEVEL)
    ratios = noise.over_bound(method, NOISE_LEVEL)
    mean_ratio = point.mean_percent / (noise.bound_mean_percent * NOISE_LEVEL)
    words = ", ".join(f"{name.replace('_', ' ')} {ratio:.2f}" for name, ratio in ratios.items())
    rate = f"{run.settings.rate_hz / 1e3:g} kHz"
    return [
        Claim(
            f"curve within {MAX_MEAN_PERCENT} % on average at {rate}",
            f"{exact.mean:.2g} %",
            exact.mean <= MAX_MEAN_PERCENT,
            "100 times closer than published",
        ),
        Claim(
            f"curve within {MAX_PEAK_PERCENT} % at the resonance at {rate}",
            f"{exact_peak:.2g} %",
            exact_peak <= MAX_PEAK_PERCENT,
            "RK4's error in the data remains",
        ),
        Claim(
            f"RMS error within {MAX_OVER_BOUND:g} × the Cramér–Rao bound at 1 % response noise",
            f"{words}; mean of the curve {mean_ratio:.2f}",
            max(*ratios.values(), mean_ratio) <= MAX_OVER_BOUND,
            f"{noise.draws} draws: a ratio of 1 scatters by about "
            f"{100 / (2 * noise.draws) ** 0.5:.0f} %",
        ),
    ]
