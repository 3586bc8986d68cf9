"""Real recordings of others, diagnosed with plants that lack the documented physics."""
