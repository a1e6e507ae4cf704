"""The paper's experiments: its tables and figures, with published numbers beside this package's.

Li, Liu, Cai, Yao, Pan, Yang. An IPNN-Based Parameter Identification Method for a Vibration Sensor
Sensitivity Model. Mathematics 2025, 13(22), 3609.
"""

from __future__ import annotations
