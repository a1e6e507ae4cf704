"""Recursive identification: sensor parameters kept up to date, with alarms at a stated rate."""
