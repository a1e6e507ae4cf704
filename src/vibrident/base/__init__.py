"""What every other room stands on: errors, names, plug-ins, processes with limits. It knows nothing of vibration."""
