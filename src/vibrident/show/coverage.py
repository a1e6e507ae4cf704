"""Say what U = k u covers: the effects in u, and the probability by k and ν (GUM G.3)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from vibrident.base.tails import f_tail
from vibrident.result import Result
from vibrident.show.formulas import Words
from vibrident.show.language import ENGLISH, Translator
from vibrident.show.numbers import plain
from vibrident.show.views import K, Sentence

_KEY = "effective_degrees_of_freedom"
_NEARLY_NORMAL = 60.0  # effective degrees of freedom from which k = 2 covers 95 %


@dataclass(frozen=True)
class Coverage:
    """Coverage of an expanded uncertainty."""

    # effective ones; infinite where the distribution is normal, None where not stated
    degrees_of_freedom: float | None
    probability: float  # of the interval value ± U

    def text(self, translate: Translator = ENGLISH) -> Words:
        """Return coverage probability, factor and distribution in a sentence."""
        freedom = self.degrees_of_freedom
        kind = (
            "normal"
            if freedom is None
            else "student"
            if math.isfinite(freedom)
            else "normal_infinite"
        )
        return translate(
            "text", kind, percent=f"{100 * self.probability:.0f}", freedom=plain(freedom, 3)
        )


def coverage(result: Result) -> Coverage:
    """Return the coverage of every U of a result."""
    if _KEY not in result.settings:
        return Coverage(None, math.erf(K / math.sqrt(2.0)))
    freedom = result.settings[_KEY]
    # JSON has no infinity: it is written as null
    if freedom is None or not math.isfinite(freedom) or freedom > 1e6:
        return Coverage(math.inf, math.erf(K / math.sqrt(2.0)))
    return Coverage(float(freedom), 1.0 - f_tail(1.0, float(freedom), K**2))


def parameter_factor(result: Result) -> float:
    """Return k of the parameters' U: 2, or more where few degrees of freedom require it."""
    k = result.settings.get("coverage_factor")
    freedom = coverage(result).degrees_of_freedom
    if not isinstance(k, int | float) or freedom is None or freedom >= _NEARLY_NORMAL:
        return K
    return max(float(k), K)


def interval_text(result: Result) -> Words:
    """Return the k of the parameters' U and intervals where it is not 2; else empty."""
    k = parameter_factor(result)
    if k == K:
        return Words()
    freedom = plain(coverage(result).degrees_of_freedom, 3)
    sentence = (
        f"U and 95 % interval of the parameters are u times k = {plain(k, 3)} (Student's t with "
        f"ν_eff = {freedom})."
    )
    return Words(sentence)


def unstated(result: Result) -> tuple[str, ...]:
    """Return which of ``gain`` and ``phase`` the result has without a stated uncertainty."""
    phases = bool(np.isfinite(result.measured.phase_deg).any())
    aspects = ("gain", *(["phase"] if phases else [])) if result.has_gain else ()
    return tuple(
        aspect for aspect in aspects if aspect not in (result.uncertainty.get("covers") or ())
    )


#: What a calibration file states of each part of the measuring chain.
_TO_STATE = {
    "gain": "of the gain: standard_uncertainty of [reference], or an [[uncertainty]] of kind gain",
    "phase": "of the phase: an [[uncertainty]] of kind phase or timing",
}


def document_kind(result: Result) -> str:
    """Return what the signed document of a result is: ``certificate``, ``report``, ``tracking``.

    A certificate is of a calibration, and states an uncertainty of the sensor, not of the scatter
    alone.
    """
    if result.is_tracked:
        return "tracking"
    return "report" if "gain" in unstated(result) else "certificate"


def not_certified(result: Result, translate: Translator = ENGLISH) -> tuple[Sentence, ...]:
    """Return what the signed document says of quantities whose sources nobody stated."""
    lacking = unstated(result)
    if "gain" in lacking or not lacking:
        return chain_unstated(result, translate)
    if "phase" not in (result.certificate.get("quantities") or ("phase",)):
        return ()
    return (Sentence("", "doubt", translate("text", "phase_not_certified")),)


def chain_unstated(result: Result, translate: Translator = ENGLISH) -> tuple[Sentence, ...]:
    """Return that U covers scatter only; nothing where gain and phase are stated."""
    lacking = unstated(result)
    if not lacking:
        return ()
    lead = translate("text", "scatter_of_phase" if lacking == ("phase",) else "scatter")
    return (Sentence(translate("text", "scatter_why"), "doubt", lead),)


def scatter_only(result: Result) -> tuple[Sentence, ...]:
    """Return the same for who makes the calibration file, with what to state in it."""
    remedy = "; ".join(_TO_STATE[aspect] for aspect in unstated(result))
    more = f"To include it, state in the calibration file: {remedy}."
    return tuple(
        replace(sentence, text=f"{sentence.text} {more}") for sentence in chain_unstated(result)
    )
