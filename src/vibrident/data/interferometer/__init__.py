"""From photodetector signals to displacement (ISO 16063-11, method 3): ellipse, phase, slips, decimation, effects.

Pure NumPy and SciPy, in blocks: the memory does not grow with the optical signals. ``demodulation``
is the main path.
"""
