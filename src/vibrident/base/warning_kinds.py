"""Warnings of a result, with meaning and remedy; a new one needs a code and an entry here.

docsite/pages/warnings states the causes of each, with an example.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, get_args

#: Codes that ``result.json`` may hold.
WarningCode = Literal[
    "lack_of_fit",
    "weakly_determined",
    "at_bound",
    "band_sensitive",
    "nonlinear",
    "clipped",
    "dead_channel",
    "drift",
    "polarity",
    "aliasing",
    "short_record",
    "reference_noise",
    "estimators_disagree",
    "units_suspect",
    "clock_suspect",
    "regimes",
    "fringe_slip",
    "few_fringes",
    "ellipse_unstable",
]
WARNING_CODES: tuple[str, ...] = get_args(WarningCode)


@dataclass(frozen=True)
class WarningKind:
    """Kind of warning, explained for a person."""

    code: str  # in result.json; text, because files of later versions may hold others
    title: str  # in a few words
    meaning: str  # what it means for the result
    action: str  # what to do


_KINDS: tuple[WarningKind, ...] = (
    WarningKind(
        "lack_of_fit",
        "the model does not describe the data, or cannot be tested",
        "The deviations at the excited frequencies are larger than their uncertainties explain, or "
        "there are too few points to judge by. "
        "The message says what the uncertainties of the parameters cover: where they were widened "
        "to the size of the misfit they cover a misfit of that size, else they hold only if the "
        "model is right.",
        "Look where the deviations differ from zero: rising towards high frequencies suggests a "
        "delay or a second mode, falling towards low ones a high-pass. Add it to the model, narrow "
        "the band (⟦identify.band_hz = (LOW, HIGH)⟧), or check the stated uncertainties. Where the "
        "reference is a sensor itself, its own response is in the data: state it as "
        "known_response. Of a free decay neither delay nor high-pass makes a difference: where its "
        "beginning deviates, spring or damping change with the amplitude, or the release is part "
        "of the record (start_s leaves it out).",
    ),
    WarningKind(
        "weakly_determined",
        "the data hardly determine a parameter",
        "One parameter, or a combination of parameters, can change much while the fit hardly "
        "changes. Its value is driven by noise and its uncertainty is large or cannot be stated.",
        "Excite the frequencies that determine it (around the natural frequency for damping, well "
        "below it for the sensitivity, high ones for a delay), or leave that part out of the "
        "model.",
    ),
    WarningKind(
        "at_bound",
        "a parameter stopped at its limit",
        "The best fit lies at the edge of the allowed range, so the estimate is a limit, not an "
        "optimum, and its uncertainty on that side means little.",
        "Widen the limit if the value is physically possible; otherwise that part of the model is "
        "probably not needed, or units or polarity are wrong.",
    ),
    WarningKind(
        "band_sensitive",
        "the result depends on the chosen band",
        "A part of the band, taken by itself, moves a parameter by its uncertainty or more: the "
        "model is not equally right over the whole band.",
        "State the band with the result, narrow it to the range of use (⟦identify.band_hz = (LOW, "
        "HIGH)⟧), or extend the model (high-pass, second mode, delay).",
    ),
    WarningKind(
        "nonlinear",
        "the sensor or the shaker is not linear",
        "The response bends with the size of the motion, or has harmonics, by more than noise "
        "shows, and moves a parameter. The message says what that would be without. The linear "
        "parameters hold for the amplitudes measured only.",
        "Repeat at a lower amplitude; if the effect stays and matters, use the add-on `cubic`; "
        "check mounting and cable too.",
    ),
    WarningKind(
        "clipped",
        "a channel was overdriven",
        "Samples sit at the limit of the recorder's range, and were left out of every fit; or the "
        "largest values depart from the fit as an overdriven channel's do, and move a parameter.",
        "Repeat the record with a larger input range or a smaller amplitude.",
    ),
    WarningKind(
        "dead_channel",
        "a channel shows no signal",
        "A channel is constant or holds nothing but noise at the excited frequency. That record "
        "says nothing about the sensor.",
        "Check cable, supply and the column numbers in the calibration file; leave the record out.",
    ),
    WarningKind(
        "drift",
        "a channel drifts",
        "The offset moves during a record by more than the model of offset and slow trend takes "
        "up, so low frequencies are biased.",
        "Let the sensor warm up, record longer or after settling, or leave out the start of the "
        "record with start_s.",
    ),
    WarningKind(
        "polarity",
        "the sign is opposite to what is usual",
        "At low frequency the response is in antiphase with the reference, so the sensitivity is "
        "negative: the sensor, the reference or a cable is inverted.",
        "If the sensor was mounted upside down or the laser looks at the opposite face, set a "
        "negative scale for that channel; otherwise check the wiring.",
    ),
    WarningKind(
        "aliasing",
        "content above half the sampling rate may be folded in",
        "The signal still has power close to half the sampling rate: what lies above it appears at "
        "false frequencies and biases the fit.",
        "Sample faster, or switch on the recorder's anti-alias filter.",
    ),
    WarningKind(
        "short_record",
        "a record is short",
        "A record holds few periods of its excitation, or ends before the sensor has settled. Sine "
        "parameters and initial state can then hardly be told apart.",
        "Record at least ten periods, and longer at the lowest frequencies.",
    ),
    WarningKind(
        "reference_noise",
        "the reference is noisy",
        "The reference channel carries noise of its own. Taken as true input it pulls the "
        "sensitivity towards zero (errors in variables), more than the stated uncertainty says.",
        "Raise the amplitude, average, use the sine-fitted estimator (ml), or improve the "
        "reference; state its uncertainty in the calibration file.",
    ),
    WarningKind(
        "estimators_disagree",
        "two estimates give different values",
        "Calibrations of one sensor that were fitted together differ by more than their "
        "uncertainties. At least one of them rests on an assumption that these data do not meet.",
        "Share fewer parameters, or ask what changed between the calibrations; `vibrident compare` "
        "shows the difference.",
    ),
    WarningKind(
        "units_suspect",
        "the units look wrong",
        "The size of the sensitivity or of a channel is far from what is usual, often by a power "
        "of ten or by 9.80665 (g and m/s²).",
        "Check scale, unit and quantity of both channels in the calibration file.",
    ),
    WarningKind(
        "regimes",
        "the sensor or the chain changed",
        "Parts of a record, or one record, run or mounting among the others, follow another "
        "sensitivity than the rest. The fit is a mean of both; of records, the stated "
        "uncertainties say nothing of the change.",
        "Identify the parts before and after the time named by themselves (start_s and stop_s), or "
        "leave out the record named; look for a changed range, a loose cable or mount, or another "
        "sensor.",
    ),
    WarningKind(
        "fringe_slip",
        "the interferometer lost count of its fringes",
        "The amplitude of the optical signals was lost, or their phase jumped by half a turn or "
        "more between two samples. These stretches are left out; the rest is as good as the turns "
        "over each gap are known.",
        "Look at the Lissajous figure; raise the light on the detectors, move the spot off a dark "
        "speckle, sample faster or move more slowly.",
    ),
    WarningKind(
        "few_fringes",
        "too few fringes to know the interferometer's ellipse",
        "The motion covers less than a fringe in every record, so that offsets, amplitudes and "
        "quadrature of the two optical signals are hardly known. What that does to the response is "
        "in the uncertainty budget. Or a cyclic error of the phase, which so small a motion does "
        "not determine, gives the displacement harmonics.",
        "Record a larger motion, of a fringe or more, in the same set-up and name it in the same "
        "calibration file.",
    ),
    WarningKind(
        "ellipse_unstable",
        "the interferometer's ellipse changed",
        "Offsets, amplitudes or quadrature of the optical signals changed within a record or "
        "between records. Slow changes are followed; what remains is a cyclic error of the "
        "displacement.",
        "Look for a drifting laser, stray light or a speckle that moves; let the set-up warm up "
        "and repeat.",
    ),
    WarningKind(
        "clock_suspect",
        "the sampling rate looks wrong, or time was lost",
        "The sampling rate in use contradicts the stated frequencies of tones, or another "
        "channel's length: all frequencies, the natural frequency among them, are wrong in the "
        "same ratio. Or a record breaks off and goes on elsewhere, as where a recorder lost time: "
        "samples without that are used.",
        "Check rate_hz; correct frequency_hz where it is the one that is wrong. Where time was "
        "lost, look for a recorder that drops blocks, and record again.",
    ),
)

#: Code → warning, of all contracted codes.
WARNINGS: Mapping[str, WarningKind] = MappingProxyType({kind.code: kind for kind in _KINDS})


def explain(code: str) -> WarningKind:
    """Return the warning of this code; one without explanation for a code of a later version."""
    unknown = "This version of vibrident has no explanation for this warning."
    return WARNINGS.get(code) or WarningKind(code, code, unknown, "Read its message.")
