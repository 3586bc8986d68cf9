"""Where the mismatch is: when, at which frequencies, in which operating region, in which part of the plant."""
