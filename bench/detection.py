"""``python -m bench.detection``: detection rate of a wrong model, and false alarms of a right one.

python -m bench.detection --runs 60          60 seeded runs a cell; stops and resumes at will
python -m bench.detection --only delay/sine  cells whose name holds the text

The page is docs/detection.md; see :mod:`bench.study`.
"""

from __future__ import annotations

import sys

import numpy as np

from bench.detection_cells import CELLS, block
from bench.detection_table import table
from bench.study import Study

STUDY = Study("detection", __doc__.splitlines()[0], 200, CELLS, block, table)

if __name__ == "__main__":
    np.seterr(all="ignore")
    sys.exit(STUDY.main())
