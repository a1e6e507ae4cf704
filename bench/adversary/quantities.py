"""Clean recordings of every quantity, model, motion and colour of noise; long records."""

from __future__ import annotations

import itertools
from functools import partial

import numpy as np

from bench.adversary.draws import (
    COLOURS,
    MOTIONS,
    clean_trial,
    draw_noise,
    draw_records,
    draw_setting,
    draw_shape,
)
from bench.adversary.trial import Cases, Trial

QUANTITIES = ("acceleration", "velocity", "displacement")
MODELS = (
    "accelerometer",
    "accelerometer+delay",
    "accelerometer+highpass",
    "accelerometer+mode2=0.1",
    "accelerometer+highpass+delay",
    "accelerometer+mode2=-0.1+delay",
    "velocity-pickup",
    "velocity-pickup+delay",
    "velocity-pickup+highpass",
)
#: Samples of the long records, one a case.
LENGTHS = (200_000, 250_000, 350_000, 500_000, 700_000, 1_000_000, 1_400_000, 2_000_000)
LONG_MOTIONS = ("random", "sweep running", "random", "sweep")
BOXCAR = "accelerometer+boxcar"  # its free motion is no sum of exponentials: steady tones
SOFT = {"reference": (1e-5, 1e-3), "strong": (1e-3, 3e-2)}


def quantities() -> Cases:
    """Return the names and makers: colours of both channels' noise, strength of the reference's."""
    for quantity, model, motion in itertools.product(QUANTITIES, MODELS, MOTIONS):
        yield f"{quantity}/{model}/{motion}", partial(_quantity, quantity, model, motion)
    for quantity in QUANTITIES:
        yield f"{quantity}/{BOXCAR}/sine", partial(_quantity, quantity, BOXCAR, "sine")


def noises() -> Cases:
    """Return the names and makers: colours of both channels' noise, strength of the reference's."""
    motions = itertools.cycle(MOTIONS)
    for strength, reference, response, quantity in itertools.product(
        SOFT, COLOURS, COLOURS, QUANTITIES
    ):
        motion = next(motions)
        name = f"{strength} {reference}, response {response}/{quantity}/{motion}"
        yield name, partial(_noisy, SOFT[strength], (response, reference), quantity, motion)


def long() -> Cases:
    """Return the names and makers: colours of both channels' noise, strength of the reference's."""
    for number, samples in enumerate(LENGTHS):
        colour = COLOURS[(number + number // 4) % 4]
        motion = LONG_MOTIONS[number % 4]
        yield f"{samples}/{colour}/{motion}", partial(_long, samples, colour, motion)


def _quantity(quantity: str, model: str, motion: str, rng: np.random.Generator) -> Trial:
    conditions, drawn = draw_setting(model, quantity, rng)
    noise = draw_noise(rng, reference=(1e-6, 1e-3) if rng.random() < 0.5 else None)
    recordings = draw_records(motion, conditions, noise, rng, draw_shape(motion, rng))
    return clean_trial(recordings, conditions, noise, drawn)


def _noisy(
    reference: tuple[float, float],
    colours: tuple[str, str],
    quantity: str,
    motion: str,
    rng: np.random.Generator,
) -> Trial:
    model = str(rng.choice(["accelerometer", "velocity-pickup", "accelerometer+delay"]))
    conditions, drawn = draw_setting(model, quantity, rng)
    noise = draw_noise(rng, reference=reference, colours=colours)
    recordings = draw_records(motion, conditions, noise, rng, draw_shape(motion, rng))
    return clean_trial(recordings, conditions, noise, drawn)


def _long(samples: int, colour: str, motion: str, rng: np.random.Generator) -> Trial:
    model = str(rng.choice(["accelerometer", "accelerometer+delay", "velocity-pickup"]))
    quantity = str(rng.choice(QUANTITIES))
    conditions, drawn = draw_setting(model, quantity, rng, places=("below", "in", "edge", "above"))
    noise = draw_noise(rng, (1e-4, 1e-2), (1e-5, 1e-3), (colour, "white"))
    recordings = draw_records(motion, conditions, noise, rng, (1, samples))
    return clean_trial(recordings, conditions, noise, drawn)
