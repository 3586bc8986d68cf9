"""Margins of sampled loops, one or many at once."""
