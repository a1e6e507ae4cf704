"""Refuse records of raw light whose motion falls into samples that are left out."""

from __future__ import annotations

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.interferometer.alignment import AlignedDisplacement
from vibrident.data.interferometer.setting import SampledSignals
from vibrident.data.interferometer.summary import OpticalFinding
from vibrident.data.interferometer.survey import BLOCK_SAMPLES
from vibrident.data.records.basis import extend_flags

#: Largest share of a response's power that may fall into samples that are left out.
MAX_LOST_POWER = 0.5
#: The same of a shock, of which the pulse is all.
MAX_LOST_POWER_OF_SHOCK = 0.1
#: A channel that lasts 2 to MAX_DURATION_RATIO times as long as the other has another clock …
MAX_DURATION_RATIO = 10
#: … if the ratio is a whole number within this relative tolerance.
DURATION_TOLERANCE = 5e-3
#: Smallest mean square of a shock's acceleration over that of its noise, less one.
MIN_SHOCK_TO_NOISE = 1.5
#: A response is the shock's above this multiple of its median power: 3 standard deviations of
#: noise.
MIN_PULSE_TO_MEDIAN = 20.0
#: Parts of a pulse's energy before its begin, its middle and its end.
PULSE_ENERGY = (0.01, 0.5, 0.999)
#: Samples beside these that a fit cannot use either: it interpolates the reference from this many
#: on either side …
UNSEEN_NEIGHBOURS = 32
#: … and this many at the ends of a record, where the state of the sensor is an unknown, too.
UNSEEN_END_SAMPLES = 48


def clock_findings(optical_s: float, response_s: float, name: str) -> tuple[OpticalFinding, ...]:
    """Return a finding if one channel lasts a whole number of times as long as the other."""
    times = max(optical_s, response_s) / max(min(optical_s, response_s), 1e-300)
    ratio = round(min(times, MAX_DURATION_RATIO + 1.0))
    if not 2 <= ratio <= MAX_DURATION_RATIO or abs(times / ratio - 1.0) > DURATION_TOLERANCE:
        return ()
    text = (
        f"{name}: the optical signals last {optical_s:.6g} s, the response {response_s:.6g} s. "
        "If both were recorded together, rate_hz of [interferometer] or of [sampling] is wrong "
        f"by a factor of {ratio}."
    )
    return (OpticalFinding("clock_suspect", text),)


def require_motion(aligned: AlignedDisplacement, excitation: str, name: str) -> None:
    """Refuse a record whose motion falls into samples that are left out.

    The record beside the pulse of a shock does not determine the sensor.
    """
    max_lost_power = MAX_LOST_POWER_OF_SHOCK if excitation == "shock" else MAX_LOST_POWER
    power = (aligned.response - np.mean(aligned.response)) ** 2
    unseen = extend_flags(~aligned.valid, UNSEEN_NEIGHBOURS)
    lost = float(np.sum(power[unseen])) / max(float(np.sum(power)), 1e-300)
    if lost > max_lost_power:
        raise InputError(
            "The light is lost while the sensor moves (fringe_slip).",
            expected=f"at least {100 * (1 - max_lost_power):.0f} % of the response's power "
            "outside the stretches left out",
            found=f"{100 * (1 - lost):.2g} %; {100 * float(np.mean(~aligned.valid)):.2g} % of the "
            "time is left out",
            where=name,
            remedy="repeat the measurement, or leave this record out",
        )


def power_share_outside(response: SampledSignals, aligned: AlignedDisplacement) -> float:
    """Return the share of a response's power so near to its ends that no fit uses it."""
    margin_s = UNSEEN_END_SAMPLES / aligned.rate_hz
    first_s = aligned.start_s + margin_s
    last_s = aligned.start_s + aligned.response.shape[0] / aligned.rate_hz - margin_s
    first = int(first_s * response.rate_hz)
    last = int(last_s * response.rate_hz)
    sums = np.zeros((2, 3))
    for start in range(0, response.samples, BLOCK_SAMPLES):
        values = response.block(start, min(start + BLOCK_SAMPLES, response.samples))[0].astype(
            float
        )
        inside = values[max(first - start, 0) : max(last - start, 0)]
        sums += [[chunk.size, np.sum(chunk), chunk @ chunk] for chunk in (values, inside)]
    mean = sums[0, 1] / sums[0, 0]
    total, within = sums[:, 2] - 2.0 * mean * sums[:, 1] + mean**2 * sums[:, 0]
    return float(1.0 - within / max(total, 1e-300))


def require_pulse(aligned: AlignedDisplacement, outside: float, name: str) -> None:
    """Refuse a shock that the displacement does not show.

    Too near to an end only free ringing remains, which any sensitivity explains. If the shock is
    too weak, the differences of the displacement are noise of the phase.
    """
    if outside > MAX_LOST_POWER_OF_SHOCK:
        raise InputError(
            "The shock is too near to an end of the record.",
            expected=f"at least {100 * (1 - MAX_LOST_POWER_OF_SHOCK):.0f} % of the response's "
            "power where the displacement can be differentiated",
            found=f"{100 * (1 - outside):.2g} %",
            where=name,
            remedy="record more before and after the shock",
        )
    above = _pulse_to_noise(aligned)
    if above < MIN_SHOCK_TO_NOISE:
        raise InputError(
            "The shock is hidden by the noise of the interferometer's phase.",
            expected="an acceleration whose mean square during the shock exceeds that of its "
            f"noise {MIN_SHOCK_TO_NOISE:g} times, at {aligned.rate_hz:.6g} Hz",
            found=f"{above:.2g} times",
            where=name,
            remedy="shock harder, reduce the noise of the optical signals, or record more before "
            "and after the shock: fewer samples a second, of less noise, then do; check rate_hz "
            "and delay_s of [interferometer], too",
        )


def _pulse_to_noise(aligned: AlignedDisplacement) -> float:
    """Return the mean square of a shock's acceleration over that of its noise, less one."""
    power = (aligned.response - np.median(aligned.response)) ** 2
    square = aligned.displacement_m**2
    energy = np.cumsum(np.where(power > MIN_PULSE_TO_MEDIAN * np.median(power), power, 0.0))
    begin, middle, end = np.searchsorted(energy, np.array(PULSE_ENERGY) * energy[-1])
    still = aligned.valid.copy()
    still[max(begin - 8, 0) : end] = False
    noise = float(np.mean(square[still])) if np.count_nonzero(still) >= UNSEEN_END_SAMPLES else 0.0
    return (
        float(np.mean(square[max(begin - 2, 0) : middle + 1])) / noise - 1.0
        if noise > 0.0
        else np.inf
    )
