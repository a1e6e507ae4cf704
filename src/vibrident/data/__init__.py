"""Measured data: records, tables and calibrations, their readers, and demodulation of raw light."""
