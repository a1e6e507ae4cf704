"""Registry of the formats of other programs that can be written."""

from __future__ import annotations

from typing import Any

from vibrident.base.registry import Registry

#: ``vibrident.export.form.Format`` objects.
EXPORTS: Registry[Any] = Registry(
    "export format",
    "vibrident.exports",
    ("export/formats",),
    ("vibrident.export.form:Format",),
    "⟦export.form⟧",
)
