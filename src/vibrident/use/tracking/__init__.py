"""Recursive identification: sensitivity, resonance, damping and delay kept up to date, with alarms at a stated rate."""
