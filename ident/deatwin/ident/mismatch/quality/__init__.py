"""Check whether the recordings are sound, and how large the noise of their sensor is."""
