"""Foundations without vibration: errors, settings, plug-ins, and processes with limits."""
