"""Words by which files state things, in the usual languages; ``vocabulary.toml`` lists them."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

VOCABULARY: dict[str, Any] = tomllib.loads(
    Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")
)
