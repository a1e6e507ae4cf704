"""Values by name, as documents, rows of tables, sections of files and settings hold them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

Fields = dict[str, Any]  # name → value
GivenFields = Mapping[str, Any]  # the same where it is read alone
NamedNumbers = Mapping[str, float]  # name → number
NamedTexts = Mapping[str, str]  # name → text
