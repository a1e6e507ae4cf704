"""The paper's claims, and our own, each held against this run's numbers."""

from __future__ import annotations

from dataclasses import dataclass

from vibrident.paper import methods, published
from vibrident.paper.reproduction import Reproduction
from vibrident.paper.sections import PaperSection

MEAN_PERCENT = 0.005  # own target without channel noise: mean deviation of the curve, %
PEAK_PERCENT = 0.02  # deviation of the curve at the peak, %
OVER_BOUND = 2.0  # RMS error over the Cramér–Rao bound
NOISE_LEVEL = 0.01  # response noise of that ratio, relative to the rms


@dataclass(frozen=True)
class Claim:
    """A claim, the figure of this run, whether it holds, and why."""

    claim: str
    found: str
    holds: bool
    reason: str

    @property
    def verdict(self) -> str:
        """In words."""
        return "yes" if self.holds else "no"


def of_the_paper(run: Reproduction) -> list[Claim]:
    """Return every claim of the paper that a number can decide, under its own conditions (Euler, Adam)."""
    claims = [
        *_of_section(run.simulation, "simulation"),
        _rpd(run.simulation),
        _lstm_worst(run.simulation),
    ]
    claims += _curve_claims(run)
    claims += _of_section(run.interferometer, "experiment, simulated") + _experiment_claims(
        run.interferometer
    )
    if run.seismometer is not None:
        claims += _of_section(run.seismometer, "experiment, measured") + _experiment_claims(
            run.seismometer
        )
    return claims


def _of_section(section: PaperSection, where: str) -> list[Claim]:
    gru = _rmse(section, "GRU")
    lstm = _rmse(section, "LSTM")
    claims = []
    for name, why in (
        (methods.PUBLISHED, "Euler's discretisation error remains, as large as their errors"),
        (methods.EXACT, "the physics holds and its weights are exact"),
    ):
        rmse = _rmse(section, name)
        cuts = 100.0 * (1.0 - rmse / gru), 100.0 * (1.0 - rmse / lstm)
        holds = min(cuts) >= 100.0 * published.RMSE_REDUCTION
        if holds and name == methods.PUBLISHED:
            why = "three numbers that are physics need less data than 832 or 1104 that are not"
        if not holds and name == methods.EXACT:
            why = "noise or nonlinearity remains"
        claims.append(
            Claim(
                f"RMSE at least 60 % below GRU and LSTM ({where}), {name}",
                f"{cuts[0]:.1f} % below GRU, {cuts[1]:.1f} % below LSTM",
                holds,
                why,
            )
        )
    return claims


def _rmse(section: PaperSection, name: str) -> float:
    metrics = section.row(name).metrics
    return float("inf") if metrics is None else metrics.rmse


def _rpd(section: PaperSection) -> Claim:
    names = ("GRU", "LSTM", methods.PUBLISHED)
    found = {
        name: metrics.rpd for name in names if (metrics := section.row(name).metrics) is not None
    }
    return Claim(
        "all three predict reliably, RPD > 3 (simulation)",
        ", ".join(f"{name.split(' (')[0]} {value:.3g}" for name, value in found.items()),
        min(found.values()) > published.RELIABLE_RPD,
        "decided by how long the networks without physics are trained",
    )


def _lstm_worst(section: PaperSection) -> Claim:
    gru, lstm, ipnn = (_rmse(section, name) for name in ("GRU", "LSTM", methods.PUBLISHED))
    return Claim(
        "LSTM is the poorest of the three (simulation)",
        f"RMSE GRU {gru:.3g}, LSTM {lstm:.3g}, IPNN {ipnn:.3g}",
        lstm > max(gru, ipnn),
        "one split and one start; neither network without physics sees the test frequencies",
    )


