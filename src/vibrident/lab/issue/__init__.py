"""Issue of certificates: drafts, review by a second account, number, signatures, verification.

Drafts, reviews and what was issued are rows of the history's store, which only grows.
"""

from __future__ import annotations

from vibrident.base.extras import require

require(
    "sqlalchemy",
    "sign",
    "Issuing and verifying certificates needs a library that is not installed.",
    "⟦command = issue⟧ or ⟦command = verify⟧",
)
