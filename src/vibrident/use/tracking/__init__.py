"""Recursive identification: sensitivity, resonance, damping and delay kept up to date, with alarms at a stated rate."""

from __future__ import annotations

EVERY_S = 1.0  # time between estimates, s, unless it is given
DRIFT_PER_YEAR = 0.01  # random walk of a parameter in a year, relative, where no history states it: a choice
FALSE_ALARMS_PER_DAY = 0.01  # expected of noise alone, in a day of motion
