"""What was measured: records, tables, calibrations; readers, one a format; raw optical signals to displacement."""
