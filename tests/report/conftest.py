"""The sample results live beside the tests of the pictures, what tests of reports share beside these."""

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1] / "plots")]
