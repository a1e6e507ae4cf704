"""``python -m bench.scenarios``: every noise × every excitation × four sensors, many seeded runs a cell.

python -m bench.scenarios --runs 500         the full study; stops and resumes at will
python -m bench.scenarios --runs 20          a look
python -m bench.scenarios --only piezo/shock cells whose name holds the text

The page is docs/scenarios.md; see :mod:`bench.study`.
"""

from __future__ import annotations

import sys

import numpy as np

from bench.scenario_cells import CELLS, block
from bench.scenario_table import table
from bench.study import Study

STUDY = Study("scenarios", __doc__.splitlines()[0], 500, CELLS, block, table)

if __name__ == "__main__":
    np.seterr(all="ignore")
    sys.exit(STUDY.main())
