"""Settings, motions and noise drawn from a seed, for groups named by what is varied by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bench.adversary.defects import Raw
from bench.adversary.noise import Noise, rms
from bench.adversary.physics import INTEGRATIONS, Motion
from bench.adversary.recording import DECLARED, Setting, excite, record, setting
from bench.adversary.trial import Trial, calibration, truth

COLOURS = ("white", "pink", "ar2", "brown")
#: Motions; what is ``running`` runs when the record begins. Random motion and tones always do.
MOTIONS = (
    "random",
    "multisine",
    "sine",
    "sweep",
    "sweep running",
    "shock",
    "shock running",
    "burst",
    "burst running",
)
#: Records and samples of each.
SHAPES = ((1, 2000), (1, 5000), (2, 4000), (4, 2000), (8, 1000))
#: Where the sensor's natural frequency lies; ``under`` is below the whole band.
PLACES = ("under", "below", "in", "edge", "above", "far")
DAMPINGS = ("sharp", "light", "damped", "over")
NO_FREE_MOTION = ("burst", "shock", "sweep")  # a record of these begins at rest


def log_uniform(low: float, high: float, rng: np.random.Generator) -> float:
    """Return a number whose logarithm is uniform between the limits."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def draw_setting(
    model: str,
    quantity: str,
    rng: np.random.Generator,
    places: tuple[str, ...] = PLACES,
    dampings: tuple[str, ...] = DAMPINGS,
) -> tuple[Setting, str]:
    """Return a sensor of this model with its band, and a text that says where it lies."""
    core, *add_ons = model.split("+")
    position = str(rng.choice(places))
    damping = str(rng.choice(dampings))
    kind = f"{'below' if position == 'under' else position}-{damping}"
    if core == "velocity-pickup":
        kind = f"pickup-{kind}"
    conditions = replace(setting("+".join([kind, *add_ons]), rng), quantity=quantity)
    if position == "under":
        low = conditions.sensor.parameters["natural_frequency"] * rng.uniform(1.5, 3.0)
        conditions = replace(conditions, band_hz=(low, conditions.band_hz[1]))
    frequency = conditions.sensor.parameters["natural_frequency"] / conditions.band_hz[1]
    ratio = conditions.sensor.parameters["damping_ratio"]
    return conditions, f"{position}, fn {frequency:.3g} of the top, damping {ratio:.3g}"


def draw_noise(
    rng: np.random.Generator,
    response: tuple[float, float] = (1e-5, 1e-2),
    reference: tuple[float, float] | None = None,
    colours: tuple[str, str] | None = None,
) -> Noise:
    """Return noise of both channels; levels are log-uniform, in parts of the channels' rms."""
    level = log_uniform(*response, rng)
    behind = log_uniform(*reference, rng) if reference else 0.0
    colour, second_colour = colours or [str(name) for name in rng.choice(COLOURS, 2)]
    text = f"response {level:.1e} {colour}"
    if behind:
        text += f", reference {behind:.1e} {second_colour}"
    return Noise(text, level, behind, colour, reference_colour=second_colour)


def draw_motions(
    motion: str, conditions: Setting, rng: np.random.Generator, shape: tuple[int, int]
) -> list[Motion]:
    """Return the motions of all records; level in acceleration or in the reference's quantity."""
    base, _, running = motion.partition(" ")
    low, top = conditions.band_hz
    narrow = base in NO_FREE_MOTION and rng.random() < 0.5
    exponent = int(rng.choice([0, INTEGRATIONS[conditions.quantity]]))
    moves = []
    for move in excite(base, conditions, rng, shape):
        if narrow:
            in_band = (move.frequency_hz >= 0.3 * low) & (move.frequency_hz <= 1.3 * top)
            move = Motion(move.frequency_hz[in_band], move.amplitude[in_band])
        if running:
            move = move.later(_begin(base, conditions, shape[1], rng))
        tilt = (move.frequency_hz / np.sqrt(low * top)) ** exponent
        size = np.linalg.norm(move.amplitude) / np.linalg.norm(move.amplitude * tilt)
        moves.append(Motion(move.frequency_hz, move.amplitude * tilt * size))
    return moves


def _begin(base: str, conditions: Setting, samples: int, rng: np.random.Generator) -> float:
    """Return when a record begins that sees the motion run, s."""
    length = samples / conditions.rate
    if base == "shock":  # its push is a quarter into the record
        return 0.25 * length + rng.uniform(-1.0, 1.0) * 1.3 / (0.35 * conditions.band_hz[1])
    return length * (rng.uniform(0.2, 0.7) if base == "sweep" else rng.uniform(0.5, 0.9))


def draw_records(
    motion: str, conditions: Setting, noise: Noise, rng: np.random.Generator, shape: tuple[int, int]
) -> list[Raw]:
    """Return recordings of these motions, half of them with free motion where the motion runs."""
    base, _, running = motion.partition(" ")
    declared = DECLARED.get(base, base)
    free = running or base not in NO_FREE_MOTION
    free = free and conditions.sensor.parameters["natural_frequency"] < 0.4 * conditions.rate
    recordings = []
    for i, move in enumerate(draw_motions(motion, conditions, rng, shape)):
        size = float(rng.choice([0.0, 0.3])) if free else 0.0
        name = f"{declared}-{i}"
        recordings.append(record(move, name, declared, shape[1], conditions, noise, rng, free=size))
    return recordings


def draw_shape(motion: str, rng: np.random.Generator) -> tuple[int, int]:
    """Return how many records of how many samples."""
    if motion == "sine":
        return int(rng.integers(6, 11)), 1000
    return SHAPES[int(rng.integers(len(SHAPES)))]


def clean_trial(recordings: list[Raw], conditions: Setting, noise: Noise, drawn: str) -> Trial:
    """Return a trial with which nothing is wrong."""
    model = conditions.sensor.model
    allowed = {"reference_noise"} if noise.reference else set()
    if "brown" in (noise.colour, noise.reference_colour if noise.reference else ""):
        allowed.add("drift")  # which brown noise is
    if "highpass" in model and conditions.sensor.parameters["damping_ratio"] > 1.0:
        allowed.add("weakly_determined")  # which of three real poles is the high-pass's
    return Trial(
        calibration(recordings, model, conditions.quantity),
        model,
        truth(conditions.sensor),
        allowed=frozenset(allowed),
        drawn=describe(conditions, recordings, noise, drawn),
    )


def faulty_trial(
    recordings: list[Raw],
    sound: list[Raw] | None,
    conditions: Setting,
    cause: str,
    drawn: str,
    **more,
) -> Trial:
    """Return a trial with which something is wrong; ``sound``: the same without it."""
    model = conditions.sensor.model
    without = None if sound is None else calibration(sound, model, conditions.quantity)
    complete = calibration(recordings, model, conditions.quantity)
    true = more.pop("true", truth(conditions.sensor))
    return Trial(complete, model, true, cause=cause, sound=without, drawn=drawn, **more)


def describe(conditions: Setting, recordings: list[Raw], noise: Noise, drawn: str) -> str:
    """Return what chance has set."""
    shape = f"{len(recordings)} x {recordings[0].response.size} at {conditions.rate:g} Hz"
    return f"{drawn}; {conditions.quantity}; {shape}; {noise.name}"


def level(values: np.ndarray) -> float:
    """Return the rms about the mean."""
    return rms(values - values.mean())
