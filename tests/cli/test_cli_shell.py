"""The command as a shell sees it: a process with streams, an environment and signals."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

VIBRIDENT = [sys.executable, "-m", "vibrident"]
