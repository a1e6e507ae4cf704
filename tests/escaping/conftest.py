"""The sample results live beside the tests of the pictures and of the exports."""

import sys
from pathlib import Path

_TESTS = Path(__file__).parents[1]
sys.path[:0] = [str(Path(__file__).parent), *(str(_TESTS / folder) for folder in ("plots", "export"))]
