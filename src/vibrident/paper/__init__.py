"""The paper's experiments on the package's own interface: its tables and figures, published numbers beside ours.

Li, Liu, Cai, Yao, Pan, Yang. An IPNN-Based Parameter Identification Method for a Vibration Sensor
Sensitivity Model. Mathematics 2025, 13(22), 3609.
"""

from __future__ import annotations
