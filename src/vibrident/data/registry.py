"""Which data formats can be read, and which sources of samples there are."""

from __future__ import annotations

from typing import Any

from vibrident.base.registry import Registry

#: ``vibrident.data.io.reader.Reader`` objects; their names are for messages, a file's ending finds
#: them.
READERS: Registry[Any] = Registry(
    "reader",
    "vibrident.readers",
    ("data/io/formats",),
    ("vibrident.data.io.reader:Reader",),
    "file ending",
)
#: ``vibrident.data.sources.source.Source`` objects.
SOURCES: Registry[Any] = Registry(
    "source",
    "vibrident.sources",
    ("data/sources/kinds",),
    ("vibrident.data.sources.source:Source",),
    "⟦track.source⟧",
)
