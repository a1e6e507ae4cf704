"""What there is to choose from, as names; nothing is loaded."""

from __future__ import annotations

DISCRETISATIONS = ("euler", "zoh", "foh", "tustin", "bandlimited")
UNCERTAINTIES = ("auto", "noise", "inflated")
#: Addresses at which a page is for this machine alone.
LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})
