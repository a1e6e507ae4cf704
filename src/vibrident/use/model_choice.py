"""Choice of a model among several results on the same data, by information criteria."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from vibrident.physics.naming import in_words
from vibrident.result import Result


@dataclass(frozen=True)
class Criteria:
    """Criteria for the choice of a model.

    Attributes:
        chi2: sum of the squared deviations over their variance; None where no uncertainty is known.
        parameters: estimated, not derived.
        aic: Akaike's information criterion, χ² + 2 p.
        bic: Schwarz's, χ² + p ln n, with n deviations.
        sound: the model explains the data, and the data determine its parameters.
    """

    chi2: float | None
    parameters: int
    aic: float | None
    bic: float | None
    sound: bool


def criteria(result: Result) -> Criteria:
    """Return the information criteria of a result.

    Smaller is better; a difference of ten decides (Burnham & Anderson 2002).
    """
    estimated = [p for p in result.parameters.values() if not p.derived]
    sound = result.fit.adequate and all(p.identifiable for p in estimated)
    if result.fit.chi2_reduced is None:
        return Criteria(None, len(estimated), None, None, sound)
    chi2 = result.fit.chi2_reduced * result.fit.degrees_of_freedom
    count = max(result.fit.degrees_of_freedom + len(estimated), 1)
    return Criteria(
        chi2,
        len(estimated),
        chi2 + 2 * len(estimated),
        chi2 + len(estimated) * math.log(count),
        sound,
    )


@dataclass(frozen=True)
class Recommendation:
    """Recommended method with the reason; ``method`` is None if none can be recommended."""

    method: str | None
    words: str


def recommendation(results: Mapping[str, Result]) -> Recommendation:
    """Return the best of several models on the same data.

    It is adequate and identifiable, and has the smallest BIC of those that are. None is better than
    another where they are known to come from different data.
    """
    if _is_of_different_data(results):
        words = "These are results of different data: no criterion chooses between them."
        return Recommendation(None, words)
    judged = {name: criteria(result) for name, result in results.items()}

    def order(name: str) -> tuple[float, int]:
        return judged[name].bic or 0.0, judged[name].parameters

    sound = [name for name, quality in judged.items() if quality.sound]
    if sound:
        best = min(sound, key=order)
        rejected = [name for name, result in results.items() if result.model != results[best].model]
        words = f"Take {best}: it explains the data and they determine all its parameters"
        reasons = [
            _reason_against(name, results[name], judged[name], judged[best]) for name in rejected
        ]
        return Recommendation(best, "; ".join([words, *dict.fromkeys(reasons)]) + ".")
    adequate = [name for name, result in results.items() if result.fit.adequate]
    if adequate:
        best = min(adequate, key=order)
        undetermined = _undetermined_parameters(results[best])
        words = (
            f"{best} explains the data, but they do not determine the {undetermined}: use "
            "its curve within the band, not these parameters, or measure where they matter."
        )
        return Recommendation(best, words)
    scored = {name: c.chi2 for name, c in judged.items() if c.chi2 is not None}
    nearest = f" {min(scored, key=lambda name: scored[name])} comes nearest." if scored else ""
    words = (
        f"None of these explains the data: do not publish their parameters.{nearest} Try a model "
        "with more physics."
    )
    return Recommendation(None, words)


def _is_of_different_data(results: Mapping[str, Result]) -> bool:
    """Return whether the files of two results differ, or the units of their responses."""
    known = set()
    for result in results.values():
        digests = {entry.get("sha256") for entry in result.provenance.get("files") or ()}
        if digests - {None, ""}:
            known.add((frozenset(digests), result.response_unit))
    return len(known) > 1


def _undetermined_parameters(result: Result) -> str:
    """Return the parameters that the data do not determine, in words."""
    return ", ".join(
        in_words(n) for n, p in result.parameters.items() if not p.derived and not p.identifiable
    )


def _reason_against(name: str, result: Result, judged: Criteria, best: Criteria) -> str:
    """Return the reason why another model is not recommended."""
    if not result.fit.adequate:
        return f"{name} does not explain them"
    if weak := _undetermined_parameters(result):
        return f"they do not determine the {weak} of {name}"
    if judged.bic is not None and best.bic is not None:
        return f"{name} has a BIC larger by {judged.bic - best.bic:.3g}"
    return f"{name} is sound too"
