"""Which effects of the catalogue explain a mismatch."""
