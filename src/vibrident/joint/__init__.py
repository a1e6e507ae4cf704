"""One joint fit of several calibrations of one sensor."""
