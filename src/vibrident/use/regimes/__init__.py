"""A sensor that changes within a record: its regimes are found in time and fitted apart.

``pieces`` finds them, ``change_time`` says when one ends, ``shared`` combines what stays the same,
and ``identification`` makes the result.
"""

from __future__ import annotations

from vibrident.use.regimes.identification import with_regimes

__all__ = ["with_regimes"]
