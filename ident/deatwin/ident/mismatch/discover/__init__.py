"""A free form of what no effect of the catalogue explains."""