def _curve_claims(run: Reproduction) -> list[Claim]:
    section = run.simulation
    rate = run.settings.rate_hz
    euler = section.deviations[methods.PUBLISHED]
    plain = section.deviations[methods.PLAIN]
    said = published.SIMULATION["IPNN"]
    said_lsm = published.SIMULATION["LSM"]
    why = f"forward Euler at {rate / 1e3:g} kHz; see the study of sampling rates"
    crude = section.deviations[methods.EXTREMES]
    return [
        Claim(
            f"IPNN's curve within {said.mean} % of the true one on average",
            f"{euler.mean:.3g} %",
            euler.mean <= 1.1 * said.mean,
            why,
        ),
        Claim(
            f"IPNN's curve within {said.largest} % at the resonance",
            f"{euler.at_peak or 0.0:.3g} %",
            abs(euler.at_peak or 0.0) <= 1.1 * said.largest,
            why,
        ),
        Claim(
            f"LSM is {said_lsm.largest} % off at the resonance, with a mean four times the IPNN's",
            f"{plain.at_peak or 0.0:.3g} %, mean {plain.mean:.3g} % ({plain.mean / euler.mean:.3g} times)",
            abs(plain.at_peak or 0.0) >= 0.9 * said_lsm.largest and plain.mean >= 3.0 * euler.mean,
            "least squares on sine fits is far better than that; with sensitivities read from largest excursions it is "
            f"{crude.mean:.3g} % off on average: the paper does not state how they are read",
        ),
    ]


def _experiment_claims(section: PaperSection) -> list[Claim]:
    where = "simulated" if section.simulated else "measured"
    said = published.EXPERIMENT["IPNN"]
    euler = section.deviations[methods.PUBLISHED]
    exact = section.deviations[methods.EXACT]
    plain = section.deviations.get(methods.PLAIN)
    physics = "exact weights and a delay"
    if not section.simulated:
        physics = "the data are not a linear sensor's; this network gives most weight to the records that it fits best"
    claims = [
        Claim(
            f"{name} within {said.mean} % (mean) and {said.largest} % (largest) of the interferometer ({where})",
            f"{found.mean:.3g} %, {found.largest:.3g} %",
            found.mean <= said.mean and found.largest <= said.largest,
            why,
        )
        for name, found, why in (
            (methods.PUBLISHED, euler, "forward Euler, and no delay in the model"),
            (methods.EXACT, exact, physics),
        )
    ]
    if plain is None:
        found = "plain LSM gives no stable sensor"
        holds = True
        why = "points of small sensitivity dominate, and are noise"
    else:
        cut = 100.0 * (1.0 - euler.mean / plain.mean)
        holds = False
        found = f"{euler.mean / plain.mean:.3g} times LSM's"
        why = "Euler's error"
        if cut > 0:
            found = f"{cut:.3g} % below"
            holds = cut >= 100.0 * published.DEVIATION_REDUCTION
            why = "plain LSM weighs 1/H equally, so the points of small sensitivity dominate"
    claim = f"IPNN's mean deviation about 65 % below plain LSM's ({where}), {methods.PUBLISHED}"
    return [*claims, Claim(claim, found, holds, why)]


def of_our_own(run: Reproduction) -> list[Claim]:
    """Return this package's own targets in the paper's simulation."""
    exact = run.simulation.deviations[methods.EXACT]
    point = next(
        p for p in run.noise.points if p.method == "IPNN, exact weights" and p.level == NOISE_LEVEL
    )
    ratios = run.noise.over_bound("IPNN, exact weights", NOISE_LEVEL)
    mean_ratio = point.mean_percent / (run.noise.bound_mean_percent * NOISE_LEVEL)
    words = ", ".join(f"{name.replace('_', ' ')} {ratio:.2f}" for name, ratio in ratios.items())
    rate = f"{run.settings.rate_hz / 1e3:g} kHz"
    return [
        Claim(
            f"curve within {MEAN_PERCENT} % on average at {rate}",
            f"{exact.mean:.2g} %",
            exact.mean <= MEAN_PERCENT,
            "100 times closer than published",
        ),
        Claim(
            f"curve within {PEAK_PERCENT} % at the resonance at {rate}",
            f"{abs(exact.at_peak or 0.0):.2g} %",
            abs(exact.at_peak or 0.0) <= PEAK_PERCENT,
            "RK4's error in the data remains",
        ),
        Claim(
            f"RMS error within {OVER_BOUND:g} × the Cramér–Rao bound at 1 % response noise",
            f"{words}; mean of the curve {mean_ratio:.2f}",
            max(*ratios.values(), mean_ratio) <= OVER_BOUND,
            f"{run.noise.draws} draws: a ratio of 1 scatters by about {100 / (2 * run.noise.draws) ** 0.5:.0f} %",
        ),
    ]
