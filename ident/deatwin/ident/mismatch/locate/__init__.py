"""Location of the mismatch in time, frequency, operating region and part of the plant."""
