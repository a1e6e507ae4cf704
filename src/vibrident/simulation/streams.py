"""Random streams: one for every record and purpose, so that added records leave the others unchanged."""

from __future__ import annotations

import numpy as np

#: Streams of one record. The numbers define what a seed means; never reuse one.
PURPOSES = {"excitation": 0, "excitation noise": 1, "reference": 2, "response": 3, "optics": 4}


def stream(seed: int | np.random.SeedSequence, record: int, purpose: str) -> np.random.Generator:
    """Generator of one record's stream, as ``SeedSequence(seed).spawn`` would give it.

    ``seed``: of the whole calibration; for Monte Carlo one seed (or spawned sequence) a run; ``record``: index of the
    record; ``purpose``: key of ``PURPOSES``.
    """
    root = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
    key = (*root.spawn_key, record, PURPOSES[purpose])
    return np.random.default_rng(np.random.SeedSequence(root.entropy, spawn_key=key, pool_size=root.pool_size))
