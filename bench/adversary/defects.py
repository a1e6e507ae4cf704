"""Defects of recordings: changes of the channels of a record, or of the list of records."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bench.adversary.noise import rms
from bench.adversary.physics import TAU, Real


@dataclass(frozen=True)
class Raw:
    """Recording before it is handed over: channels, rate, kind of motion, stated frequency."""

    name: str
    reference: Real
    response: Real
    rate: float
    excitation: str
    frequency_hz: float | None = None

    def both(self, change: Callable[[Real], Real]) -> Raw:
        """Return the same change of both channels."""
        return replace(self, reference=change(self.reference), response=change(self.response))


Change = Callable[[Raw, np.random.Generator], Raw]
Changes = Callable[[list[Raw], np.random.Generator], list[Raw]]


@dataclass(frozen=True)
class Defect:
    """A defect of recordings.

    Attributes:
        name: cause and size.
        change: of all records.
    """

    name: str
    change: Changes

    @property
    def cause(self) -> str:
        """Return the name without its size."""
        return self.name.split(":")[0]


def in_every_record(change: Change) -> Changes:
    """Return the same defect in every record."""
    return lambda records, rng: [change(record, rng) for record in records]


def of_one_record(change: Change) -> Changes:
    """Return a defect of one record among several."""

    def changed(records: list[Raw], rng: np.random.Generator) -> list[Raw]:
        at = int(rng.integers(len(records)))
        return [change(r, rng) if i == at else r for i, r in enumerate(records)]

    return changed


def _on(channel: str, change: Callable[..., Real], *sizes: Any) -> Change:
    """Return a change of one channel by a function of its values, random numbers, and the sizes."""
    return lambda raw, rng: replace(raw, **{channel: change(getattr(raw, channel), rng, *sizes)})


def clip(values: Real, rng: np.random.Generator, fraction: float, side: str = "both") -> Real:
    """Cut at a part of the peak, on both sides or above."""
    limit = fraction * float(np.max(np.abs(values)))
    return np.clip(values, -limit if side == "both" else None, limit)


def dropout(values: Real, rng: np.random.Generator, count: int, length: int, held: bool) -> Real:
    """Stretches of samples that are zero, or keep the last value before them."""
    values = values.copy()
    for at in rng.integers(1, values.size - length, count):
        values[at : at + length] = values[at - 1] if held else 0.0
    return values


def step(values: Real, rng: np.random.Generator, size: float) -> Real:
    """Return a gain that changes in the middle."""
    at = int(values.size * rng.uniform(0.4, 0.6))
    return np.concatenate([values[:at], (1.0 + size) * values[at:]])


def ramp(values: Real, rng: np.random.Generator, size: float) -> Real:
    """Return a gain that changes evenly over the record."""
    return values * (1.0 + size * np.linspace(0.0, 1.0, values.size))


def drift(values: Real, rng: np.random.Generator, size: float) -> Real:
    """Return a zero that wanders by this much of the rms."""
    return values + size * rms(values) * np.linspace(-1.0, 1.0, values.size) ** 3


def settling(values: Real, rng: np.random.Generator, size: float) -> Real:
    """Return a zero that settles by this much of the rms, as while an amplifier warms up."""
    return values + size * rms(values) * np.exp(-np.linspace(0.0, 1.0, values.size) / 0.6)


def spikes(values: Real, rng: np.random.Generator, count: int, size: float) -> Real:
    """Single samples off by this many rms."""
    values = values.copy()
    values[rng.integers(0, values.size, count)] += (
        size * rms(values) * rng.choice([-1.0, 1.0], count)
    )
    return values


def missing(values: Real, rng: np.random.Generator, count: int) -> Real:
    """Return the samples lost, one here and there; the rest moves up and the end is repeated."""
    remaining = np.delete(values, rng.integers(values.size // 10, values.size - 10, count))
    return np.concatenate([remaining, remaining[-(values.size - remaining.size) :]])


def gap(length: int) -> Change:
    """Cut a stretch of both channels out, and the time that it took."""

    def jumped(raw: Raw, rng: np.random.Generator) -> Raw:
        at = int(raw.response.size * rng.uniform(0.3, 0.7))
        return raw.both(lambda values: np.delete(values, slice(at, at + length)))

    return jumped


def twice(length: int, inserted: bool) -> Callable[[Real], Real]:
    """Return A block that was written twice: over what followed it, or before it."""

    def written(values: Real) -> Real:
        at = values.size // 3 + 7
        block = values[at : at + length]
        following = values[at + (0 if inserted else length) :]
        return np.concatenate([values[: at + length], block, following[length:]])[: values.size]

    return written


def slipped(samples: int) -> Change:
    """Let the response lag by more samples from about the middle on: the reference lost them."""

    def slip(raw: Raw, rng: np.random.Generator) -> Raw:
        at = int(raw.response.size * rng.uniform(0.4, 0.6))
        lost = np.delete(raw.reference, slice(at, at + samples))
        return replace(raw, reference=lost, response=raw.response[: lost.size])

    return slip


def cuts(count: int, length: int) -> Change:
    """Return a few samples of both channels are lost here and there."""

    def cut(raw: Raw, rng: np.random.Generator) -> Raw:
        places = (
            np.linspace(0.15, 0.85, count) + rng.uniform(-0.05, 0.05, count)
        ) * raw.response.size
        gone = [int(start) + i for start in places for i in range(length)]
        return raw.both(lambda values: np.delete(values, gone))

    return cut


def compressed(values: Real, rng: np.random.Generator, fraction: float) -> Real:
    """Return the response falls short by this part at its peak, as the cube of it."""
    return values * (1.0 - fraction * (values / np.max(np.abs(values))) ** 2)


def squared(values: Real, rng: np.random.Generator, fraction: float) -> Real:
    """Return a square of this part of the peak is added."""
    return values + fraction * values**2 / np.max(np.abs(values))


def dead_band(values: Real, rng: np.random.Generator, fraction: float) -> Real:
    """Return what is smaller than this part of the peak is not seen."""
    edge = fraction * np.max(np.abs(values))
    return np.sign(values) * np.maximum(np.abs(values) - edge, 0.0)


def slewed(values: Real, rng: np.random.Generator, fraction: float) -> Real:
    """Return the response cannot change faster than this part of its fastest change."""
    most = fraction * float(np.max(np.abs(np.diff(values))))
    out = values.copy()
    for i in range(1, out.size):
        out[i] = out[i - 1] + min(max(values[i] - out[i - 1], -most), most)
    return out


def folded(values: Real, rng: np.random.Generator, tone: float, size: float) -> Real:
    """Return a tone from above half the rate, folded into the band."""
    return values + size * rms(values) * np.cos(
        TAU * (tone * np.arange(values.size) + rng.random())
    )


def respond(change: Callable[..., Real], *sizes: Any) -> Changes:
    """Apply a change to the response of every record."""
    return in_every_record(_on("response", change, *sizes))


def refer(change: Callable[..., Real], *sizes: Any) -> Changes:
    """Apply a change to the reference of every record."""
    return in_every_record(_on("reference", change, *sizes))


def respond_once(change: Callable[..., Real], *sizes: Any) -> Changes:
    """Apply a change to the response of one record."""
    return of_one_record(_on("response", change, *sizes))


def swapped(raw: Raw, rng: np.random.Generator) -> Raw:
    """Channels exchanged."""
    return replace(raw, reference=raw.response, response=raw.reference)


def rate(factor: float, stated: bool) -> Change:
    """Return the rate is wrong by a factor; sines may state their frequency."""

    def wrong(raw: Raw, rng: np.random.Generator) -> Raw:
        possible = stated and raw.frequency_hz and raw.frequency_hz < 0.5 * raw.rate * factor
        return replace(
            raw, rate=raw.rate * factor, frequency_hz=raw.frequency_hz if possible else None
        )

    return wrong


def repeated(times: int) -> Changes:
    """Identical copies under other names."""
    return lambda records, rng: [
        replace(r, name=f"{r.name}-copy{i}" if i else r.name) for r in records for i in range(times)
    ]


def scaled(values: Real, rng: np.random.Generator, factor: float) -> Real:
    """Another gain (−1: polarity)."""
    return factor * values


def _sizes(name: str, sizes: tuple[float, ...], make: Callable[[float], Changes]) -> list[Defect]:
    return [Defect(f"{name}:{size:g}", make(size)) for size in sizes]


def recordings() -> tuple[Defect, ...]:
    """Return all defects of recordings."""
    defects: list[Defect] = []
    for fraction in (0.9, 0.7, 0.4):
        defects += [
            Defect(f"clipped response:{fraction:g}", respond(clip, fraction)),
            Defect(f"clipped response above:{fraction:g}", respond(clip, fraction, "above")),
            Defect(f"clipped reference:{fraction:g}", refer(clip, fraction)),
            Defect(f"clipped reference above:{fraction:g}", refer(clip, fraction, "above")),
        ]
    for count, length in ((10, 5), (1, 20), (3, 100)):
        for held in (True, False):
            kind = "held" if held else "zero"
            defects += [
                Defect(
                    f"dropouts {kind} response:{count}x{length}",
                    respond(dropout, count, length, held),
                ),
                Defect(
                    f"dropouts {kind} reference:{count}x{length}",
                    refer(dropout, count, length, held),
                ),
            ]
    defects += _sizes("gain step", (0.001, 0.01, 0.1, 0.5), lambda s: respond(step, s))
    defects += _sizes("gain step of the reference", (0.01, 0.1), lambda s: refer(step, s))
    defects += _sizes("gain ramp", (0.01, 0.1), lambda s: respond(ramp, s))
    defects += _sizes(
        "gain of one record", (0.003, 0.03, 0.3), lambda s: respond_once(scaled, 1.0 + s)
    )
    defects += _sizes("drift", (0.1, 1.0, 10.0), lambda s: respond(drift, s))
    defects += _sizes(
        "offset",
        (1.0, 100.0),
        lambda s: in_every_record(lambda r, g: r.both(lambda v: v + s * rms(v))),
    )
    defects += _sizes("spikes", (1.0, 10.0, 100.0), lambda s: respond(spikes, 3, s))
    defects += _sizes("spikes of the reference", (3.0, 30.0), lambda s: refer(spikes, 3, s))
    defects += _sizes("missing samples", (1, 3), lambda s: respond(missing, int(s)))
    defects += _sizes("jump of time", (1, 37, 400), lambda s: in_every_record(gap(int(s))))
    defects += _sizes("compression", (0.001, 0.01, 0.1, 0.2), lambda s: respond(compressed, s))
    defects += _sizes("square", (0.01, 0.1), lambda s: respond(squared, s))
    defects += _sizes("dead band", (0.001, 0.01), lambda s: respond(dead_band, s))
    defects += _sizes("slew rate", (0.5, 0.8), lambda s: respond(slewed, s))
    defects += _sizes("aliased tone", (0.03, 0.3), lambda s: respond(folded, 0.19, s))
    defects += _sizes("copies", (2, 5), lambda s: repeated(int(s)))
    defects += _sizes(
        "rate with stated frequency",
        (0.5, 2.0, 1.024),
        lambda s: in_every_record(rate(s, stated=True)),
    )
    defects += [
        Defect("swapped channels", in_every_record(swapped)),
        Defect("swapped channels of one record", of_one_record(swapped)),
        Defect("polarity of one record", respond_once(scaled, -1.0)),
        Defect(
            "polarity of the reference of one record", of_one_record(_on("reference", scaled, -1.0))
        ),
        Defect("dead response", respond_once(lambda v, g: 1e-3 * rms(v) * g.normal(size=v.size))),
        Defect(
            "dead reference",
            of_one_record(_on("reference", lambda v, g: 1e-3 * rms(v) * g.normal(size=v.size))),
        ),
        Defect("constant response", respond_once(lambda v, g: np.full(v.size, v[0]))),
        *_sizes("settling zero", (0.02,), lambda s: respond(settling, s)),
    ]
    return tuple(defects)


def acquisition() -> tuple[Defect, ...]:
    """Defects between converter and file: samples written twice, or lost."""
    defects: list[Defect] = []
    for length in (40, 128):
        defects += [
            Defect(
                f"buffer twice response:{length}",
                respond(lambda v, g, n=length: twice(n, False)(v)),
            ),
            Defect(
                f"buffer twice reference:{length}", refer(lambda v, g, n=length: twice(n, False)(v))
            ),
            Defect(
                f"buffer twice both:{length}",
                in_every_record(lambda r, g, n=length: r.both(twice(n, False))),
            ),
            Defect(
                f"buffer inserted response:{length}",
                respond(lambda v, g, n=length: twice(n, True)(v)),
            ),
            Defect(
                f"buffer inserted both:{length}",
                in_every_record(lambda r, g, n=length: r.both(twice(n, True))),
            ),
        ]
    defects += _sizes(
        "slip between channels", (1, 10, 100), lambda s: in_every_record(slipped(int(s)))
    )
    defects += _sizes(
        "slip between channels of one record", (1, 10), lambda s: of_one_record(slipped(int(s)))
    )
    defects += _sizes(
        "cuts of both channels", (1, 2, 3), lambda s: in_every_record(cuts(3, int(s)))
    )
    return tuple(defects)
