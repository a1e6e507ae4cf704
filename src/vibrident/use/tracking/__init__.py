"""Recursive identification: sensor parameters kept up to date, with alarms at a stated rate."""

from __future__ import annotations

#: Time between estimates unless it is given, s.
EVERY_S = 1.0
#: Random walk of a parameter in a year where no history states it, relative: a choice.
DRIFT_PER_YEAR = 0.01
#: False alarms that noise alone is expected to cause in a day of motion.
FALSE_ALARMS_PER_DAY = 0.01
